//! Sound footprints set on the ground.
//!
//! A building's ground is its `base` where the source gives one, else the terrain at the middle of its box; parts of
//! one building share the ground of the whole. The roof stands `height` above the ground. The visible walls begin at
//! the ground, or at the terrain in the middle of the prism's own box where that is higher, so that nothing is lifted
//! where the finest terrain is drawn. Below, walls go on down to the lowest terrain along the footprint, less the
//! terrain's error there, so that no corner floats.

use super::clean::{Footprint, Reason};
use super::roof::RoofRule;
use super::rules::{DRAWN_FLAT, Extent};
use crate::content::Prism;
use crate::forest::CellId;
use crate::geodesy::{GeoBounds, Geodetic, SEMI_MAJOR_M, VerticalDatum};
use std::collections::BTreeSet;
use std::f64::consts::PI;

/// The ground that objects stand on; radians, metres above the ellipsoid.
pub struct Ground<'a> {
    /// The truth.
    pub height_m: &'a (dyn Fn(f64, f64) -> f64 + Sync),
    /// `error_m` of the finest cell at a place.
    pub error_m: &'a (dyn Fn(f64, f64) -> f64 + Sync),
}

/// Distance of the places along a wall at which the terrain is asked for, metres.
const STEP_M: f64 = 10.0;
/// Places along one wall; longer walls have them farther apart.
const STEPS_MAX: f64 = 64.0;

/// Where a building's ground lies above the ellipsoid, metres.
pub fn ground_m(
    footprints: &[Footprint],
    whole: Option<&[[f64; 2]]>,
    extent: &Extent,
    vertical: VerticalDatum,
    ground: &Ground,
) -> f64 {
    let center = ground_at(footprints.iter().map(|footprint| &footprint.rings[0]), whole);
    match extent.base_m {
        Some(base_m) => base_m + vertical.undulation_m(center.lat_rad, center.lon_rad),
        None => (ground.height_m)(center.lat_rad, center.lon_rad),
    }
}

/// Where a building of some outer rings (radians) stands: the middle of its box, or of the whole that it is part of
/// (degrees).
pub fn ground_at<'r>(rings: impl Iterator<Item = &'r Vec<[f64; 2]>>, whole: Option<&[[f64; 2]]>) -> Geodetic {
    match whole {
        Some(points) => bounds(points.iter().map(|p| p.map(f64::to_radians))),
        None => bounds(rings.flatten().copied()),
    }
    .center()
}

/// Sets a prism that stands on a ground of height 0 on the ground of its building. Says whether its roof is below the
/// terrain.
pub fn raise(prism: &mut Prism, ground_m: f64, ground: &Ground) -> bool {
    let Some(ring) = prism.rings.first() else { return false };
    let foot_m = f64::from(prism.base_m) - f64::from(prism.foundation_m);
    let (base_m, top_m) = (ground_m + f64::from(prism.base_m), ground_m + f64::from(prism.top_m));
    let mut is_buried = false;
    // What begins above the ground hangs in the air.
    if foot_m > Prism::WALL_MIN_M {
        (prism.base_m, prism.top_m) = (base_m as f32, top_m as f32);
    } else {
        let center = bounds(ring.iter().copied()).center();
        let own_m = (ground.height_m)(center.lat_rad, wrap(center.lon_rad));
        is_buried = own_m >= top_m;
        let base_m = base_m.max(own_m).min(top_m - Prism::WALL_MIN_M);
        let lowest_m = lowest_m(ring, ground).min(ground_m + foot_m);
        let error_m = (ground.error_m)(center.lat_rad, wrap(center.lon_rad));
        prism.foundation_m = ((base_m - lowest_m).max(0.0) + error_m) as f32;
        (prism.base_m, prism.top_m) = (base_m as f32, top_m as f32);
    }
    for corner in prism.detail.iter_mut().flat_map(|detail| &mut detail.corners) {
        corner.height_m += ground_m as f32;
    }
    is_buried
}

/// The prism over one footprint; its cell is still to be chosen.
pub fn prism(
    footprint: Footprint,
    extent: &Extent,
    ground_m: f64,
    ground: &Ground,
    notes: &mut BTreeSet<Reason>,
) -> Prism {
    let center = center(&footprint);
    let top_m = ground_m + extent.height_m;
    let (base_m, foundation_m) = if extent.min_height_m > 0.0 {
        (ground_m + extent.min_height_m, 0.0)
    } else {
        let own_m = (ground.height_m)(center.lat_rad, center.lon_rad);
        if own_m >= top_m {
            notes.insert("roof below the terrain");
        }
        let base_m = ground_m.max(own_m).min(top_m - Prism::WALL_MIN_M);
        let lowest_m = lowest_m(&footprint.rings[0], ground).min(ground_m);
        let error_m = (ground.error_m)(center.lat_rad, center.lon_rad);
        (base_m, ((base_m - lowest_m).max(0.0) + error_m).max(Prism::FOUNDATION_MIN_M))
    };
    Prism {
        id: 0,
        cell: CellId::containing(center.lat_rad, wrap(center.lon_rad), 0),
        rings: footprint.rings,
        roof: footprint.triangles,
        base_m: base_m as f32,
        top_m: top_m as f32,
        foundation_m: foundation_m as f32,
        wall_color: [0; 3],
        roof_color: [0; 3],
        detail: None,
    }
}

