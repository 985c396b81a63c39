use super::*;
use crate::prepare::raster::test_files::{TiffOf, shared};
use tiff::encoder::colortype::{RGB8, RGBA8};

const MEMORY: ByteSize = ByteSize(1 << 30);

fn open(sections: &str, root: &Path) -> Result<Pictures, PrepareError> {
    let recipe = Recipe::parse(&format!("name = \"t\"\n{sections}"), Path::new("t.toml"))?;
    Pictures::open(&recipe, root, MEMORY, &|_| {})
}

fn at(pictures: &Pictures, lat_deg: f64, lon_deg: f64, texel_deg: f64) -> Option<[u8; 3]> {
    pictures.color(lat_deg.to_radians(), lon_deg.to_radians(), texel_deg.to_radians())
}

/// A picture of 36 × 18 pixels of 10°, each pixel's red its column and green its row.
fn globe(folder: &Path) {
    let image = image::RgbImage::from_fn(36, 18, |x, y| image::Rgb([x as u8 * 7, y as u8 * 14, 0]));
    image.save(folder.join("globe.png")).expect("written");
}

const GLOBE: &str = "[[imagery]]\nfile = \"globe.png\"\nbounds_deg = [-180, -90, 180, 90]\n";

#[test]
fn a_picture_with_bounds_lies_where_they_say() {
    let folder = tempfile::tempdir().expect("folder");
    globe(folder.path());
    let p = open(GLOBE, folder.path()).expect("sound");
    assert_eq!(at(&p, 85.0, -175.0, 0.1), Some([0, 0, 0]));
    assert_eq!(at(&p, -85.0, 175.0, 0.1), Some([245, 238, 0]));
    assert_eq!(at(&p, -25.0, 15.0, 0.1), Some([19 * 7, 11 * 14, 0]));
    assert!(at(&p, 90.0, 180.0, 0.1).is_some() && at(&p, -90.0, -180.0, 0.1).is_some());
    // Half way between the last and the first column, in linear light.
    let [red, ..] = at(&p, 85.0, 180.0, 0.1).expect("covered");
    assert_eq!(red, to_srgb(to_linear(245) / 2.0));
    assert!(
        (p.finest_texel_rad(&GeoBounds::from_degrees(0.0, 0.0, 1.0, 1.0)).expect("there").to_degrees() - 10.0).abs()
            < 1e-9
    );
}

#[test]
fn coarse_texels_are_averages() {
    let folder = tempfile::tempdir().expect("folder");
    let checker = image::RgbImage::from_fn(512, 512, |x, y| image::Rgb([if (x + y) % 2 == 0 { 255 } else { 0 }; 3]));
    checker.save(folder.path().join("c.png")).expect("written");
    let p = open("[[imagery]]\nfile = \"c.png\"\nbounds_deg = [0, 0, 5.12, 5.12]\nfeather_m = 0\n", folder.path())
        .expect("sound");
    for texel in [0.02, 0.03, 0.05, 0.16, 0.7] {
        for i in 0..20 {
            let [grey, ..] = at(&p, 2.5 + f64::from(i) * 0.013, 2.5 + f64::from(i) * 0.017, texel).expect("covered");
            assert!(grey.abs_diff(188) <= 24, "{texel}: {grey}");
        }
    }
}

#[test]
fn the_finer_lies_over_the_coarser_with_a_soft_seam() {
    let folder = tempfile::tempdir().expect("folder");
    globe(folder.path());
    TiffOf::new(100, 100, vec![255u8; 30_000]).area(10.0, 20.0, 0.1).write_as::<RGB8>(folder.path(), "fine.tif");
    let p = open(&format!("{GLOBE}[[imagery]]\nfile = \"fine.tif\"\n"), folder.path()).expect("sound");
    assert_eq!(at(&p, 15.0, 15.0, 0.1), Some([255; 3]));
    let (outside, seam) = (at(&p, 15.0, 9.99, 0.1).expect("globe"), at(&p, 15.0, 10.4, 0.1).expect("seam"));
    assert_eq!(outside[2], 0);
    assert!((100..250).contains(&seam[2]), "{seam:?}");
    let texel = |w: f64, s: f64| {
        p.finest_texel_rad(&GeoBounds::from_degrees(w, s, w + 1.0, s + 1.0)).expect("there").to_degrees()
    };
    assert!((texel(15.0, 15.0) - 0.1).abs() < 1e-9 && (texel(50.0, 15.0) - 10.0).abs() < 1e-9);
}

#[test]
fn tiles_of_one_set_have_no_seam_between_them() {
    let folder = tempfile::tempdir().expect("folder");
    globe(folder.path());
    let tiles = folder.path().join("tiles");
    std::fs::create_dir(&tiles).expect("made");
    for (name, west) in [("a.tif", 10.0), ("b.tif", 20.0)] {
        TiffOf::new(100, 100, vec![255u8; 30_000]).area(west, 20.0, 0.1).write_as::<RGB8>(&tiles, name);
    }
    let p = open(&format!("{GLOBE}[[imagery]]\nfile = \"tiles\"\n"), folder.path()).expect("sound");
    for lon in [19.9, 19.999, 20.0, 20.001, 20.1] {
        assert_eq!(at(&p, 15.0, lon, 0.1), Some([255; 3]), "{lon}");
    }
    assert!(at(&p, 15.0, 29.8, 0.1).expect("seam")[2] < 200);
    assert_eq!(p.sources().len(), 2, "one entry for the set");
}

