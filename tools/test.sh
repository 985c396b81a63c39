#!/usr/bin/env bash
# All that must pass: formatting, lints, a build without the preparing tool, and every test: the layer test, WGSL
# validation, golden images on the software adapter and a headless dive on real pixels among them.
set -euo pipefail
cd "$(dirname "$0")/.."
bash tools/setup.sh proj-bin
cargo fmt --all -- --check
cargo clippy --release --all-targets -- -D warnings
cargo check --release --no-default-features --bin stoop
cargo test --release
