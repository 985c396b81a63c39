#!/usr/bin/env bash
# All that must pass: formatting, lints, every test (the layer test, WGSL validation and golden images among them), a
# build without the preparing tool, and a headless dive on real pixels.
set -euo pipefail
cd "$(dirname "$0")/.."
bash tools/setup.sh
cargo fmt --all -- --check
cargo clippy --release --all-targets -- -D warnings
cargo check --release --no-default-features --bin stoop
out=$(mktemp -d)
trap 'rm -rf "$out"' EXIT
cargo build --release --bins
target=${CARGO_TARGET_DIR:-target}
"$target/release/stoop" check tiles/default/world
"$target/release/stoop" fly tiles/default/world --path tiles/default/helsinki.json --step-secs 0.5 --size 320x180 \
    --audit 4 --frames "$out" --at-secs 0,12,30 --report "$out/report.json"
python3 - "$out" <<'PY'
import json, os, sys
folder = sys.argv[1]
report = json.load(open(os.path.join(folder, "report.json")))
pictures = [name for name in os.listdir(folder) if name.endswith(".png")]
assert len(pictures) == 3, pictures
assert report["holes"] == 0, report["holes"]
assert report["failed"] == 0, report["failed"]
assert report["footprint_max_bytes"] <= report["footprint_limit_bytes"], report["footprint_max_bytes"]
print("dive:", report["frames"], "frames,", report["bytes_read"], "bytes read, no hole")
PY
cargo test --release