/// The prism over one footprint with its roof; where the roof cannot be drawn there, it is flat and that is noted.
pub fn roofed(
    footprint: Footprint,
    extent: &Extent,
    roof: &RoofRule,
    ground_m: f64,
    ground: &Ground,
    notes: &mut BTreeSet<Reason>,
) -> Prism {
    let room_m = extent.height_m - extent.min_height_m;
    let mut roof_m = roof.height_m(&footprint, room_m, notes);
    let mut extent = *extent;
    if extent.to_eaves {
        extent.height_m += roof_m;
    } else if roof_m > room_m {
        notes.insert("roof higher than its building: cut down");
        roof_m = room_m;
    }
    let shape = footprint.clone();
    let mut prism = prism(footprint, &extent, ground_m, ground, notes);
    // The base may lie above the eaves, on a slope.
    let eaves_m = ground_m + extent.height_m - roof_m;
    let foot_m = f64::from(prism.base_m).min(eaves_m);
    prism.detail = roof.detail(&shape, foot_m, eaves_m, f64::from(prism.top_m));
    if prism.detail.is_none() {
        notes.insert(DRAWN_FLAT);
    }
    prism
}

/// A longitude within ±π.
pub fn wrap(lon_rad: f64) -> f64 {
    (lon_rad + PI).rem_euclid(2.0 * PI) - PI
}

/// Of longitudes and latitudes, radians.
pub fn bounds(points: impl Iterator<Item = [f64; 2]>) -> GeoBounds {
    let empty = GeoBounds {
        west_rad: f64::INFINITY,
        south_rad: f64::INFINITY,
        east_rad: f64::NEG_INFINITY,
        north_rad: f64::NEG_INFINITY,
    };
    points.fold(empty, |b, [lon, lat]| GeoBounds {
        west_rad: b.west_rad.min(lon),
        south_rad: b.south_rad.min(lat),
        east_rad: b.east_rad.max(lon),
        north_rad: b.north_rad.max(lat),
    })
}

/// Middle of a footprint's box, radians.
pub fn center(footprint: &Footprint) -> Geodetic {
    bounds(footprint.rings[0].iter().copied()).center()
}

/// Lowest terrain along the walls over an outer ring, metres.
pub fn lowest_m(ring: &[[f64; 2]], ground: &Ground) -> f64 {
    let mut lowest = f64::INFINITY;
    for (a, b) in ring.iter().zip(ring.iter().cycle().skip(1)) {
        let (east, north) = ((b[0] - a[0]) * a[1].cos(), b[1] - a[1]);
        let steps = (east.hypot(north) * SEMI_MAJOR_M / STEP_M).ceil().clamp(1.0, STEPS_MAX);
        for step in 0..steps as u32 {
            let t = f64::from(step) / steps;
            let (lat, lon) = (a[1] + t * (b[1] - a[1]), a[0] + t * (b[0] - a[0]));
            lowest = lowest.min((ground.height_m)(lat, wrap(lon)));
        }
    }
    lowest
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::prepare::buildings::clean::clean;

    /// A square of 0.0002° about (24.9, 60.2).
    fn square() -> Vec<Footprint> {
        let ring =
            vec![[24.8999, 60.1999], [24.9001, 60.1999], [24.9001, 60.2001], [24.8999, 60.2001], [24.8999, 60.1999]];
        clean(&[vec![ring]], &mut BTreeSet::new()).unwrap()
    }

    /// A slope that rises 1 m for 0.0001° to the north, 50 m high at 60.2°.
    fn slope(lat: f64, _: f64) -> f64 {
        50.0 + (lat.to_degrees() - 60.2) * 1e4
    }

    fn placed(extent: Extent) -> Prism {
        let ground = Ground { height_m: &slope, error_m: &|_, _| 0.3 };
        let footprints = square();
        let at = ground_m(&footprints, None, &extent, VerticalDatum::Ellipsoid, &ground);
        prism(footprints[0].clone(), &extent, at, &ground, &mut BTreeSet::new())
    }

    #[test]
    fn the_terrain_carries_a_building_and_no_corner_floats() {
        let prism = placed(Extent { height_m: 12.0, min_height_m: 0.0, base_m: None, to_eaves: false });
        assert!((prism.base_m - 50.0).abs() < 1e-3 && (prism.top_m - 62.0).abs() < 1e-3);
        assert!((prism.foundation_m - 1.3).abs() < 1e-2, "{}", prism.foundation_m);
    }

    #[test]
    fn a_given_base_holds_the_roof_whatever_the_terrain() {
        let low = placed(Extent { height_m: 12.0, min_height_m: 0.0, base_m: Some(45.0), to_eaves: false });
        assert!((low.top_m - 57.0).abs() < 1e-3 && (low.base_m - 50.0).abs() < 1e-3);
        assert!((low.base_m - low.foundation_m - 44.7).abs() < 1e-2);
        let high = placed(Extent { height_m: 12.0, min_height_m: 0.0, base_m: Some(55.0), to_eaves: false });
        assert!((high.top_m - 67.0).abs() < 1e-3 && (high.base_m - 55.0).abs() < 1e-3);
        assert!(high.base_m - high.foundation_m < 48.8);
    }

    #[test]
    fn parts_in_the_air_have_no_foundation() {
        let prism = placed(Extent { height_m: 12.0, min_height_m: 4.0, base_m: None, to_eaves: false });
        assert_eq!((prism.base_m.round(), prism.top_m.round(), prism.foundation_m), (54.0, 62.0, 0.0));
    }

    #[test]
    fn longitudes_wrap() {
        assert!((wrap(PI + 0.1) - (0.1 - PI)).abs() < 1e-12);
        assert!((wrap(-PI)).abs() <= PI);
    }
}
