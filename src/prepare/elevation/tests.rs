use super::*;
use crate::prepare::raster::test_files::{self, TiffOf, shared};

const MEMORY: ByteSize = ByteSize(512 << 20);

fn open(sections: &str, root: &Path) -> Result<Elevation, PrepareError> {
    let recipe = Recipe::parse(&format!("name = \"t\"\n{sections}"), Path::new("t.toml"))?;
    Elevation::open(&recipe, root, MEMORY, &|_| {})
}

fn at(elevation: &Elevation, lat_deg: f64, lon_deg: f64) -> f64 {
    elevation.height_m(lat_deg.to_radians(), lon_deg.to_radians())
}

fn section(file: &str, more: &str) -> String {
    format!("[[elevation]]\nfile = \"{file}\"\nvertical = \"ellipsoid\"\n{more}\n")
}

/// Every post that is visited, as (lat°, lon°, height).
fn posts(elevation: &Elevation, west: f64, south: f64, east: f64, north: f64) -> Vec<(f64, f64, f64)> {
    let mut found = Vec::new();
    elevation.for_each_post(&GeoBounds::from_degrees(west, south, east, north), &mut |lat, lon, h| {
        found.push((lat.to_degrees(), lon.to_degrees(), h));
    });
    found
}

#[test]
fn bilinear_between_posts_and_zero_outside() {
    let folder = tempfile::tempdir().expect("folder");
    // Posts at lon 10, 11, 12 and lat 50, 49 (pixel is point).
    TiffOf::new(3, 2, vec![0.0f32, 10.0, 20.0, 40.0, 50.0, 60.0]).point(10.0, 50.0, 1.0).write(folder.path(), "a.tif");
    let e = open(&section("a.tif", "feather_m = 0"), folder.path()).expect("sound");
    for (lat, lon, height) in [(50.0, 10.0, 0.0), (50.0, 12.0, 20.0), (49.5, 10.5, 25.0), (49.25, 11.5, 45.0)] {
        assert!((at(&e, lat, lon) - height).abs() < 1e-9, "{lat} {lon}: {}", at(&e, lat, lon));
    }
    assert_eq!(at(&e, 50.1, 10.0), 0.0);
    assert_eq!(at(&e, 49.5, 12.1), 0.0);
    assert_eq!(posts(&e, 9.0, 40.0, 11.0, 60.0).len(), 4);
    assert_eq!(e.finest_spacing_rad(&GeoBounds::from_degrees(10.5, 49.0, 10.6, 49.1)), Some(1f64.to_radians()));
    assert_eq!(e.finest_spacing_rad(&GeoBounds::from_degrees(20.0, 49.0, 21.0, 49.1)), None);
}

#[test]
fn the_finer_wins_is_feathered_and_its_voids_come_from_the_coarser() {
    let folder = tempfile::tempdir().expect("folder");
    TiffOf::new(11, 11, vec![100.0f32; 121]).point(0.0, 10.0, 1.0).write(folder.path(), "coarse.tif");
    let mut fine = vec![300.0f32; 101 * 101];
    fine[50 * 101 + 50] = -9999.0;
    TiffOf::new(101, 101, fine).point(4.0, 6.0, 0.02).nodata("-9999").write(folder.path(), "fine.tif");
    let sections = section("coarse.tif", "") + &section("fine.tif", "feather_m = 20000");
    let e = open(&sections, folder.path()).expect("sound");
    assert_eq!(at(&e, 2.0, 2.0), 100.0);
    assert_eq!(at(&e, 5.3, 5.0), 300.0, "inside");
    assert!((at(&e, 5.0, 4.0) - 100.0).abs() < 1e-6, "on the seam's outer edge");
    let seam = at(&e, 5.0, 4.0 + (10_000.0f64 / 111_320.0 / 5f64.to_radians().cos()));
    assert!((seam - 200.0).abs() < 1.0, "half way through the seam: {seam}");
    assert!((at(&e, 5.0, 5.0) - 100.0).abs() < 1e-9, "the void post is the coarser's");
    assert!((at(&e, 5.0, 5.01) - 200.0).abs() < 1e-6, "continuous beside it");
    // Coarse posts inside: 3 × 3 lie in the inset; the middle one in its void, the others on its border.
    let found = posts(&e, 3.5, 3.5, 6.5, 6.5);
    let (fine_posts, coarse_posts) = (101 * 101 - 1, 9);
    assert_eq!(found.len(), fine_posts + coarse_posts);
    for (lat, lon, height) in found {
        assert!((height - at(&e, lat, lon)).abs() < 1e-6, "{lat} {lon}: {height}");
    }
    assert_eq!(e.goals(&GeoBounds::from_degrees(4.5, 4.5, 4.6, 4.6)).prune_error_m, DEFAULT_PRUNE_ERROR_M);
    assert_eq!((e.stats()[1].voids, e.stats()[1].posts), (1, 101 * 101));
}

