#!/usr/bin/env bash
# The main job on the default world: opens the window on it; where there is no display, or with arguments, a headless
# dive from the globe to Helsinki's streets, with pictures and a report in out/.
set -euo pipefail
export PATH="$PATH:${CARGO_HOME:-$HOME/.cargo}/bin"
cd "$(dirname "$0")/.."
bash tools/setup.sh
cargo build --release --bin stoop
stoop=${CARGO_TARGET_DIR:-target}/release/stoop
if [ $# = 0 ] && [ -n "${DISPLAY:-}${WAYLAND_DISPLAY:-}" ]; then
    exec "$stoop"
fi
"$stoop" fly tiles/default/world --path tiles/default/helsinki.json \
    --frames out/helsinki --at-secs 0,5,10,15,18,20,22,24,27,30,35,40 --audit 30 --report out/helsinki.json "$@"
echo "pictures: out/helsinki/*.png   report: out/helsinki.json"
