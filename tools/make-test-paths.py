#!/usr/bin/env python3
"""Makes tests/paths/*.json: the flights that paging policies are compared on, through the world of
tests/recipes/dive-california-sf.toml. Heights follow that world's ground, asked of `stoop probe`; a flight that comes too
near to the ground or into a building is an error. The same world gives the same files.

Usage: tools/make-test-paths.py STOOP_BINARY WORLD [NAME…]
"""
import bisect
import json
import math
import pathlib
import random
import subprocess
import sys
import tempfile
from collections import namedtuple

HZ = 60
TOP_M, STREET_M = 1.0e7, 10.0
# A jump takes this long, so that no frame falls into it.
JUMP_S = 0.001
# The ground is asked for this often, finished flights are looked at that often.
GROUND_HZ, CHECK_HZ = 10, 20
# Samples are left out where the straight line between their neighbours is as near as this.
THIN_SHARE_OF_HEIGHT, THIN_M, THIN_DEG = 1e-4, 0.002, 0.01
LONGEST_CHORD, LARGEST_TURN_DEG = 600, 90.0
# Buildings are looked for under this height above ground, and this far beside the eye.
BUILDINGS_BELOW_M, BESIDE_M = 400.0, 1.5
LARGEST_FILE_BYTES = 200_000
WALK_SEED = 27

# One instant of a flight: seconds, degrees, metres above what it flies over, degrees (headings do not wrap).
Moment = namedtuple("Moment", "t lon lat above heading pitch")
# `legs` are lists of moments with a jump between each two; `ease_s` is how long before a rise the eye begins to rise;
# until `level_s` heights count from the ground of that time, so that a dive of any length goes the same way.
Flight = namedtuple("Flight", "legs ease_s least_above_m arrivals over_roofs level_s", defaults=(False, None))


# Places.

def degrees_per_metre(lat):
    """(longitude, latitude) on WGS84: its prime vertical and meridian radii."""
    a, e2 = 6378137.0, 6.69437999014e-3
    w2 = 1.0 - e2 * math.sin(math.radians(lat)) ** 2
    east = a / math.sqrt(w2) * math.cos(math.radians(lat))
    return math.degrees(1.0 / east), math.degrees(w2 ** 1.5 / (a * (1.0 - e2)))


def moved(lon, lat, east_m, north_m):
    per_east, per_north = degrees_per_metre(lat)
    return lon + east_m * per_east, lat + north_m * per_north


def ahead(lon, lat, heading, way_m):
    """The place `way_m` ahead; good for short ways."""
    return moved(lon, lat, way_m * math.sin(math.radians(heading)), way_m * math.cos(math.radians(heading)))


def course(lon, lat, to_lon, to_lat):
    """(bearing in degrees, metres) along the great circle."""
    a, b, turn = math.radians(lat), math.radians(to_lat), math.radians(to_lon - lon)
    east = math.sin(turn) * math.cos(b)
    north = math.cos(a) * math.sin(b) - math.sin(a) * math.cos(b) * math.cos(turn)
    up = math.sin(a) * math.sin(b) + math.cos(a) * math.cos(b) * math.cos(turn)
    return math.degrees(math.atan2(east, north)), 6.371e6 * math.atan2(math.hypot(east, north), up)


class Grid:
    """A city's streets: metres along and across them from a crossing."""

    def __init__(self, lon, lat, left_deg):
        self.lon, self.lat, self.left_deg = lon, lat, left_deg

    def place(self, across_m, along_m):
        c, s = math.cos(math.radians(self.left_deg)), math.sin(math.radians(self.left_deg))
        return moved(self.lon, self.lat, across_m * c - along_m * s, across_m * s + along_m * c)

    def heading(self, heading):
        return heading - self.left_deg


# The 20,000 buildings stand in blocks along the compass; this crossing is where the dive goes.
ATLANTA = Grid(-84.39, 33.755, 0.0)
# San Francisco north of Market Street: turned to the left. The origin is in a block on Russian Hill.
SAN_FRANCISCO = Grid(-122.42, 37.80, 9.1)
VAN_NESS_M = -370.5


# Motion.

def smooth(x):
    x = min(1.0, max(0.0, x))
    return x * x * (3.0 - 2.0 * x)


def ticks(seconds):
    return [n / HZ for n in range(round(seconds * HZ) + 1)]


