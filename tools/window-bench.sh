#!/usr/bin/env bash
# Flies a world by hand-like input in a window on a display without a screen, and prints what frames took:
# with --frame-ms 33 and without, with all panels open and with none, and while the store hangs for two seconds.
# Usage: tools/window-bench.sh [WORLD] [WIDTHxHEIGHT] [FOLDER]   needs Xvfb and xdotool; FOLDER keeps the reports
set -euo pipefail
cd "$(dirname "$0")/.."
world=${1:-tiles/default/world}
size=${2:-1280x720}
out=${3:-out/window-bench}
stoop=${CARGO_TARGET_DIR:-target}/release/stoop
[ -x "$stoop" ] || cargo build --release --bin stoop
mkdir -p "$out"
settings=$(mktemp -d)
export XDG_CONFIG_HOME=$settings XDG_RUNTIME_DIR=$settings
exec 3< <(Xvfb -displayfd 1 -screen 0 1920x1200x24 2>/dev/null & echo "$!" >"$settings/xvfb"; wait)
read -r display <&3
export DISPLAY=:$display
trap 'kill "$(cat "$settings/xvfb")"; rm -r "$settings"' EXIT
x=$((${size%x*} / 2)) y=$((${size#*x} / 2))

# NAME ARGUMENTS…; the input comes from standard input, a line of xdotool's words each.
session() {
    local name=$1
    shift
    rm -rf "$settings/stoop"
    "$stoop" "$world" --size "$size" --report "$out/$name/report.json" "$@" 2>"$out/$name.log" &
    local program=$!
    xdotool search --sync --onlyvisible --name Stoop windowfocus --sync mousemove $x $y sleep 1
    while read -r line; do
        # shellcheck disable=SC2086
        xdotool $line
    done
    xdotool key ctrl+q
    wait $program
}

# Turns of the wheel with the cursor about the middle, pauses, tilts, a look round, steps.
dive() {
    for turn in $(seq 58); do
        echo "mousemove $((x + turn % 7 * 3)) $((y + turn % 5 * 3)) click 4 sleep 0.$((12 + turn % 4 * 5))"
        [ $((turn % 15)) != 0 ] || echo "sleep 0.6"
    done
    echo "mousedown 3"
    for move in $(seq 20); do echo "mousemove $((x + 5 * move)) $((y - 9 * move)) sleep 0.03"; done
    echo "mouseup 3"
    for key in Left w a Right w d; do echo "keydown $key sleep 1 keyup $key"; done
    echo "mousemove $x $y mousedown 1"
    for move in $(seq 20); do echo "mousemove $((x - 9 * move)) $((y + 4 * move)) sleep 0.03"; done
    echo "mouseup 1 sleep 1"
}

# NAME TITLE [FROM_S [TO_S]]: frames, their times, and the tolerance drawn, between two times.
figures() {
    paste -d, "$out/$1/frames.csv" "$out/$1/timings.csv" | awk -F, -v from="${3:-0}" -v to="${4:-1e9}" '
        NR == 1 { for (i = 1; i <= NF; i++) column[$i] = column[$i] ? column[$i] : i; next }
        $column["t_s"] >= from && $column["t_s"] < to { print $column["frame_ms"], $column["tolerance_drawn_px"] }' |
        sort -g | awk -v title="$2" '
        { ms[NR] = $1; over += $1 > 33.4; sum += $2; if ($2 > highest) highest = $2 }
        END {
            if (!NR) exit
            p99 = int(NR * 0.99)
            printf "%-24s %5d frames, ms median %5.1f, p99 %5.1f, max %5.1f, %3.0f %% over 33.4; ", title, NR, ms[int((NR + 1) / 2)], ms[p99 ? p99 : 1], ms[NR], 100 * over / NR
            printf "tolerance mean %.2f, highest %.2f px\n", sum / NR, highest
        }'
}

fine=(--tolerance-px 0.35)
dive | session held "${fine[@]}" --frame-ms 33
dive | session free "${fine[@]}" --frame-ms off
for _ in 1 2 3; do
    echo "keydown Left sleep 3 keyup Left sleep 0.5 key t key h sleep 0.5"
    echo "keydown Left sleep 3 keyup Left sleep 0.5 key t key h key i sleep 0.5"
    echo "keydown Left sleep 3 keyup Left sleep 0.5 key i sleep 0.5"
done | session panels --frame-ms off
echo "sleep 3 keydown plus sleep 5 keyup plus sleep 2" | session stall --frame-ms 33 --stall-secs 6,2

echo "$world, $size; the dive at 0.35 px, with --frame-ms 33 (held) and without (free):"
figures held "held"
figures free "free"
for second in $(seq 0 3 36); do
    figures held "held, from $second s" "$second" $((second + 3))
    figures free "free, from $second s" "$second" $((second + 3))
done
echo "the same turn, three times each:"
for turn in 0 12 24; do
    figures panels "status line" $((turn + 2)) $((turn + 4))
    figures panels "all panels" $((turn + 6)) $((turn + 8))
    figures panels "no panels" $((turn + 10)) $((turn + 12))
done
echo "zooming in while the store hangs for 2 s:"
# Reads hang from 6 s after the world was opened; frames count from the first one.
opened=$(sed -n 's/.*"first_frame_ms": \([0-9]*\).*/\1/p' "$out/stall/report.json")
at() { awk -v s="$1" -v ms="$opened" 'BEGIN { print s - ms / 1000 }'; }
figures stall "before" "$(at 4)" "$(at 6)"
figures stall "hanging" "$(at 6)" "$(at 8)"
figures stall "after" "$(at 8)" "$(at 10)"
for name in held free panels stall; do
    sed -n 's/.*"first_frame_ms": \([0-9]*\).*/first frame after \1 ms/p' "$out/$name/report.json"
done
