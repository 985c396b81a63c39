//! Runs the cases of PROJ's `gie` files that concern what is computed here: geodetic to geocentric and topocentric and
//! back. Operations with any other step are passed over; so are those with the EGM96 grid, whose expected values are
//! those of a grid of 1° that PROJ tests with.

use glam::DVec3;
use std::collections::HashMap;
use stoop::geodesy::{Ecef, Ellipsoid, Enu, Geodetic, Point, Transform};

/// The number of cases run, or the first that fails.
pub fn run(text: &str) -> Result<usize, String> {
    let mut state = State::default();
    let mut active = false;
    for (line, instruction) in logical_lines(text) {
        let (word, rest) = instruction.split_once(char::is_whitespace).unwrap_or((&instruction, ""));
        match word {
            "<gie>" | "<gie-strict>" => active = true,
            "</gie>" | "</gie-strict>" => active = false,
            _ if active => state.take(word, rest.trim()).map_err(|failure| format!("line {line}: {failure}"))?,
            _ => {}
        }
    }
    Ok(state.count)
}

/// Lines without comments and rulers; an operation with its continuations is one.
fn logical_lines(text: &str) -> Vec<(usize, String)> {
    let mut lines: Vec<(usize, String)> = Vec::new();
    let mut continues = false;
    for (at, line) in text.lines().enumerate() {
        let line = line.split('#').next().unwrap_or("").trim();
        let (line, next_continues) = line.strip_suffix('\\').map_or((line, false), |line| (line.trim(), true));
        if continues {
            if let Some((_, last)) = lines.last_mut() {
                last.push(' ');
                last.push_str(line);
            }
        } else if !line.is_empty() && !line.starts_with("---") && !line.starts_with("===") {
            lines.push((at + 1, line.to_owned()));
        }
        continues = next_continues;
    }
    lines
}

#[derive(Default)]
struct State {
    steps: Option<Vec<Step>>,
    inverse: bool,
    tolerance_m: f64,
    accepted: [f64; 3],
    accepted_text: String,
    count: usize,
}

impl State {
    fn take(&mut self, word: &str, rest: &str) -> Result<(), String> {
        match word {
            "operation" => {
                self.steps = Step::pipeline(rest);
                self.inverse = false;
                self.tolerance_m = 0.5e-3;
            }
            "direction" => self.inverse = rest.starts_with("inv"),
            "tolerance" => self.tolerance_m = length_m(rest).ok_or_else(|| format!("tolerance {rest:?}"))?,
            "accept" => {
                self.accepted = coordinates(rest);
                rest.clone_into(&mut self.accepted_text);
            }
            "expect" if self.steps.is_some() && !rest.starts_with("failure") => {
                let found = self.apply(self.accepted, self.inverse);
                self.compare(found, coordinates(rest), self.inverse, self.tolerance_m)?;
                self.count += 1;
            }
            "roundtrip" if self.steps.is_some() => {
                let mut words = rest.splitn(2, char::is_whitespace);
                let rounds: usize = words.next().and_then(|count| count.parse().ok()).unwrap_or(100);
                let tolerance_m = words.next().and_then(length_m).unwrap_or(self.tolerance_m);
                let back = (0..rounds)
                    .fold(self.accepted, |place, _| self.apply(self.apply(place, self.inverse), !self.inverse));
                self.compare(back, self.accepted, !self.inverse, tolerance_m)?;
                self.count += 1;
            }
            _ => {}
        }
        Ok(())
    }

    fn apply(&self, place: [f64; 3], inverse: bool) -> [f64; 3] {
        let steps = self.steps.as_deref().unwrap_or_default();
        if inverse {
            steps.iter().rev().fold(place, |place, step| step.apply(place, !step.inverse))
        } else {
            steps.iter().fold(place, |place, step| step.apply(place, step.inverse))
        }
    }

    /// Distances in metres; between angles as on the Earth.
    fn compare(&self, found: [f64; 3], expected: [f64; 3], inverse: bool, tolerance_m: f64) -> Result<(), String> {
        let is_angles = self.steps.as_deref().is_some_and(|steps| {
            let step = if inverse { steps.first() } else { steps.last() };
            step.is_some_and(|step| step.gives_angles(inverse != step.inverse))
        });
        let (a, b) = (DVec3::from_array(found), DVec3::from_array(expected));
        let distance_m = if is_angles {
            let [a, b] = [a, b].map(|p| Geodetic::from_degrees(p.y, p.x, p.z).to_ecef());
            a.distance_m(b)
        } else {
            a.distance(b)
        };
        // Cases give as many digits as their tolerance; rounding of theirs and ours comes on top.
        (distance_m <= tolerance_m + 5e-9).then_some(()).ok_or_else(|| {
            format!("accept {} gives {found:?}, expected {expected:?}: {distance_m} m off", self.accepted_text)
        })
    }
}

fn coordinates(text: &str) -> [f64; 3] {
    let mut numbers = text.split_whitespace().filter_map(|word| word.parse().ok());
    std::array::from_fn(|_| numbers.next().unwrap_or(0.0))
}

