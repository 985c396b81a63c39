//! Roofs that draw the outline in towards its middle: pyramids, domes, onions.

use super::{Levels, RoofMesh, RoofShape};
use crate::content::FaceKind;
use geo::{Centroid, Coord, LineString, Polygon};
use std::f64::consts::FRAC_1_SQRT_2;

/// Share of the outline's distance from its middle, and of the roof's height, from the eaves to the top.
type Profile = &'static [[f64; 2]];

const PYRAMID: Profile = &[[1.0, 0.0], [0.0, 1.0]];
/// A quarter of a circle in six.
const DOME: Profile = &[
    [1.0, 0.0],
    [0.965_926, 0.258_819],
    [0.866_025, 0.5],
    [FRAC_1_SQRT_2, FRAC_1_SQRT_2],
    [0.5, 0.866_025],
    [0.258_819, 0.965_926],
    [0.0, 1.0],
];
const ONION: Profile =
    &[[1.0, 0.0], [1.1, 0.1], [1.12, 0.2], [1.0, 0.37], [0.66, 0.54], [0.3, 0.68], [0.12, 0.82], [0.0, 1.0]];

pub fn profile(shape: RoofShape) -> Option<Profile> {
    match shape {
        RoofShape::Pyramidal => Some(PYRAMID),
        RoofShape::Dome => Some(DOME),
        RoofShape::Onion => Some(ONION),
        _ => None,
    }
}

/// Draws walls and roof; false, and nothing drawn, where the middle does not see the whole outline.
pub fn draw(rings: &[Vec<Coord>], profile: Profile, levels: Levels, mesh: &mut RoofMesh) -> bool {
    let [outer] = rings else { return false };
    let Some(middle) = Polygon::new(LineString::new(outer.clone()), Vec::new()).centroid() else { return false };
    let middle = middle.0;
    let edges = || outer.iter().zip(outer.iter().cycle().skip(1));
    let sees = |a: &Coord, b: &Coord| (a.x - middle.x) * (b.y - middle.y) - (b.x - middle.x) * (a.y - middle.y) > 1e-6;
    if !edges().all(|(a, b)| sees(a, b)) {
        return false;
    }
    let drawn_in = |point: Coord, share: f64| Coord {
        x: middle.x + (point.x - middle.x) * share,
        y: middle.y + (point.y - middle.y) * share,
    };
    for (&from, &to) in edges() {
        let corner = |mesh: &mut RoofMesh, point: Coord, [share, rise]: [f64; 2]| {
            mesh.corner(drawn_in(point, share), levels.eaves_m + rise * levels.height_m)
        };
        let foot = [from, to].map(|point| mesh.corner(point, levels.foot_m));
        let eaves = [to, from].map(|point| corner(mesh, point, profile[0]));
        mesh.fan(FaceKind::Wall, [foot, eaves].concat());
        for step in profile.windows(2) {
            let band = [(from, step[0]), (to, step[0]), (to, step[1]), (from, step[1])];
            let band = band.map(|(point, at)| corner(mesh, point, at)).to_vec();
            mesh.fan(FaceKind::Roof, band);
        }
    }
    true
}