#[test]
fn coarse_posts_deep_inside_a_finer_source_are_no_truth() {
    let folder = tempfile::tempdir().expect("folder");
    TiffOf::new(11, 11, vec![100.0f32; 121]).point(0.0, 10.0, 1.0).write(folder.path(), "coarse.tif");
    TiffOf::new(201, 201, vec![300.0f32; 201 * 201]).point(4.0, 6.0, 0.01).write(folder.path(), "fine.tif");
    let e =
        open(&(section("coarse.tif", "") + &section("fine.tif", "feather_m = 5000")), folder.path()).expect("sound");
    let found = posts(&e, 4.5, 4.5, 5.5, 5.5);
    assert_eq!(found.len(), 101 * 101, "fine ones only");
    assert!(found.iter().all(|p| p.2 == 300.0));
}

#[test]
fn a_global_grid_closes_at_the_antimeridian_and_the_poles() {
    let folder = tempfile::tempdir().expect("folder");
    // Pixel is area: 36 × 18 pixels of 10°, centres 5° from the poles and the antimeridian.
    let heights = (0..18).flat_map(|row| (0..36).map(move |col| (row * 100 + col) as i16)).collect::<Vec<_>>();
    TiffOf::new(36, 18, heights).area(-180.0, 90.0, 10.0).write(folder.path(), "g.tif");
    let e = open(&section("g.tif", ""), folder.path()).expect("sound");
    assert!((at(&e, 85.0, 180.0) - 17.5).abs() < 1e-9, "between the last and the first column");
    assert!((at(&e, 85.0, -180.0) - 17.5).abs() < 1e-9);
    assert!((at(&e, 90.0, -175.0) - 0.0).abs() < 1e-9, "the border row goes on to the pole");
    assert!((at(&e, -90.0, -165.0) - 1701.0).abs() < 1e-9);
    assert_eq!(posts(&e, -180.0, -90.0, 180.0, 90.0).len(), 36 * 18);
    assert_eq!(e.bounds(), [GeoBounds::from_degrees(-180.0, -90.0, 180.0, 90.0)]);
    // Pixel is point with posts on 180°: once from each side.
    TiffOf::new(4, 3, vec![7i16; 12]).point(-180.0, 90.0, 90.0).write(folder.path(), "p.tif");
    let e = open(&section("p.tif", ""), folder.path()).expect("sound");
    assert_eq!(posts(&e, 135.0, -45.0, 180.0, 45.0), [(0.0, 180.0, 7.0)]);
    assert_eq!(posts(&e, -180.0, -45.0, -135.0, 45.0), [(0.0, -180.0, 7.0)]);
}

#[test]
fn tiles_of_one_lattice_have_no_seam_and_missing_ones_are_feathered() {
    let folder = tempfile::tempdir().expect("folder");
    TiffOf::new(11, 11, vec![0.0f32; 121]).point(0.0, 10.0, 1.0).write(folder.path(), "coarse.tif");
    let tiles = folder.path().join("tiles");
    std::fs::create_dir(&tiles).expect("made");
    // Area pixels: tiles side by side that share no posts; the fourth is missing.
    for (name, west, north) in [("a.tif", 2.0, 6.0), ("b.tif", 4.0, 6.0), ("c.tif", 2.0, 4.0)] {
        TiffOf::new(100, 100, vec![500.0f32; 10_000]).area(west, north, 0.02).write(&tiles, name);
    }
    let e = open(&(section("coarse.tif", "") + &section("tiles", "feather_m = 20000")), folder.path()).expect("sound");
    assert!((at(&e, 5.0, 4.0) - 500.0).abs() < 1e-6, "between two tiles");
    assert!((at(&e, 4.0, 3.0) - 500.0).abs() < 1e-6);
    assert!(at(&e, 4.05, 5.0) < 100.0, "beside the missing tile: {}", at(&e, 4.05, 5.0));
    assert_eq!(at(&e, 3.0, 5.0), 0.0, "in the missing tile");
    assert_eq!(e.stats()[1].files, 3);
}

