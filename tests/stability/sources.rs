//! Sources with voids, spikes, no numbers, overlaps, and contradictions.

use super::table::{Row, digits};
use crate::made_up::random::unit;
use crate::towns::{recipe, write_dem};
use std::path::Path;
use stoop::prepare::{Elevation, PrepareError};
use stoop::units::ByteSize;

/// What the coarse source, the fine one, and one as fine that contradicts it say everywhere, metres.
const COARSE_M: f64 = 100.0;
const FINE_M: f64 = 300.0;
const OTHER_M: f64 = 500.0;
const NODATA: f64 = -32_768.0;
/// Posts of the fine sources: 0.01° apart, from 4° E 6° N on.
const FINE: [u32; 2] = [201, 201];
const FINE_AT: [f64; 3] = [4.0, 6.0, 0.01];
const FEATHER_M: f64 = 5_000.0;

/// A post of the fine source, of which a share is void: marked, no number, or infinite.
fn post_m(share: f64, lon: f64, lat: f64) -> f64 {
    let number = ((lon * 100.0).round() * 1e4 + (lat * 100.0).round()) as u64;
    match unit(1, number) {
        void if void >= share => FINE_M,
        _ => [NODATA, f64::NAN, f64::INFINITY][(number % 3) as usize],
    }
}

fn elevation(folder: &Path, share: f64) -> Result<Elevation, PrepareError> {
    let at = |name: &str| folder.join(name);
    write_dem(&at("coarse.tif"), [11, 11], [0.0, 10.0, 1.0], |_, _| COARSE_M);
    write_dem(&at("fine.tif"), FINE, FINE_AT, |lon, lat| post_m(share, lon, lat));
    // Half of it lies over the fine one, and contradicts it.
    write_dem(&at("other.tif"), FINE, [5.0, 6.0, 0.01], |_, _| OTHER_M);
    let section = |file: &str| {
        format!(
            "[[elevation]]\nfile = \"{file}\"\nvertical = \"ellipsoid\"\nfeather_m = {FEATHER_M}\nnodata = {NODATA}\n"
        )
    };
    let sections: String = ["coarse.tif", "fine.tif", "other.tif"].map(section).concat();
    Elevation::open(&recipe(folder, &format!("name = \"t\"\n{sections}")), folder, ByteSize(64 << 20), &|_| {})
}

/// Bilinear over a grid's posts as they are, as is usual where voids are not known.
fn raw_m(share: f64, lon: f64, lat: f64) -> f64 {
    let [west, north, step] = FINE_AT;
    let (x, y) = ((lon - west) / step, (north - lat) / step);
    let (u, v) = (x.fract(), y.fract());
    let post = |dx: f64, dy: f64| post_m(share, west + (x.floor() + dx) * step, north - (y.floor() + dy) * step);
    let row = |dy: f64| post(0.0, dy) * (1.0 - u) + post(1.0, dy) * u;
    row(0.0) * (1.0 - v) + row(1.0) * v
}

/// Along a parallel through the fine source from outside to its middle, metres.
const STEPS: u32 = 4_000;
const LAT_DEG: f64 = 5.003;

fn lon_deg(at: u32) -> f64 {
    3.8 + 3.5 * f64::from(at) / f64::from(STEPS)
}

/// Lowest and highest height along the parallel, and the steepest rise, metres for each metre.
fn along(elevation: &Elevation) -> (f64, f64, f64) {
    let heights: Vec<f64> =
        (0..=STEPS).map(|at| elevation.height_m(LAT_DEG.to_radians(), lon_deg(at).to_radians())).collect();
    assert!(heights.iter().all(|height_m| height_m.is_finite()));
    let step_m = (lon_deg(1) - lon_deg(0)).to_radians() * 6_378_137.0 * LAT_DEG.to_radians().cos();
    let rise = heights.windows(2).map(|pair| (pair[1] - pair[0]).abs() / step_m).fold(0.0, f64::max);
    let low = heights.iter().copied().fold(f64::INFINITY, f64::min);
    (low, heights.into_iter().fold(f64::NEG_INFINITY, f64::max), rise)
}

pub fn sources() -> Row {
    let folder = tempfile::tempdir().unwrap();
    let share = 0.05;
    let inside = (0..=STEPS).filter(|&at| (4.0..5.99).contains(&lon_deg(at)));
    let raw: Vec<f64> = inside.map(|at| raw_m(share, lon_deg(at), LAT_DEG)).collect();
    let lost = raw.iter().filter(|height_m| !height_m.is_finite()).count() as f64 / raw.len() as f64;
    let deepest_m = raw.iter().copied().filter(|height_m| height_m.is_finite()).fold(0.0, f64::min);
    assert!(lost > 0.01 && deepest_m < -10_000.0, "{lost} {deepest_m}");
    let sound = elevation(folder.path(), 0.0).unwrap();
    let (low_m, high_m, seam) = along(&sound);
    assert!(low_m >= COARSE_M - 1e-6 && high_m <= OTHER_M + 1e-6, "{low_m} {high_m}");
    // Where sources of one spacing contradict each other, one of them is it, wherever one looks.
    let both_m = (0..100).map(|at| sound.height_m(5f64.to_radians(), (5.3 + 0.004 * f64::from(at)).to_radians()));
    let both_m: Vec<f64> = both_m.collect();
    assert!(both_m.windows(2).all(|pair| (pair[0] - pair[1]).abs() < 1e-6), "{both_m:?}");
    // Voids are the coarser source's: between it and the fine one, and whole, however many there are.
    let most = [0.05, 0.3, 0.7, 0.95, 0.999].into_iter().take_while(|&share| {
        let (low_m, high_m, _) = along(&elevation(folder.path(), share).unwrap());
        low_m >= COARSE_M - 1e-6 && high_m <= OTHER_M + 1e-6
    });
    let most = most.last().unwrap();
    assert!(most > 0.9, "{most}");
    let all_void = elevation(folder.path(), 1.1).err().unwrap().to_string();
    assert!(all_void.contains("fine.tif") && all_void.contains("void"), "{all_void}");
    // A spike that no place on Earth can have is refused with its place; a lower one is taken as it is.
    let spike = |height_m: f64| {
        write_dem(&folder.path().join("spike.tif"), [11, 11], [0.0, 10.0, 1.0], |lon, lat| {
            if (lon, lat) == (5.0, 4.0) { height_m } else { COARSE_M }
        });
        let text = "name = \"t\"\n[[elevation]]\nfile = \"spike.tif\"\nvertical = \"ellipsoid\"\n";
        Elevation::open(&recipe(folder.path(), text), folder.path(), ByteSize(1 << 20), &|_| {})
    };
    let refused = spike(99_999.0).err().unwrap().to_string();
    assert!(refused.contains("row 6, column 5") && refused.contains("nodata"), "{refused}");
    assert!(spike(19_000.0).is_ok());
    Row {
        case: "sources with voids, spikes, NaN, overlaps, contradictions",
        usual: format!(
            "{} % of the posts void: between posts as they are, {} % of a profile are no numbers, and it falls to {} m",
            digits(100.0 * share),
            digits(100.0 * lost),
            digits(deepest_m)
        ),
        ours: format!(
            "voids are the coarser source's, seams rise by at most {} m a metre, one of two that contradict each other \
             is taken everywhere; heights beyond 20 km are refused with their row and column (spikes below that are \
             taken as they are)",
            digits(seam)
        ),
        limit: format!("{} % of the posts void; a file that is all void is an error", digits_of_share(most)),
    }
}

fn digits_of_share(share: f64) -> String {
    format!("{:.1}", 100.0 * share)
}