fn length_m(text: &str) -> Option<f64> {
    let text = text.trim();
    let at = text.find(|c: char| !(c.is_ascii_digit() || ".-e".contains(c))).unwrap_or(text.len());
    let unit = match text[at..].trim() {
        "" | "m" => 1.0,
        "cm" => 1e-2,
        "mm" => 1e-3,
        "um" => 1e-6,
        "nm" => 1e-9,
        _ => return None,
    };
    Some(text[..at].trim().parse::<f64>().ok()? * unit)
}

struct Step {
    kind: Kind,
    inverse: bool,
}

enum Kind {
    Geographic,
    Cartesian { ellipsoid: Ellipsoid, unit_m: f64 },
    Topocentric(Transform<Ecef, Enu>),
}

impl Step {
    /// `None` when any step is something else.
    fn pipeline(text: &str) -> Option<Vec<Self>> {
        let words = text.split_whitespace().map(|word| word.trim_start_matches('+'));
        let mut parts: Vec<Vec<&str>> = vec![Vec::new()];
        for word in words.filter(|&word| word != "proj=pipeline") {
            if word == "step" {
                parts.push(Vec::new());
            } else if let Some(part) = parts.last_mut() {
                part.push(word);
            }
        }
        let steps: Vec<_> =
            parts.iter().filter(|part| !part.is_empty()).map(|part| Self::parse(part)).collect::<Option<_>>()?;
        // What only passes angles on is PROJ's reading of its input.
        steps.iter().any(|step: &Self| !matches!(step.kind, Kind::Geographic)).then_some(steps)
    }

    fn parse(words: &[&str]) -> Option<Self> {
        let options: HashMap<_, _> = words.iter().map(|word| word.split_once('=').unwrap_or((word, ""))).collect();
        let number = |key: &str| options.get(key).and_then(|value| value.parse::<f64>().ok());
        let known = [
            "proj", "ellps", "a", "b", "units", "to_meter", "lon_0", "lat_0", "h_0", "X_0", "Y_0", "Z_0", "inv", "init",
        ];
        if options.keys().any(|key| !known.contains(key)) || options.get("units").is_some_and(|&units| units != "m") {
            return None;
        }
        let kind = match (options.get("proj").copied(), options.get("init").copied()) {
            (None, Some("epsg:4326")) => Kind::Geographic,
            (None, Some("epsg:4978")) => Kind::Cartesian { ellipsoid: Ellipsoid::WGS84, unit_m: 1.0 },
            (Some("latlong" | "longlat"), None) => Kind::Geographic,
            (Some("cart" | "geocent"), None) => {
                Kind::Cartesian { ellipsoid: ellipsoid(&options)?, unit_m: number("to_meter").unwrap_or(1.0) }
            }
            (Some("topocentric"), None) => Kind::Topocentric(match (number("lat_0"), number("lon_0")) {
                (Some(lat), Some(lon)) => {
                    Geodetic::from_degrees(lat, lon, number("h_0").unwrap_or(0.0)).ecef_from_enu()
                }
                _ => {
                    let origin = Point::new(DVec3::new(number("X_0")?, number("Y_0")?, number("Z_0")?));
                    Geodetic::from_ecef(origin).ecef_from_enu()
                }
            }),
            _ => return None,
        };
        Some(Self { kind, inverse: options.contains_key("inv") })
    }

    fn gives_angles(&self, inverse: bool) -> bool {
        match self.kind {
            Kind::Geographic => true,
            Kind::Cartesian { .. } => inverse,
            Kind::Topocentric(_) => false,
        }
    }

    fn apply(&self, p: [f64; 3], inverse: bool) -> [f64; 3] {
        match (&self.kind, inverse) {
            (Kind::Geographic, _) => p,
            (Kind::Cartesian { ellipsoid, unit_m }, false) => {
                (ellipsoid.to_ecef(Geodetic::from_degrees(p[1], p[0], p[2])).xyz() / *unit_m).to_array()
            }
            (Kind::Cartesian { ellipsoid, unit_m }, true) => {
                let place = ellipsoid.to_geodetic(Point::new(DVec3::from_array(p) * *unit_m));
                [place.lon_deg(), place.lat_deg(), place.height_m]
            }
            (Kind::Topocentric(ecef_from_enu), false) => {
                (ecef_from_enu.inverse() * Point::new(DVec3::from_array(p))).xyz().to_array()
            }
            (Kind::Topocentric(ecef_from_enu), true) => {
                (*ecef_from_enu * Point::new(DVec3::from_array(p))).xyz().to_array()
            }
        }
    }
}

fn ellipsoid(options: &HashMap<&str, &str>) -> Option<Ellipsoid> {
    let number = |key: &str| options.get(key).map(|value| value.parse::<f64>());
    match (options.get("ellps").copied(), number("a"), number("b")) {
        (None | Some("WGS84"), None, None) => Some(Ellipsoid::WGS84),
        (Some("GRS80"), None, None) => Some(Ellipsoid::new(6_378_137.0, 1.0 / 298.257_222_101)),
        (None, Some(Ok(a)), None) => Some(Ellipsoid::new(a, 0.0)),
        (None, Some(Ok(a)), Some(Ok(b))) => Some(Ellipsoid::new(a, 1.0 - b / a)),
        _ => None,
    }
}
