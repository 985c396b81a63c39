//! Observer cells, and the shortest paths over them (Funkhouser 1996, §4.1).

use crate::forest::{CellId, LEVEL_MAX};
use crate::geodesy::{GeoBounds, Geodetic, meridian_radius_m};
use std::collections::{BTreeSet, HashMap};
use std::f64::consts::{LN_2, PI, TAU};

/// The highest octave, from 2²⁵ m to twice that: no eye is higher than 40,000 km.
const OCTAVE_MAX: u8 = 25;

/// A cell of the ground and an octave of the height above it: heights from 2^octave metres to twice that. Its side is about
/// the height, as far as there are cells as large: 45° / 2^level is 2^(22.26 − level) metres.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct ObserverCell {
    pub octave: u8,
    pub place: CellId,
}

/// An eye, with its height above the ground in metres.
#[derive(Clone, Copy, Debug)]
pub struct Eye {
    pub place: Geodetic,
    pub above_m: f64,
}

impl Eye {
    /// Height of the ground below the eye, metres.
    pub fn ground_m(&self) -> f64 {
        self.place.height_m - self.above_m
    }
}

/// How far an observer comes in a frame; 0 and more.
#[derive(Clone, Copy, Debug)]
pub struct Speeds {
    /// Over the ground, in heights above it.
    pub heights: f64,
    /// Of the logarithm of the height above the ground.
    pub log_height: f64,
    pub turn_rad: f64,
}

impl Speeds {
    /// Frames for a way; both parts are gone at the same time.
    fn frames(&self, over_ground_heights: f64, log_height: f64) -> f64 {
        let frames = |way: f64, speed: f64| if way > 0.0 { way / speed } else { 0.0 };
        frames(over_ground_heights, self.heights).max(frames(log_height, self.log_height))
    }
}

impl ObserverCell {
    pub fn around(eye: &Eye) -> Self {
        let octave = (eye.above_m.max(1.0).log2() as u8).min(OCTAVE_MAX);
        Self { octave, place: CellId::containing(eye.place.lat_rad, eye.place.lon_rad, level(octave)) }
    }

    /// Height above the ground in the middle of the octave, metres.
    pub fn above_m(&self) -> f64 {
        f64::from(1u32 << self.octave) * std::f64::consts::SQRT_2
    }

    /// The eight beside it (more or fewer where rows are thinned), those above and those below.
    fn neighbors(self) -> impl Iterator<Item = Self> {
        let beside = self.place.neighbors().into_iter().map(move |place| Self { place, ..self });
        let above = (self.octave < OCTAVE_MAX)
            .then(|| self.octave + 1)
            .and_then(|octave| Some(Self { octave, place: self.place.ancestor(level(octave))? }));
        let down = self.octave.checked_sub(1);
        let children = down.filter(|&octave| level(octave) > self.place.level());
        let same = down.filter(|&octave| level(octave) == self.place.level());
        let below = children
            .into_iter()
            .flat_map(move |octave| self.place.children().map(move |place| Self { octave, place }))
            .chain(same.map(|octave| Self { octave, place: self.place }));
        beside.chain(above).chain(below)
    }

    /// Frames from an eye into a neighbour of its cell: to the border between them.
    fn frames_from_eye(&self, eye: &Eye, speeds: &Speeds) -> f64 {
        let own = Self::around(eye).octave;
        let to_octave = match self.octave.cmp(&own) {
            std::cmp::Ordering::Greater => f64::from(1u32 << self.octave) / eye.above_m,
            std::cmp::Ordering::Less => eye.above_m / f64::from(1u32 << (self.octave + 1)),
            std::cmp::Ordering::Equal => 1.0,
        };
        let over_ground_m = distance_to_m(&self.place.bounds(), eye.place);
        speeds.frames(over_ground_m / eye.above_m, to_octave.ln())
    }

    /// Frames from one cell into a neighbour: from middle to middle, which is what crossing it takes.
    fn frames_to(&self, next: &Self, speeds: &Speeds) -> f64 {
        let [from, to] = [self, next].map(|cell| cell.place.bounds().center().to_ecef());
        let octaves = f64::from(self.octave.abs_diff(next.octave));
        speeds.frames(from.distance_m(to) / self.above_m(), octaves * LN_2)
    }
}

/// The level whose cells are about as wide as an octave is high.
fn level(octave: u8) -> u8 {
    LEVEL_MAX.saturating_sub(octave)
}

/// Way over the ground to a cell, 0 inside it; metres. Good where cells are near, which is what it is asked for.
fn distance_to_m(bounds: &GeoBounds, from: Geodetic) -> f64 {
    let north = (bounds.south_rad - from.lat_rad).max(from.lat_rad - bounds.north_rad).max(0.0);
    let from_middle = wrapped(from.lon_rad - bounds.center().lon_rad).abs();
    let east = (from_middle - bounds.width_rad() / 2.0).max(0.0) * from.lat_rad.cos();
    north.hypot(east) * meridian_radius_m(from.lat_rad.sin())
}

fn wrapped(angle_rad: f64) -> f64 {
    (angle_rad + PI).rem_euclid(TAU) - PI
}