def shifted(leg, by_s):
    return [moment._replace(t=moment.t + by_s) for moment in leg]


def joined(first, second):
    """The second leg goes on where the first ends."""
    return first + shifted(second, first[-1].t)[1:]


def rest(moment, seconds):
    return [moment._replace(t=t) for t in ticks(seconds)]


def dive(seconds):
    """Straight down at an even rate of log height; from a third of the time on the view rises to the street's far end,
    while the crossing stays in the middle of the picture."""
    leg = []
    for t in ticks(seconds):
        above = TOP_M * (STREET_M / TOP_M) ** (t / seconds)
        pitch = -90.0 + 88.0 * smooth((t / seconds - 1.0 / 3.0) * 1.5)
        lon, lat = ATLANTA.place(0.0, -above / math.tan(math.radians(-pitch)))
        leg.append(Moment(t, lon, lat, above, 0.0, pitch))
    return leg


def over_the_street(start, seconds=20.0, way_m=700.0):
    """North along the street from where a dive ends: up to the roofs, looking to both sides, and down again."""
    leg = []
    for t in ticks(seconds):
        part = t / seconds
        lon, lat = moved(start.lon, start.lat, 0.0, way_m * smooth(part))
        rise = smooth(part / 0.35) - smooth((part - 0.7) / 0.3)
        heading = 50.0 * math.sin(2.0 * math.pi * part) * smooth(part / 0.1)
        leg.append(Moment(t, lon, lat, STREET_M + 35.0 * rise, heading, -2.0 - 8.0 * rise))
    return leg


class Route:
    """Straight streets through crossings, rounded by arcs: place, and limit of speed, at each way from its start."""
    STEP_M = 0.05

    def __init__(self, crossings, radius_m, speed, corner_speed):
        self.points, self.limits = [], []
        here = crossings[0]
        for corner, after in zip(crossings[1:], crossings[2:]):
            into, out = unit(here, corner), unit(corner, after)
            self.straight(here, along(corner, into, -radius_m), speed)
            self.arc(corner, into, out, radius_m, corner_speed)
            here = along(corner, out, radius_m)
        self.straight(here, crossings[-1], speed)

    def straight(self, a, b, speed):
        count = round(math.dist(a, b) / self.STEP_M)
        self.add([along(a, unit(a, b), n * self.STEP_M) for n in range(count)], speed)

    def arc(self, corner, into, out, radius_m, speed):
        count = round(math.pi / 2.0 * radius_m / self.STEP_M)
        center = along(along(corner, into, -radius_m), out, radius_m)
        angles = [math.pi / 2.0 * n / count for n in range(count)]
        self.add([along(along(center, into, radius_m * math.sin(a)), out, -radius_m * math.cos(a)) for a in angles], speed)

    def add(self, points, speed):
        self.points += points
        self.limits += [speed] * len(points)

    def at(self, way_m):
        index = min(way_m / self.STEP_M, len(self.points) - 1.001)
        a, b = self.points[int(index)], self.points[int(index) + 1]
        return along(a, (b[0] - a[0], b[1] - a[1]), index - int(index))

    def speeds(self, acceleration):
        """Limits that slow down before a corner and speed up after it."""
        speeds = list(self.limits)
        for order in (range(1, len(speeds)), range(len(speeds) - 2, -1, -1)):
            for n in order:
                before = speeds[n - 1 if order.step > 0 else n + 1]
                speeds[n] = min(speeds[n], math.sqrt(before ** 2 + 2.0 * acceleration * self.STEP_M))
        return speeds


def unit(a, b):
    way = math.dist(a, b)
    return (b[0] - a[0]) / way, (b[1] - a[1]) / way


def along(point, direction, way_m):
    return point[0] + direction[0] * way_m, point[1] + direction[1] * way_m


def drive(grid, route, seconds, eye_m, look_m, acceleration):
    """A flight along a route, looking `look_m` ahead, the eye between two heights above ground."""
    speeds = route.speeds(acceleration)
    leg, way_m = [], 0.0
    for t in ticks(seconds):
        here, there = route.at(way_m), route.at(way_m + look_m)
        heading = grid.heading(math.degrees(math.atan2(there[0] - here[0], there[1] - here[1])))
        above = eye_m[0] + (eye_m[1] - eye_m[0]) * math.sin(math.pi * t / 30.0) ** 2
        leg.append(Moment(t, *grid.place(*here), above, heading, -3.0))
        way_m += speeds[min(int(way_m / route.STEP_M), len(speeds) - 1)] / HZ
    if way_m + look_m > len(route.points) * route.STEP_M:
        sys.exit("a route is too short for its flight")
    return unwrapped(leg)