#[test]
fn every_kind_of_samples_and_compression() {
    let folder = tempfile::tempdir().expect("folder");
    let values: Vec<f64> = (0..12).map(|i| f64::from(i * 7 % 100)).collect();
    for (name, write) in test_files::every_kind() {
        write(&values, folder.path(), name);
        let e = open(&section(name, "feather_m = 0"), folder.path()).unwrap_or_else(|e| panic!("{name}: {e}"));
        let found = posts(&e, -180.0, -90.0, 180.0, 90.0);
        assert_eq!(found.iter().map(|p| p.2).collect::<Vec<_>>(), values, "{name}");
    }
}

#[test]
fn heights_are_clamped_in_the_sources_datum_and_lifted_to_the_ellipsoid() {
    let folder = tempfile::tempdir().expect("folder");
    TiffOf::new(3, 3, vec![-50i16; 9]).point(-4.0, 18.0, 1.0).write(folder.path(), "a.tif");
    let e = open("[[elevation]]\nfile = \"a.tif\"\nclamp_m = [0, 9000]", folder.path()).expect("sound");
    // Timbuktu: EGM96 is 28.70 m above the ellipsoid.
    assert!((at(&e, 16.775_833, -3.009_444) - 28.70).abs() < 0.1, "{}", at(&e, 16.775_833, -3.009_444));
}

/// What is wrong with a source, how the recipe names it, and what the one error must say.
#[test]
fn bad_sources_give_one_clear_error() {
    let folder = tempfile::tempdir().expect("folder");
    let root = folder.path();
    TiffOf::new(64, 64, vec![5.0f32; 4096]).point(0.0, 10.0, 0.1).write(root, "good.tif");
    TiffOf::new(64, 64, vec![5.0f32; 4096]).write(root, "nowhere.tif");
    TiffOf::new(4, 4, vec![-32_767i16; 16]).point(0.0, 10.0, 0.1).write(root, "odd.tif");
    TiffOf::new(4, 4, vec![-1i16; 16]).point(0.0, 10.0, 0.1).nodata("-1").write(root, "void.tif");
    TiffOf::new(4, 4, vec![1i16; 16]).point(0.0, 10.0, 0.1).epsg(1024, 60_001).write(root, "strange.tif");
    let whole = std::fs::read(root.join("good.tif")).expect("written");
    // The samples come first, the directory last: cut samples out of the middle, or the end off.
    std::fs::write(root.join("cut.tif"), &whole[..whole.len() / 2]).expect("written");
    std::fs::write(root.join("text.tif"), b"not a picture").expect("written");
    std::fs::write(root.join("N10E010.hgt"), [0u8; 1000]).expect("written");
    std::fs::write(root.join("bad.nc"), [0u8; 1000]).expect("written");
    std::fs::write(root.join("bad.zip"), [0u8; 1000]).expect("written");
    std::fs::create_dir(root.join("empty")).expect("made");
    for (file, more, says) in [
        ("missing.tif", "", &["missing.tif", "not found", "relative to the recipe"][..]),
        ("missing/*.tif", "", &["missing/*.tif", "no file that can be read"]),
        ("empty", "", &["empty", "no file that can be read"]),
        ("cut.tif", "", &["cut.tif", "TIFF header", "damaged or truncated"]),
        ("text.tif", "", &["text.tif", "TIFF header", "damaged or truncated"]),
        ("nowhere.tif", "", &["nowhere.tif", "no georeference"]),
        ("odd.tif", "", &["odd.tif, row 0, column 0", "nodata = -32767"]),
        ("void.tif", "", &["void.tif", "every post is void"]),
        ("strange.tif", "", &["strange.tif", "EPSG:60001", "crs ="]),
        ("good.tif", "crs = \"EPSG:1\"", &["good.tif", "EPSG:1", "not known"]),
        ("good.tif", "nodata = 1e300", &["good.tif", "nodata = 1", "cannot occur"]),
        ("N10E010.hgt", "", &["N10E010.hgt", "its length", "1000 bytes"]),
        ("bad.nc", "", &["bad.nc", "header", "netCDF"]),
        ("bad.zip", "", &["bad.zip", "zip directory"]),
    ] {
        let error = open(&section(file, more), root).err().unwrap_or_else(|| panic!("{file} {more} is no error"));
        let message = error.to_string();
        for part in says {
            assert!(message.contains(part), "{file}: {message:?} does not say {part:?}");
        }
    }
}

