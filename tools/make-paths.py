#!/usr/bin/env python3
"""Makes tiles/default/helsinki.json and golden-gate.json: a dive from 10,000 km in 30 s, log height against time, and
20 s at the destination. Heights follow the default world's ground, asked of `stoop probe`.

Usage: tools/make-paths.py STOOP_BINARY [WORLD]
"""
import bisect
import json
import math
import pathlib
import subprocess
import sys
import tempfile

HZ, DIVE_S, STAY_S = 60, 30.0, 20.0
TOP_M = 1.0e7

FLIGHTS = {
    # From over Senate Square west along Aleksanterinkatu at 10 m, then up over the roofs.
    "helsinki": {
        "route": [(24.95290, 60.16908), (24.95102, 60.16903), (24.94933, 60.16899), (24.94589, 60.16890),
                  (24.94290, 60.16884)],
        "end_above_m": 10.0, "end_pitch_deg": -2.0, "heading_deg": 270.0, "late_above_m": 60.0,
    },
    # Over the Marin Headlands, with the strait and San Francisco ahead.
    "golden-gate": {
        "route": [(-122.5350, 37.8640), (-122.5200, 37.8520), (-122.5050, 37.8400), (-122.4900, 37.8280)],
        "end_above_m": 700.0, "end_pitch_deg": -14.0, "heading_deg": 135.0, "late_above_m": 500.0,
    },
}


def smooth(x):
    x = min(1.0, max(0.0, x))
    return x * x * (3 - 2 * x)


def along(route, fraction):
    """The place at a fraction of a polyline's length."""
    lengths = [0.0]
    for (x0, y0), (x1, y1) in zip(route, route[1:]):
        lengths.append(lengths[-1] + math.hypot((x1 - x0) * math.cos(math.radians(y0)), y1 - y0))
    at = fraction * lengths[-1]
    leg = min(max(bisect.bisect_right(lengths, at) - 1, 0), len(route) - 2)
    part = (at - lengths[leg]) / (lengths[leg + 1] - lengths[leg])
    (x0, y0), (x1, y1) = route[leg], route[leg + 1]
    return x0 + (x1 - x0) * part, y0 + (y1 - y0) * part


def poses(flight):
    """(t, lon, lat, metres above ground, heading, pitch) of every sample."""
    lon0, lat0 = flight["route"][0]
    for n in range(int((DIVE_S + STAY_S) * HZ) + 1):
        t = n / HZ
        if t <= DIVE_S:
            part = t / DIVE_S
            above = TOP_M * (flight["end_above_m"] / TOP_M) ** part
            tilt = smooth((t - 9.0) / (DIVE_S - 9.0))
            pitch = -90.0 + tilt * (90.0 + flight["end_pitch_deg"])
            turned = ((flight["heading_deg"] + 180.0) % 360.0 - 180.0) * smooth((t - 10.0) / 14.0)
            # Stay behind the place that comes into the middle of the picture, at most three heights and 30 km.
            behind_m = min(above / math.tan(math.radians(max(-pitch, 1.0))), 3 * above, 3.0e4)
            behind_m *= 1.0 - smooth((t - 26.0) / 4.0)
            heading = math.radians(turned)
            lat = lat0 - math.degrees(behind_m * math.cos(heading) / 6.371e6)
            lon = lon0 - math.degrees(behind_m * math.sin(heading) / 6.371e6) / math.cos(math.radians(lat0))
            yield t, lon, lat, above, turned % 360.0, pitch
        else:
            part = (t - DIVE_S) / STAY_S
            lon, lat = along(flight["route"], smooth(part))
            rise = smooth((part - 0.35) / 0.3)
            above = flight["end_above_m"] + rise * (flight["late_above_m"] - flight["end_above_m"])
            pitch = flight["end_pitch_deg"] - 10.0 * rise
            yield t, lon, lat, above, flight["heading_deg"] + 25.0 * math.sin(2 * math.pi * part), pitch


def grounds(binary, world, places):
    """Height of the ground above the ellipsoid at each place, metres."""
    with tempfile.NamedTemporaryFile("w", suffix=".csv") as points:
        points.write("lon_deg,lat_deg\n" + "".join(f"{lon:.9f},{lat:.9f}\n" for lon, lat in places))
        points.flush()
        printed = subprocess.run([binary, "probe", world, "--points", points.name, "--json"], check=True,
                                 capture_output=True, text=True).stdout
    return [place["ground_m"] for place in json.loads(printed)]


def main():
    if len(sys.argv) < 2:
        sys.exit(__doc__)
    binary = str(pathlib.Path(sys.argv[1]).resolve())
    root = pathlib.Path(__file__).resolve().parent.parent
    world = sys.argv[2] if len(sys.argv) > 2 else str(root / "tiles/default/world")
    for name, flight in FLIGHTS.items():
        samples = list(poses(flight))
        ground = grounds(binary, world, [(lon, lat) for _, lon, lat, *_ in samples])
        if None in ground:
            sys.exit(f"{world} has no terrain under the flight {name}")
        rows = [[round(t, 4), round(lon, 8), round(lat, 8), round(g + above, 3), round(heading % 360.0, 4),
                 round(pitch, 4), round(above, 3)]
                for (t, lon, lat, above, heading, pitch), g in zip(samples, ground)]
        path = {"fovy_deg": 60, "hz": HZ, "arrivals_s": [DIVE_S],
                "columns": ["t_s", "lon_deg", "lat_deg", "height_m", "heading_deg", "pitch_deg", "above_ground_m"],
                "samples": rows}
        with open(root / f"tiles/default/{name}.json", "w") as file:
            json.dump(path, file, separators=(",", ":"))
            file.write("\n")


main()