def unwrapped(leg):
    """Headings go on over 180 degrees instead of jumping."""
    out = leg[:1]
    for moment in leg[1:]:
        turn = (moment.heading - out[-1].heading + 180.0) % 360.0 - 180.0
        out.append(moment._replace(heading=out[-1].heading + turn))
    return out


# Seconds and degrees per second; adds up to 13 s.
PANS = [(1.0, 0), (1.0, 90), (0.5, 0), (2.0, -180), (0.5, 0), (1.0, 360), (1.0, -360), (1.0, 0), (2.0, 270), (1.0, -90),
        (2.0, 0)]


def pans(lon, lat, above, heading, pitch, nod_deg, mirror, seconds):
    """Standing and looking around; the view nods as it turns, and is still where it does not."""
    rates = [mirror * rate for span, rate in PANS for _ in range(round(span * HZ))]
    rates += [0.0] * (round(seconds * HZ) - len(rates))
    # A hand takes a fifth of a second to change its mind.
    rates = moving(rates, HZ // 10, lambda window: sum(window) / len(window))
    leg, turned = [], 0.0
    for t, rate in zip(ticks(seconds), rates + [0.0]):
        nod = nod_deg * math.sin(math.radians(turned))
        leg.append(Moment(t, lon, lat, above, heading + turned, pitch + nod))
        turned += rate / HZ
    return leg


def stay(grid, across_m, along_m, above, heading, pitch, seconds=4.0):
    """A slow drift and turn at a place a jump leads to, until just before the next."""
    lon, lat = grid.place(across_m, along_m)
    leg = []
    for t in ticks(seconds)[:-1] + [seconds - JUMP_S]:
        now = ahead(lon, lat, grid.heading(heading), 0.03 * above * t)
        leg.append(Moment(t, *now, above, grid.heading(heading) + 2.0 * t, pitch))
    return leg


def jumps(legs, seconds):
    """Legs of a length each, one after the other; the times of the jumps."""
    out, start_s, times = [], 0.0, []
    for leg, span in zip(legs, seconds):
        out.append(shifted([moment for moment in leg if moment.t < span - JUMP_S / 2], start_s))
        start_s += span
        times.append(start_s)
        if out[-1][-1].t < start_s - JUMP_S * 1.5:
            out[-1].append(leg[-1]._replace(t=start_s - JUMP_S))
    out[-1].append(out[-1][-1]._replace(t=start_s))
    return out, times[:-1]


def sail(lon, lat, above, seconds, speed, heading_at, pitch):
    """At an even speed over land along a winding course."""
    leg = []
    for t in ticks(seconds):
        leg.append(Moment(t, lon, lat, above, heading_at(t), pitch))
        lon, lat = ahead(lon, lat, heading_at(t), speed / HZ)
    return leg


class Walk:
    """Free flight as by hand: rates go towards random aims that change every second or three; far from where it is to
    be it turns there, climbs as high as the way is long, and flies on."""
    LOWEST_M, HIGHEST_M = 20.0, 2.0e6
    # Until when, around what longitude and latitude, and how far.
    HOMES = [(26.0, -84.39, 33.755, 6.0e4), (1e9, -119.6, 37.1, 1.5e5)]

    def __init__(self, seed):
        self.random = random.Random(seed)
        self.lon, self.lat, self.log_m, self.heading, self.pitch = -84.40, 33.72, math.log(800.0), 10.0, -30.0
        self.turn = self.climb = self.speed = 0.0
        self.next_s = 0.0

    def pick(self, t):
        if t >= self.next_s:
            self.next_s = t + self.random.uniform(1.0, 3.0)
            # Things to see lie low: more often down than up.
            self.aims = [self.random.uniform(-60.0, 60.0), self.random.uniform(-1.5, 0.9), self.random.uniform(-0.1, 0.8)]
            self.glance = self.random.uniform(-12.0, 12.0)
        return self.aims

    def aim(self, t):
        """Aims of turn (deg/s), climb (ln m per s) and speed (heights/s)."""
        turn, climb, speed = self.pick(t)
        _, lon, lat, reach_m = next(home for home in self.HOMES if t < home[0])
        bearing, way_m = course(self.lon, self.lat, lon, lat)
        if way_m > reach_m + math.exp(self.log_m):
            off = (bearing - self.heading + 180.0) % 360.0 - 180.0
            turn, climb = max(-70.0, min(70.0, 1.5 * off)), max(-1.2, min(1.6, math.log(way_m / 1.5) - self.log_m))
            speed = 0.8 * max(0.0, math.cos(math.radians(off)))
        low, high = math.log(self.LOWEST_M * 1.1) - self.log_m, math.log(self.HIGHEST_M / 1.1) - self.log_m
        return turn, max(low, min(high, climb)), speed

    def step(self, t):
        turn, climb, speed = self.aim(t)
        easing = 1.0 / (0.5 * HZ)
        self.turn += (turn - self.turn) * easing
        self.climb += (climb - self.climb) * easing
        self.speed += (speed - self.speed) * easing
        share = min(1.0, max(0.0, math.log10(math.exp(self.log_m) / 300.0) / 3.5))
        self.pitch += (-14.0 - 58.0 * share + self.glance - self.pitch) * easing
        self.lon, self.lat = ahead(self.lon, self.lat, self.heading, self.speed * math.exp(self.log_m) / HZ)
        self.heading += self.turn / HZ
        self.log_m = max(math.log(self.LOWEST_M), min(math.log(self.HIGHEST_M), self.log_m + self.climb / HZ))

    def leg(self, seconds):
        leg = []
        for t in ticks(seconds):
            leg.append(Moment(t, self.lon, self.lat, math.exp(self.log_m), self.heading, self.pitch))
            self.step(t)
        return leg


# The flights.

def dive_and_street():
    down = dive(30.0)
    return Flight([joined(down, over_the_street(down[-1]))], 0.3, 9.0, [30.0], level_s=30.0)


def dive_and_rest(seconds):
    down = dive(seconds)
    return Flight([joined(down, rest(down[-1], 5.0))], 0.0, 9.0, [seconds], level_s=seconds)


def street_2():
    route = Route([(0.0, 40.0), (0.0, 114.8), (96.8, 114.8), (96.8, 215.9)], 12.0, 2.0, 1.5)
    return Flight([drive(ATLANTA, route, 60.0, (2.0, 5.0), 6.0, 0.5)], 1.0, 1.9, [])


def street_20():
    crossings = [(0.0, -250.0), (0.0, 215.9), (190.6, 215.9), (190.6, 488.6), (490.9, 488.6), (490.9, 900.0)]
    route = Route(crossings, 24.0, 20.0, 10.0)
    return Flight([drive(ATLANTA, route, 60.0, (2.0, 8.5), 15.0, 4.0)], 0.7, 1.9, [])


def sf_street():
    route = Route([(-320.0, 213.2), (68.3, 213.2), (68.3, 318.0), (215.1, 318.0), (215.1, 600.0)], 15.0, 15.0, 7.0)
    return Flight([drive(SAN_FRANCISCO, route, 40.0, (3.0, 8.0), 12.0, 3.0)], 0.7, 2.5, [])


def look_around():
    street = pans(*ATLANTA.place(0.0, -120.0), 5.0, 0.0, 2.0, 8.0, 1.0, 13.0)
    roofs = pans(*ATLANTA.place(-600.0, -500.0), 300.0, 45.0, -20.0, 12.0, -1.0, 13.0)
    sierra = pans(-118.60, 36.70, 3000.0, 80.0, -12.0, 10.0, 1.0, 14.0)
    legs, arrivals = jumps([street, roofs, sierra], [13.0, 13.0, 14.0])
    return Flight(legs, 0.0, 4.9, arrivals)


def teleports():
    stays = [
        stay(ATLANTA, 0.0, -200.0, 10.0, 0.0, -2.0),
        stay(SAN_FRANCISCO, 0.0, 0.0, 100_000.0, 90.0, -60.0),
        stay(ATLANTA, -700.0, -800.0, 1000.0, 45.0, -35.0),
        stay(SAN_FRANCISCO, VAN_NESS_M, -200.0, 30.0, 0.0, -8.0),
        stay(ATLANTA, 0.0, 0.0, 100_000.0, 0.0, -90.0),
        stay(SAN_FRANCISCO, VAN_NESS_M, 200.0, 10.0, 180.0, -1.0),
        stay(ATLANTA, 5000.0, 0.0, 10_000.0, 270.0, -45.0),
        stay(SAN_FRANCISCO, -900.0, 0.0, 300.0, 80.0, -15.0),
        stay(ATLANTA, 190.6, 300.0, 30.0, 0.0, -6.0),
        stay(SAN_FRANCISCO, 0.0, -4000.0, 3000.0, 0.0, -25.0),
    ]
    legs, arrivals = jumps(stays, [4.0] * len(stays))
    return Flight(legs, 0.0, 9.9, arrivals)


def random_walk():
    return Flight([Walk(WALK_SEED).leg(60.0)], 1.5, 18.0, [], over_roofs=True)


def sierra():
    # North along the canyon of the Kern, Mount Whitney to the right.
    leg = sail(-118.42, 36.48, 500.0, 60.0, 300.0, lambda t: 345.0 + 40.0 * math.sin(2.0 * math.pi * t / 30.0), -9.0)
    return Flight([leg], 1.5, 490.0, [])


FLIGHTS = {
    "dive": dive_and_street,
    "dive-10s": lambda: dive_and_rest(10.0),
    "dive-3s": lambda: dive_and_rest(3.0),
    "street-2": street_2,
    "street-20": street_20,
    "look-around": look_around,
    "teleports": teleports,
    "random-walk": random_walk,
    "sf-street": sf_street,
    "sierra": sierra,
}


# Ground and buildings.

def probed(world, places):
    """What `stoop probe` says of places, one by one."""
    with tempfile.NamedTemporaryFile("w", suffix=".csv") as points:
        points.write("lon_deg,lat_deg\n" + "".join(f"{lon:.9f},{lat:.9f}\n" for lon, lat in places))
        points.flush()
        command = [world[0], "probe", world[1], "--points", points.name, "--json"]
        printed = subprocess.run(command, check=True, capture_output=True, text=True).stdout
    answers = json.loads(printed)
    if any(answer["ground_m"] is None for answer in answers):
        sys.exit(f"{world[1]} has no terrain under a flight")
    return answers


def surface_m(answer, over_roofs):
    roofs = [item["top_m"] for item in answer["objects"]] if over_roofs else []
    return max([answer["ground_m"], *roofs])


def moving(values, reach, of):
    """`of` the values up to `reach` before and after each."""
    return [of(values[max(0, n - reach):n + reach + 1]) for n in range(len(values))]


def with_heights(world, leg, flight):
    """The leg with heights above the ellipsoid in place of those above ground. The mean of the highest around is never
    below what it flies over."""
    asked = leg[::HZ // GROUND_HZ] + leg[-1:]
    surfaces = [surface_m(answer, flight.over_roofs) for answer in probed(world, [(m.lon, m.lat) for m in asked])]
    times = [moment.t for moment in asked]
    if flight.level_s is not None:
        level_m = between(times, surfaces, flight.level_s)
        surfaces = [level_m if t <= flight.level_s else surface for t, surface in zip(times, surfaces)]
    reach = math.ceil(flight.ease_s * GROUND_HZ)
    eased = moving(moving(surfaces, reach, max), reach, lambda window: sum(window) / len(window))
    return [(moment, moment.above + between(times, eased, moment.t)) for moment in leg]


def between(times, values, t):
    at = min(max(bisect.bisect_right(times, t) - 1, 0), len(times) - 2)
    span = times[at + 1] - times[at]
    share = (t - times[at]) / span if span > 0.0 else 0.0
    return values[at] + (values[at + 1] - values[at]) * share


# Files.

def as_row(moment, height_m):
    return [moment.t, moment.lon, moment.lat, height_m, moment.heading, moment.pitch]


def lies_between(a, row, b, above_m):
    share = (row[0] - a[0]) / (b[0] - a[0])
    off = [abs(value - (x + (y - x) * share)) for x, value, y in zip(a, row, b)]
    near_m = max(THIN_M, THIN_SHARE_OF_HEIGHT * above_m)
    per_east, per_north = degrees_per_metre(row[2])
    return off[1] < near_m * per_east and off[2] < near_m * per_north and off[3] < near_m and max(off[4:]) < THIN_DEG


def thinned(leg):
    """Without the samples that a straight line between others gives as well."""
    rows, above = [as_row(*pair) for pair in leg], [moment.above for moment, _ in leg]
    kept, start = [rows[0]], 0
    while start < len(rows) - 1:
        end = start + 1
        while end + 1 < len(rows) and may_reach(rows, above, start, end + 1):
            end += 1
        kept.append(rows[end])
        start = end
    return kept


def may_reach(rows, above, start, end):
    a, b = rows[start], rows[end]
    if end - start > LONGEST_CHORD or abs(b[4] - a[4]) > LARGEST_TURN_DEG:
        return False
    return all(lies_between(a, rows[n], b, above[n]) for n in range(start + 1, end))


def rounded(row):
    t, lon, lat, height_m, heading, pitch = row
    return [round(t, 5), round(lon, 8), round(lat, 8), round(height_m, 3), round(heading % 360.0, 3) % 360.0, round(pitch, 3)]


def as_json(rows, arrivals):
    columns = ["t_s", "lon_deg", "lat_deg", "height_m", "heading_deg", "pitch_deg"]
    head = {"fovy_deg": 60, "hz": HZ, "columns": columns}
    if arrivals:
        head["arrivals_s"] = arrivals
    lines = ",\n".join(json.dumps(row, separators=(",", ":")) for row in rows)
    return json.dumps(head)[:-1] + ',"samples": [\n' + lines + "\n]}\n"


# The check of what was made.

def eyes(rows):
    """(lon, lat, height) often along the finished flight, not within jumps."""
    out = []
    for a, b in zip(rows, rows[1:]):
        count = 1 if b[0] - a[0] < 2.0 * JUMP_S else max(1, round((b[0] - a[0]) * CHECK_HZ))
        out += [tuple(a[k] + (b[k] - a[k]) * n / count for k in (1, 2, 3)) for n in range(count)]
    return out + [tuple(rows[-1][1:4])]


def around(lon, lat):
    return [moved(lon, lat, east, north) for east, north in ((BESIDE_M, 0), (-BESIDE_M, 0), (0, BESIDE_M), (0, -BESIDE_M))]


def check(world, name, rows, flight):
    """(least, greatest) height above ground; ends the program where the flight is not free."""
    places = eyes(rows)
    answers = probed(world, [place[:2] for place in places])
    above = [place[2] - answer["ground_m"] for place, answer in zip(places, answers)]
    if min(above) < flight.least_above_m:
        sys.exit(f"{name}: only {min(above):.2f} m above ground at {places[above.index(min(above))]}")
    low = [place for place, above_m in zip(places, above) if above_m < BUILDINGS_BELOW_M]
    near = [(spot, place[2]) for place in dict.fromkeys(low) for spot in [place[:2], *around(*place[:2])]]
    for (spot, height_m), answer in zip(near, probed(world, [spot for spot, _ in near]) if near else []):
        if any(item["top_m"] > height_m - BESIDE_M for item in answer["objects"]):
            sys.exit(f"{name}: in or at a building at {spot}, height {height_m:.2f} m: {answer['objects']}")
    return min(above), max(above)


def make(world, folder, name):
    flight = FLIGHTS[name]()
    legs = [thinned(with_heights(world, leg, flight)) for leg in flight.legs]
    rows = [rounded(row) for leg in legs for row in leg]
    least, greatest = check(world, name, rows, flight)
    text = as_json(rows, flight.arrivals)
    if len(text) > LARGEST_FILE_BYTES:
        sys.exit(f"{name}: {len(text)} bytes are too many")
    (folder / f"{name}.json").write_text(text)
    print(f"{name}: {rows[-1][0]:g} s, {len(rows)} samples, {len(text)} bytes, {least:.1f} to {greatest:.0f} m above ground",
          flush=True)


def main():
    if len(sys.argv) < 3:
        sys.exit(__doc__)
    world = [str(pathlib.Path(sys.argv[1]).resolve()), sys.argv[2]]
    folder = pathlib.Path(__file__).resolve().parent.parent / "tests/paths"
    folder.mkdir(exist_ok=True)
    for name in sys.argv[3:] or FLIGHTS:
        if name not in FLIGHTS:
            sys.exit(f"there is no flight {name!r}; there are {', '.join(FLIGHTS)}")
        make(world, folder, name)


if __name__ == "__main__":
    main()