#[test]
fn a_tiff_whose_samples_are_cut_names_the_rows() {
    let folder = tempfile::tempdir().expect("folder");
    TiffOf::new(64, 64, vec![5.0f32; 4096]).point(0.0, 10.0, 0.1).write(folder.path(), "a.tif");
    let path = folder.path().join("a.tif");
    let mut bytes = std::fs::read(&path).expect("written");
    test_files::point_strips_beyond_the_end(&mut bytes);
    std::fs::write(&path, bytes).expect("written");
    let message = open(&section("a.tif", ""), folder.path()).err().expect("cut").to_string();
    assert!(message.contains("a.tif, rows ") && message.contains("truncated"), "{message}");
}

#[test]
fn memory_stays_within_its_limit_and_heights_the_same() {
    let folder = tempfile::tempdir().expect("folder");
    let heights: Vec<f32> = (0..256 * 256).map(|i| (i % 1000) as f32).collect();
    TiffOf::new(256, 256, heights).point(0.0, 10.0, 0.01).write(folder.path(), "a.tif");
    let recipe = format!("name = \"t\"\n{}", section("a.tif", "feather_m = 0"));
    let recipe = Recipe::parse(&recipe, Path::new("t.toml")).expect("sound");
    let roomy = Elevation::open(&recipe, folder.path(), MEMORY, &|_| {}).expect("sound");
    let tight = Elevation::open(&recipe, folder.path(), ByteSize(20_000), &|_| {}).expect("sound");
    for i in 0..500 {
        let (lat, lon) = (10.0 - 2.5 * f64::from(i * 37 % 500) / 500.0, 2.5 * f64::from(i * 101 % 500) / 500.0);
        assert_eq!(at(&roomy, lat, lon), at(&tight, lat, lon));
    }
}

/// A chunk that a sparse file leaves out has no data.
#[test]
fn chunks_left_out_are_void() {
    let folder = tempfile::tempdir().expect("folder");
    TiffOf::new(64, 64, vec![5.0f32; 4096]).point(0.0, 10.0, 0.1).strips_of(16).write(folder.path(), "a.tif");
    let path = folder.path().join("a.tif");
    let mut bytes = std::fs::read(&path).expect("written");
    test_files::leave_last_strip_out(&mut bytes);
    std::fs::write(&path, bytes).expect("written");
    let e = open(&section("a.tif", ""), folder.path()).expect("sound");
    assert_eq!(e.stats()[0].voids, 16 * 64);
}

/// Projections and turned rasters: every post is found again at its own place, the last rows and columns too.
#[test]
fn rasters_in_other_systems_find_their_posts_again() {
    let folder = tempfile::tempdir().expect("folder");
    let heights: Vec<f32> = (0..60 * 50).map(|i| (i * 37 % 1000) as f32).collect();
    for (code, west, north, step) in [
        (32_632, 500_000.0, 5_500_000.0, 30.0),
        (3031, -300_000.0, 250_000.0, 10_000.0),
        (32_601, 200_000.0, 5_500_000.0, 3_000.0),
        (2056, 2_600_000.0, 1_200_000.0, 0.5),
    ] {
        TiffOf::new(60, 50, heights.clone()).area(west, north, step).epsg(3072, code).write(folder.path(), "a.tif");
        let e = open(&section("a.tif", "feather_m = 0"), folder.path()).expect("sound");
        let found = posts(&e, -180.0, -90.0, 180.0, 90.0);
        assert_eq!(found.len(), 3000, "EPSG:{code}");
        for (post, expected) in found.iter().zip(&heights) {
            assert_eq!(post.2, f64::from(*expected));
            // Neighbours differ by up to 1000 m, control grids by up to 0.001 of a step.
            assert!((at(&e, post.0, post.1) - post.2).abs() < 5.0, "EPSG:{code} {post:?} {}", at(&e, post.0, post.1));
        }
        let bounds = e.bounds();
        assert!(
            found.iter().all(|p| bounds.iter().any(|b| b.contains(p.0.to_radians(), p.1.to_radians()))),
            "EPSG:{code}"
        );
    }
}

/// A neighbour that only shares a border with a source is none of its ground.
#[test]
fn a_touch_of_borders_asks_for_no_refinement() {
    let folder = tempfile::tempdir().expect("folder");
    TiffOf::new(11, 11, vec![5.0f32; 121]).point(0.0, 45.0, 0.1).write(folder.path(), "a.tif");
    let e = open(&section("a.tif", ""), folder.path()).expect("sound");
    assert_eq!(e.finest_spacing_rad(&GeoBounds::from_degrees(0.0, 45.0, 45.0, 90.0)), None);
    assert_eq!(e.finest_spacing_rad(&GeoBounds::from_degrees(-45.0, 0.0, 0.0, 45.0)), None);
    assert!(e.finest_spacing_rad(&GeoBounds::from_degrees(0.0, 0.0, 45.0, 45.0)).is_some());
}

