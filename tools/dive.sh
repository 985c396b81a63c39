#!/usr/bin/env bash
# The main job on the default world: a dive from the globe to Helsinki's streets, with pictures and a report in out/.
set -euo pipefail
export PATH="$PATH:${CARGO_HOME:-$HOME/.cargo}/bin"
cd "$(dirname "$0")/.."
bash tools/setup.sh
cargo run --release --bin stoop -- fly tiles/default/world --path tiles/default/helsinki.json \
    --frames out/helsinki --at-secs 0,5,10,15,18,20,22,24,27,30,35,40 --audit 30 --report out/helsinki.json "$@"
echo "pictures: out/helsinki/*.png   report: out/helsinki.json"
