//! Against the project's real data.

use super::*;

#[test]
fn etopo5_of_the_dive() {
    let Some(root) = shared("dive") else { return };
    let e = open(&(section("global_dem_5min.tif", "") + &section("inset_dem_10m.tif", "feather_m = 500")), &root)
        .expect("sound");
    assert_eq!(e.stats()[0].posts, 4320 * 2161);
    assert_eq!(at(&e, 0.0, -30.0), 0.0, "sea");
    let (low, high) = e.height_range_m();
    assert!(low == 0.0 && (7000.0..9000.0).contains(&high), "{low} {high}");
    let inset = GeoBounds::from_degrees(-84.45, 33.7, -84.3, 33.8);
    assert!((e.finest_spacing_rad(&inset).expect("inside").to_degrees() * 3600.0 - 1.0 / 3.0).abs() < 1e-6);
    // Counted: the inset's posts in a box well inside it.
    let step = 1.0 / 10_800.0;
    let count = posts(&e, -84.4, 33.75, -84.4 + 10.0 * step, 33.75 + 10.0 * step).len();
    assert!((100..=121).contains(&count), "{count}");
    // Continuous through the seam.
    let crossing: Vec<f64> = (0..2000).map(|i| at(&e, 33.75, -84.5 + f64::from(i) * 1e-5)).collect();
    let steepest = crossing.windows(2).map(|w| (w[1] - w[0]).abs()).fold(0.0, f64::max);
    assert!(steepest < 3.0, "{steepest} m a metre");
}

#[test]
fn california_is_one_source_of_32_tiles() {
    let Some(root) = shared("california-90m-hgt") else { return };
    let e = open(&section("*.hgt.zip", ""), &root).expect("sound");
    let stats = &e.stats()[0];
    assert_eq!((stats.files, stats.voids, stats.low_m, stats.high_m), (32, 0, -85.0, 4404.0));
    assert_eq!(e.layers.len(), 1);
    assert_eq!((e.layers[0].grid.cols, e.layers[0].grid.rows), (9601, 4801));
    let highest = posts(&e, -118.4, 36.5, -118.2, 36.7).iter().map(|p| p.2).fold(f64::MIN, f64::max);
    assert_eq!(highest, 4404.0, "Mt Whitney");
    assert_eq!(at(&e, 39.1, -120.03).round(), 1899.0, "Lake Tahoe");
    let lowest = posts(&e, -116.9, 36.2, -116.7, 36.3).iter().map(|p| p.2).fold(f64::MAX, f64::min);
    assert!((-86.0..=-84.0).contains(&lowest), "Badwater {lowest}");
    // Across a seam of tiles the surface is one.
    let (west, east) = (at(&e, 37.5, -118.000_01), at(&e, 37.5, -117.999_99));
    assert!((west - east).abs() < 2.0, "{west} {east}");
}

#[test]
fn web_mercator_of_san_francisco() {
    let Some(root) = shared("sf") else { return };
    let e = open(&section("sf_dem_5m_epsg3857.tif", "feather_m = 0"), &root).expect("sound");
    let stats = &e.stats()[0];
    assert!((stats.low_m - 0.4).abs() < 0.06 && (stats.high_m - 114.9).abs() < 0.06, "{stats:?}");
    let found = posts(&e, -123.0, 37.0, -122.0, 38.0);
    assert_eq!(found.len(), 512 * 512, "each post once");
    let worst = found.iter().map(|&(lat, lon, h)| (at(&e, lat, lon) - h).abs()).fold(0.0, f64::max);
    assert!(worst < 0.05, "control grids against each other: {worst} m");
    // Cells that tile the area see each post once.
    let [bounds] = e.bounds()[..] else { panic!("one rectangle") };
    let middle = bounds.center().lon_deg() + 1e-7;
    assert_eq!(posts(&e, -123.0, 37.0, middle, 38.0).len() + posts(&e, middle, 37.0, -122.0, 38.0).len(), 512 * 512);
    let spacing_m = e.finest_spacing_rad(&bounds).expect("inside") * SEMI_MAJOR_M;
    assert!((4.7..4.9).contains(&spacing_m), "6.059 m of EPSG:3857 shrink by cos 37.8°: {spacing_m}");
}

#[test]
fn voids_are_counted_as_given() {
    let Some(root) = shared("peaks-90m") else { return };
    for (file, voids, low, high) in [
        ("mt_rainier_90m.tif", 9033, 263.0, 4371.0),
        ("mt_fuji_90m.tif", 2437, -16.0, 3742.0),
        ("mt_everest_90m.tif", 130_953, 192.0, 8642.0),
    ] {
        let e = open(&section(file, ""), &root).expect("sound");
        let stats = &e.stats()[0];
        assert_eq!((stats.voids, stats.low_m, stats.high_m), (voids, low, high), "{file}");
    }
    let Some(root) = shared("monaco") else { return };
    let e = open(&section("N43E007.hgt.zip", ""), &root).expect("sound");
    let stats = &e.stats()[0];
    assert_eq!((stats.voids, stats.low_m, stats.high_m), (1595, -11.0, 2064.0));
}

#[test]
fn everest_s_voids_are_filled_from_the_globe() {
    let (Some(root), Some(_)) = (shared("peaks-90m"), shared("dive")) else { return };
    let globe = "../dive/global_dem_5min.tif";
    let e = open(&(section(globe, "") + &section("mt_everest_90m.tif", "")), &root).expect("sound");
    let alone = open(&section(globe, ""), &root).expect("sound");
    let (lat, lon) = (27.988, 86.925);
    assert!((at(&e, lat, lon) - at(&alone, lat, lon)).abs() < 1.0, "summit is void: {}", at(&e, lat, lon));
}

#[test]
fn swellendam_s_nodata_is_a_float_s_largest() {
    let Some(root) = shared("swellendam") else { return };
    let e = open(&section("srtm_41_19_4326.tif", ""), &root).expect("sound");
    let stats = &e.stats()[0];
    assert!(stats.low_m >= 0.0 && (stats.high_m - 1699.0).abs() < 1.0, "{stats:?}");
}

#[test]
fn etopo5_as_netcdf() {
    let path = Path::new("/usr/share/ferret-vis/data");
    if !path.join("etopo5.cdf").exists() {
        println!("skipped: Debian's ferret-datasets is not installed");
        return;
    }
    let e = open(&section("etopo5.cdf", ""), path).expect("sound");
    let stats = &e.stats()[0];
    assert_eq!((stats.posts, stats.low_m, stats.high_m), (2161 * 4320, -10_376.0, 7833.0));
    for (lat, lon, height) in [(39.75, -105.0, 1658.0), (-78.4645, 106.8339, 3475.0)] {
        assert!((at(&e, lat, lon) - height).abs() < 0.01, "Denver, Vostok: {}", at(&e, lat, lon));
    }
}
