#!/usr/bin/env python3
"""A city of any size: buildings in blocks between streets, as newline-delimited GeoJSON.

    tools/make-city.py [COUNT] [--seed N] [--at LON,LAT] > city.geojsonl

Streets form a grid that districts turn by their own angle; blocks hold two rows of lots back to back, with courts, L
shapes and gaps. Heights (metres, attribute `height`) fall with the distance from several centres, and vary; about one
building in five thousand is a landmark. The same arguments give the same bytes.
"""
import argparse
import math
import random
import sys

METRES_PER_DEG = 111_320.0
BLOCK_M = (170.0, 82.0)
STREET_M = 16.0
# Blocks along a district's side.
DISTRICT_BLOCKS = 8
# Lots in a block, about; with it the number of blocks is planned.
LOTS = 22


class City:
    def __init__(self, count, seed, lon_deg, lat_deg):
        self.draw = random.Random(seed)
        self.origin = (lon_deg, lat_deg)
        self.per_lon_m = METRES_PER_DEG * math.cos(math.radians(lat_deg))
        side = DISTRICT_BLOCKS * max(BLOCK_M[0], 2 * BLOCK_M[1]) * 1.35
        per_district = DISTRICT_BLOCKS * DISTRICT_BLOCKS * 2 * LOTS * 0.85
        self.side_m = side
        self.across = max(1, math.ceil(math.sqrt(count / per_district)))
        radius_m = self.across * side / 2
        self.centres = [(0.0, 0.0, 140.0, 0.12 * radius_m + 400)]
        for _ in range(5):
            place = [self.draw.uniform(-0.8, 0.8) * radius_m for _ in range(2)]
            self.centres.append((*place, self.draw.uniform(30, 80), self.draw.uniform(300, 1200)))

    def height_m(self, x, y):
        tall = sum(top * math.exp(-math.hypot(x - a, y - b) / reach) for a, b, top, reach in self.centres)
        return max(3.0, (5.0 + tall) * self.draw.lognormvariate(0.0, 0.35))

    def districts(self):
        """Middles of districts, the inner ones first."""
        half = (self.across - 1) / 2
        squares = [(x - half, y - half) for y in range(self.across + 2) for x in range(self.across + 2)]
        squares.sort(key=lambda square: (round(math.hypot(*square), 6), square))
        for x, y in squares:
            yield x * self.side_m, y * self.side_m

    def buildings(self):
        """Rings in metres, and heights."""
        for x, y in self.districts():
            turn = self.draw.uniform(-0.15, 0.15)
            cos, sin = math.cos(turn), math.sin(turn)
            for ring, landmark in self.district():
                placed = [(x + a * cos - b * sin, y + a * sin + b * cos) for a, b in ring]
                height = self.height_m(*placed[0])
                yield placed, height * self.draw.uniform(2.5, 5.0) + 40 if landmark else height

    def district(self):
        wide, deep = BLOCK_M
        rows = DISTRICT_BLOCKS * 2
        for row in range(rows):
            for column in range(DISTRICT_BLOCKS):
                west = (column - DISTRICT_BLOCKS / 2) * (wide + STREET_M)
                south = (row - rows / 2) * (deep + STREET_M)
                yield from self.block(west, south, wide, deep)

    def block(self, west, south, wide, deep):
        kind = self.draw.random()
        if kind < 0.05:
            return  # A park.
        if kind < 0.055:
            inset = self.draw.uniform(8, 20)
            yield box(west + inset, south + inset, wide - 2 * inset, deep - 2 * inset), True
            return
        for up in (0, 1):
            x = west
            while x < west + wide - 8:
                lot = min(self.draw.uniform(9, 24), west + wide - x)
                back = self.draw.uniform(0.55, 0.95) * deep / 2
                y = south if up == 0 else south + deep - back
                if self.draw.random() > 0.06:
                    yield self.house(x, y, lot * self.draw.uniform(0.85, 1.0), back), self.draw.random() < 0.0002
                x += lot

    def house(self, x, y, wide, deep):
        kind = self.draw.random()
        if kind < 0.65:
            return box(x, y, wide, deep)
        a, b = self.draw.uniform(0.4, 0.7) * wide, self.draw.uniform(0.4, 0.7) * deep
        if kind < 0.9:
            return [(x, y), (x + wide, y), (x + wide, y + b), (x + a, y + b), (x + a, y + deep), (x, y + deep)]
        c = 0.3 * wide
        return [(x, y), (x + wide, y), (x + wide, y + deep), (x + wide - c, y + deep), (x + wide - c, y + b),
                (x + c, y + b), (x + c, y + deep), (x, y + deep)]

    def line(self, number, ring, height_m):
        lon, lat = self.origin
        places = [f"[{lon + x / self.per_lon_m:.7f},{lat + y / METRES_PER_DEG:.7f}]" for x, y in ring]
        return (f'{{"type":"Feature","properties":{{"id":{number},"height":{height_m:.1f}}},"geometry":'
                f'{{"type":"Polygon","coordinates":[[{",".join(places + places[:1])}]]}}}}\n')


def box(x, y, wide, deep):
    return [(x, y), (x + wide, y), (x + wide, y + deep), (x, y + deep)]


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("count", nargs="?", type=int, default=1_000_000)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--at", metavar="LON,LAT", default="10.0,50.0", help="of the middle, degrees")
    args = parser.parse_args()
    city = City(args.count, args.seed, *(float(value) for value in args.at.split(",")))
    number = 0
    for number, (ring, height_m) in enumerate(city.buildings(), 1):
        sys.stdout.write(city.line(number, ring, height_m))
        if number == args.count:
            return
    raise SystemExit(f"only {number} buildings came out")


if __name__ == "__main__":
    main()
