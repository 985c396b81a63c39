#!/usr/bin/env python3
"""What objects cost by distance, as VGIS's figs. 4 to 7: terrain alone, all objects without hierarchy, by cells, with groups.

    tools/cost-by-distance.py WORLD LON_DEG LAT_DEG [--from-m 40000] [--to-m 150] [--steps 12] [--pitch-deg -20]

Flies towards a place with each of the four modes of --objects (settled frames, 640x360), and prints a table of Markdown:
per distance the objects drawn, triangles, draw calls, and the median frame time of each mode in the same run, which takes
turns between the modes. Needs target/release/stoop, or the program that the variable STOOP names.
"""

import argparse
import csv
import json
import math
import os
import subprocess
import sys
import tempfile

MODES = ["off", "flat", "cells", "groups"]
# Frames at each distance; the first is left out of the median, as it brings pages in.
FRAMES = 7


def main():
    args = arguments()
    stoop = os.environ.get("STOOP", "target/release/stoop")
    steps = [args.from_m * (args.to_m / args.from_m) ** (at / (args.steps - 1)) for at in range(args.steps)]
    rows = {distance: {} for distance in steps}
    with tempfile.TemporaryDirectory() as folder:
        for distance in steps:
            path = os.path.join(folder, "path.json")
            with open(path, "w") as file:
                json.dump(way(args, distance), file)
            for mode in MODES:
                report = os.path.join(folder, "report.json")
                command = [stoop, "fly", args.world, "--path", path, "--settled", "--objects", mode, "--report", report]
                done = subprocess.run(command, capture_output=True, text=True)
                if done.returncode != 0:
                    sys.exit(f"{' '.join(command)}: {done.stderr.strip()}")
                rows[distance][mode] = measures(folder)
    table(rows)


def arguments():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("world")
    parser.add_argument("lon_deg", type=float)
    parser.add_argument("lat_deg", type=float)
    parser.add_argument("--from-m", type=float, default=40_000)
    parser.add_argument("--to-m", type=float, default=150)
    parser.add_argument("--steps", type=int, default=12)
    parser.add_argument("--pitch-deg", type=float, default=-20)
    return parser.parse_args()


def way(args, distance_m):
    """Stands south of the place and looks at it from a distance."""
    pitch = math.radians(args.pitch_deg)
    lat_deg = args.lat_deg - math.degrees(distance_m * math.cos(pitch) / 6.37e6)
    pose = [args.lon_deg, lat_deg, distance_m * math.sin(-pitch) + 50, 0, args.pitch_deg]
    columns = ["t_s", "lon_deg", "lat_deg", "height_m", "heading_deg", "pitch_deg"]
    ends = [[0.0] + pose, [(FRAMES - 1) / 60] + pose]
    return {"fovy_deg": 60, "hz": 60, "columns": columns, "samples": ends}


def measures(folder):
    def rows(name):
        with open(os.path.join(folder, name)) as file:
            return list(csv.DictReader(file))

    last = rows("frames.csv")[-1]
    times = sorted(float(row["frame_ms"]) for row in rows("timings.csv")[1:])
    counts = {key: int(float(last[key])) for key in ["objects_drawn", "triangles", "draw_calls", "cells_tested"]}
    return counts | {"frame_ms": times[len(times) // 2]}


def table(rows):
    print("| distance | objects: flat, cells, groups | triangles: off, flat, cells, groups | draw calls | frame ms |")
    print("|---|---|---|---|---|")
    for distance, modes in rows.items():
        counts = lambda key, which: " / ".join(f"{modes[mode][key]:,}" for mode in which)
        times = " / ".join(f"{modes[mode]['frame_ms']:.1f}" for mode in MODES)
        print(
            f"| {distance:,.0f} m | {counts('objects_drawn', MODES[1:])} | {counts('triangles', MODES)} |"
            f" {counts('draw_calls', MODES)} | {times} |"
        )


if __name__ == "__main__":
    main()
