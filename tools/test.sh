#!/usr/bin/env bash
# All that must pass: formatting, lints, a build without the preparing tool, and every test: the layer test, WGSL
# validation, golden images on the software adapter and a headless dive on real pixels among them.
set -euo pipefail
export PATH="$PATH:${CARGO_HOME:-$HOME/.cargo}/bin"
cd "$(dirname "$0")/.."
# The window is tested on a display without a screen, with input events as the X server sends them.
bash tools/setup.sh proj-bin xvfb xdotool
for component in fmt clippy; do
    cargo "$component" --version >/dev/null 2>&1 || rustup component add "${component/fmt/rustfmt}"
done
cargo fmt --all -- --check
cargo clippy --release --all-targets -- -D warnings
cargo check --release --no-default-features --bin stoop
cargo test --release