/// A netCDF with latitudes from the south and longitudes from 0° to 350°, big-endian, written by hand.
fn write_netcdf(path: &Path) {
    let mut file = b"CDF\x01".to_vec();
    let word = |file: &mut Vec<u8>, v: u32| file.extend(v.to_be_bytes());
    let name = |file: &mut Vec<u8>, text: &str| {
        word(file, text.len() as u32);
        file.extend(text.bytes());
        file.resize(file.len().div_ceil(4) * 4, 0);
    };
    // No records; dimensions; no attributes of the file; three variables.
    [0, 10, 2].iter().for_each(|&v| word(&mut file, v));
    for (text, length) in [("lat", 19), ("lon", 36)] {
        name(&mut file, text);
        word(&mut file, length);
    }
    [0, 0, 11, 3].iter().for_each(|&v| word(&mut file, v));
    let begin = 512;
    for (text, dimension, length, at) in [("lat", 0, 19, begin), ("lon", 1, 36, begin + 19 * 4)] {
        name(&mut file, text);
        // One dimension, no attributes, f32.
        [1, dimension, 0, 0, 5, length * 4, at].iter().for_each(|&v| word(&mut file, v));
    }
    name(&mut file, "rose");
    [2, 0, 1, 12, 1].iter().for_each(|&v| word(&mut file, v));
    name(&mut file, "_FillValue");
    // One i16 (and two bytes to fill up), then the variable's own type.
    [3, 1, u32::from((-999i16) as u16) << 16, 3, 19 * 36 * 2, begin + 55 * 4].iter().for_each(|&v| word(&mut file, v));
    assert!(file.len() <= begin as usize);
    file.resize(begin as usize, 0);
    file.extend((0..19).flat_map(|i| (i as f32 * 10.0 - 90.0).to_be_bytes()));
    // As ETOPO5 has them: the last one rounded, the others spread evenly.
    file.extend((0..36).flat_map(|i| (i as f32 * 350.3 / 35.0).to_be_bytes()));
    file.extend((0..19 * 36).flat_map(|i| (if i == 100 { -999 } else { i as i16 }).to_be_bytes()));
    std::fs::write(path, file).expect("written");
}

#[test]
fn netcdf_from_the_south_and_from_greenwich_eastwards() {
    let folder = tempfile::tempdir().expect("folder");
    write_netcdf(&folder.path().join("a.nc"));
    let e = open(&section("a.nc", ""), folder.path()).expect("sound");
    for (lat, lon, height) in [(-80.0, 10.0, 37.0), (-80.0, -10.0, 71.0), (-80.0, 180.0, 54.0), (-80.0, -180.0, 54.0)] {
        assert!((at(&e, lat, lon) - height).abs() < 1e-9, "{lat} {lon}: {}", at(&e, lat, lon));
    }
    assert_eq!((e.stats()[0].voids, e.stats()[0].posts), (1, 19 * 36));
    assert_eq!(posts(&e, -180.0, -85.0, -135.0, -75.0).len(), 5);
    assert_eq!(posts(&e, 135.0, -85.0, 180.0, -75.0).len(), 5);
    let message = open(&section("a.nc", "layer = \"depth\""), folder.path()).err().expect("none").to_string();
    assert!(message.contains("depth") && message.contains("rose"), "{message}");
}

/// Files cut off anywhere, and with any byte flipped: an error or heights, never a panic.
#[test]
fn damaged_files_never_panic() {
    let folder = tempfile::tempdir().expect("folder");
    let heights: Vec<i16> = (0..400).map(|i| i as i16).collect();
    TiffOf::new(20, 20, heights).point(0.0, 10.0, 0.1).nodata("-9").write(folder.path(), "whole.tif");
    write_netcdf(&folder.path().join("whole.nc"));
    for extension in ["tif", "nc"] {
        let whole = std::fs::read(folder.path().join(format!("whole.{extension}"))).expect("written");
        let name = format!("bad.{extension}");
        let places = (0..whole.len().min(400)).chain(whole.len().saturating_sub(400).max(400)..whole.len());
        for place in places {
            let mut flipped = whole.clone();
            flipped[place] ^= 0x41;
            for bytes in [&whole[..place], &flipped] {
                std::fs::write(folder.path().join(&name), bytes).expect("written");
                let opened = open(&section(&name, ""), folder.path());
                assert!(opened.is_err() || bytes.len() == whole.len(), "{extension} cut at {place}");
            }
        }
    }
}

mod real;