#[test]
fn alpha_and_nodata_let_the_coarser_through() {
    let folder = tempfile::tempdir().expect("folder");
    globe(folder.path());
    let half: Vec<u8> = (0..10_000).flat_map(|i| [9, 9, 9, if i % 100 < 50 { 255 } else { 0 }]).collect();
    TiffOf::new(100, 100, half).area(10.0, 20.0, 0.1).write_as::<RGBA8>(folder.path(), "alpha.tif");
    let black: Vec<u8> = (0..10_000).flat_map(|i| [if i % 100 < 50 { 9 } else { 0 }; 3]).collect();
    TiffOf::new(100, 100, black).area(10.0, 20.0, 0.1).write_as::<RGB8>(folder.path(), "black.tif");
    for more in ["file = \"alpha.tif\"", "file = \"black.tif\"\nnodata = 0"] {
        let p = open(&format!("{GLOBE}[[imagery]]\n{more}\n"), folder.path()).expect("sound");
        assert_eq!(at(&p, 15.0, 13.0, 0.1), Some([9; 3]), "{more}");
        assert_eq!(at(&p, 15.0, 17.0, 0.1).map(|c| c[2]), Some(0), "{more}: the globe");
    }
    let alone = open("[[imagery]]\nfile = \"alpha.tif\"\n", folder.path()).expect("sound");
    assert_eq!(at(&alone, 15.0, 17.0, 0.1), None);
}

#[test]
fn bad_pictures_give_one_clear_error() {
    let folder = tempfile::tempdir().expect("folder");
    globe(folder.path());
    let whole = std::fs::read(folder.path().join("globe.png")).expect("written");
    std::fs::write(folder.path().join("cut.png"), &whole[..whole.len() / 2]).expect("written");
    std::fs::write(folder.path().join("text.jpg"), b"not a picture").expect("written");
    TiffOf::new(4, 4, vec![5u8; 48]).write_as::<RGB8>(folder.path(), "nowhere.tif");
    for (more, says) in [
        ("file = \"missing.png\"", "not found"),
        ("file = \"globe.png\"", "no georeference"),
        ("file = \"nowhere.tif\"", "no georeference"),
        ("file = \"cut.png\"\nbounds_deg = [0, 0, 1, 1]", "damaged or truncated"),
        ("file = \"text.jpg\"\nbounds_deg = [0, 0, 1, 1]", "damaged or truncated"),
    ] {
        let message = open(&format!("[[imagery]]\n{more}\n"), folder.path()).err().expect(more).to_string();
        assert!(message.contains(says), "{more}: {message}");
    }
    let recipe = Recipe::parse(&format!("name = \"t\"\n{GLOBE}"), Path::new("t.toml")).expect("sound");
    let message = Pictures::open(&recipe, folder.path(), ByteSize(100), &|_| {}).err().expect("too large").to_string();
    assert!(message.contains("globe.png") && message.contains("--memory"), "{message}");
}

#[test]
fn real_pictures() {
    let Some(root) = shared("dive") else { return };
    let p = open(
        "[[imagery]]\nfile = \"inset_ortho_5m.tif\"\n[[imagery]]\nfile = \"global_imagery_NaturalEarthII_2048x1024.png\"\nbounds_deg = [-180, -90, 180, 90]\n",
        &root,
    )
    .expect("sound");
    // The square of rows and columns 2000…2063; a mip's bilinear sample reaches a little beyond it.
    let texel = 4.627_369_068_287_146e-5;
    let (west, north) = (-84.484_768_518_518_52, 33.849_768_518_518_52);
    let color = at(&p, north - 2032.0 * texel, west + 2032.0 * texel, 64.0 * texel).expect("covered");
    for (band, expected) in color.into_iter().zip(ORTHO_MEAN) {
        assert!(band.abs_diff(expected) <= 6, "{color:?}");
    }
    let sahara = at(&p, 23.0, 10.0, 0.2).expect("covered");
    assert!(sahara[0] > sahara[2] && sahara[0] > 150, "{sahara:?}");
    let Some(root) = shared("swellendam") else { return };
    let p = open("[[imagery]]\nfile = \"*_RGB_LATLNG.tif\"\n", &root).expect("sound");
    assert_eq!(p.bounds().len(), 2);
    let [bounds, _] = p.bounds()[..] else { panic!("two") };
    assert!(p.color(bounds.center().lat_rad, bounds.center().lon_rad, 1e-6).is_some());
}

/// In linear light, by GDAL and numpy.
const ORTHO_MEAN: [u8; 3] = [128, 124, 117];