/// The cells that can be entered within `frames_max` frames, with the frames that it takes, in that order; at most
/// `cells_max` (Dijkstra 1959). Cells that take as long follow their own order.
pub fn observer_range(eye: &Eye, speeds: &Speeds, frames_max: f64, cells_max: usize) -> Vec<(f64, ObserverCell)> {
    let start = ObserverCell::around(eye);
    let mut frames_of = HashMap::from([(start, 0.0)]);
    // Frames are not negative, so that their bits have their order.
    let mut open = BTreeSet::from([(0f64.to_bits(), start)]);
    let mut reached = Vec::new();
    while let Some((bits, cell)) = open.pop_first() {
        let frames = f64::from_bits(bits);
        reached.push((frames, cell));
        if reached.len() >= cells_max {
            break;
        }
        for next in cell.neighbors() {
            let step = if cell == start { next.frames_from_eye(eye, speeds) } else { cell.frames_to(&next, speeds) };
            let entered = frames + step;
            let known = frames_of.get(&next).copied().unwrap_or(f64::INFINITY);
            if entered <= frames_max && entered < known {
                open.remove(&(known.to_bits(), next));
                open.insert((entered.to_bits(), next));
                frames_of.insert(next, entered);
            }
        }
    }
    reached
}

#[cfg(test)]
mod tests {
    use super::*;

    /// In the middle of a cell on the equator, in the middle of an octave.
    fn eye() -> Eye {
        let mut eye = Eye { place: Geodetic::from_degrees(0.3, 20.2, 0.0), above_m: 1024.0 * std::f64::consts::SQRT_2 };
        eye.place = ObserverCell::around(&eye).place.bounds().center();
        eye
    }

    #[test]
    fn a_cell_is_about_as_wide_as_it_is_high() {
        for octave in 1..=20 {
            let above_m = 1.2 * f64::from(1u32 << octave);
            let cell = ObserverCell::around(&Eye { above_m, ..eye() });
            let share = cell.place.sides_m().height_m / cell.above_m();
            assert_eq!(cell.octave, octave);
            assert!((0.7..1.45).contains(&share), "{share}");
        }
    }

    #[test]
    fn cells_come_in_the_order_of_the_frames_to_enter_them() {
        let eye = eye();
        let start = ObserverCell::around(&eye);
        let side = start.place.sides_m().height_m / eye.above_m;
        // A height in 10 frames; an octave takes so long that none is entered in 30.
        let speeds = Speeds { heights: 0.1, log_height: LN_2 / 100.0, turn_rad: 0.0 };
        let reached = observer_range(&eye, &speeds, 30.0, 1000);
        assert_eq!(reached[0], (0.0, start));
        assert!(reached.windows(2).all(|pair| pair[0].0 <= pair[1].0));
        assert!(reached.iter().all(|(_, cell)| cell.octave == start.octave));
        // By hand: half a side to the four beside it, at the corners √2 of that, and a side more for each next one.
        let frames_of = |east: i32, north: i32| {
            let (x, y) = start.place.xy();
            let at = |from: u32, by: i32| from.checked_add_signed(by).unwrap();
            let place = CellId::new(start.place.zone(), start.place.level(), at(x, east), at(y, north)).unwrap();
            reached.iter().find(|(_, cell)| cell.place == place).map(|&(frames, _)| frames)
        };
        let near = |frames: Option<f64>, sides: f64| (frames.unwrap() / (10.0 * side * sides) - 1.0).abs() < 0.01;
        assert!(near(frames_of(0, 1), 0.5) && near(frames_of(1, 0), 0.5) && near(frames_of(1, 1), 0.5f64.sqrt()));
        assert!(near(frames_of(0, 2), 1.5) && near(frames_of(-3, 0), 2.5) && near(frames_of(2, 2), 1.5 * 2f64.sqrt()));
        // Aslant over the corner and then straight on; straight on and then aslant would be longer.
        assert!(near(frames_of(2, 1), 0.5f64.sqrt() + 1.0));
        assert_eq!(frames_of(0, (30.0 / (10.0 * side) + 1.5) as i32), None);
    }

    #[test]
    fn a_dive_enters_the_octave_below_first_where_the_eye_is() {
        let eye = Eye { above_m: 1100.0, ..eye() };
        let speeds = Speeds { heights: 0.001, log_height: LN_2 / 10.0, turn_rad: 0.0 };
        let reached = observer_range(&eye, &speeds, 12.0, 1000);
        let below = reached[1].1;
        assert_eq!((reached[0].1.octave, below.octave), (10, 9));
        assert!((reached[1].0 - 10.0 * (1100f64 / 1024.0).log2()).abs() < 1e-9);
        // The octave above: 10 frames less what the eye is above the lower end of its own.
        let above = reached.iter().find(|(_, cell)| cell.octave == 11).unwrap();
        assert!((above.0 - 10.0 * (2048f64 / 1100.0).log2()).abs() < 1e-9);
        assert!(above.1.place.contains(reached[0].1.place) && reached[0].1.place.contains(below.place));
    }

    #[test]
    fn no_eye_is_too_low_too_high_or_too_near_a_pole() {
        for above_m in [0.0, 1.0, 3e7, 1e9] {
            for lat_deg in [-90.0, 89.9999, 45.0] {
                let eye = Eye { place: Geodetic::from_degrees(lat_deg, 180.0, above_m), above_m };
                let speeds = Speeds { heights: 1.0, log_height: 0.1, turn_rad: 0.0 };
                let reached = observer_range(&eye, &speeds, 30.0, 50);
                assert!(!reached.is_empty() && reached.len() <= 50);
                assert!(reached.iter().all(|(frames, _)| (0.0..=30.0).contains(frames)));
            }
        }
        let at_rest = Speeds { heights: 0.0, log_height: 0.0, turn_rad: 0.0 };
        assert_eq!(observer_range(&eye(), &at_rest, 60.0, 50).len(), 1);
    }
}
