#!/usr/bin/env python3
"""Places for copies of a collection, spread over the whole Earth: a table for `copies` of a recipe.

    tools/make-copies.py [COUNT] [--seed N] [--first LON,LAT] [--apart-deg D] > places.csv

Places are drawn by area at random and kept where they are at least D degrees from all others (and 4° from the poles'
own ring of 4°), each with a heading of its own. The first one can be given; it is not turned.
"""
import argparse
import math
import random


def apart_deg(a, b):
    """Angle between two places (longitude, latitude), degrees."""
    (lon_a, lat_a), (lon_b, lat_b) = (map(math.radians, place) for place in (a, b))
    half = math.sin((lat_b - lat_a) / 2) ** 2
    half += math.cos(lat_a) * math.cos(lat_b) * math.sin((lon_b - lon_a) / 2) ** 2
    return math.degrees(2 * math.asin(min(1.0, math.sqrt(half))))


def places(count, seed, first, least_deg):
    """Longitude, latitude and heading of each place."""
    draw = random.Random(seed)
    made = [(*first, 0.0)] if first else []
    tries = 0
    while len(made) < count:
        tries += 1
        if tries > 1000 * count:
            raise SystemExit(f"no room for {count} places {least_deg} degrees apart: give a smaller --apart-deg")
        lon = draw.uniform(-180.0, 180.0)
        lat = math.degrees(math.asin(draw.uniform(-1.0, 1.0)))
        if abs(lat) < 86.0 and all(apart_deg((lon, lat), other[:2]) >= least_deg for other in made):
            made.append((lon, lat, draw.uniform(0.0, 360.0)))
    return made


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("count", nargs="?", type=int, default=500)
    parser.add_argument("--seed", type=int, default=5)
    parser.add_argument("--first", metavar="LON,LAT", help="degrees")
    parser.add_argument("--apart-deg", type=float, default=2.0)
    args = parser.parse_args()
    first = tuple(float(value) for value in args.first.split(",")) if args.first else None
    print("lon_deg,lat_deg,heading_deg")
    for place in places(args.count, args.seed, first, args.apart_deg):
        print(",".join(f"{value:.6f}" for value in place))


if __name__ == "__main__":
    main()
