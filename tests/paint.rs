//! Pictures painted from a real extract.
#![cfg(feature = "prepare")]

use std::path::Path;
use stoop::geodesy::SEMI_MAJOR_M;
use stoop::prepare::imagery_source::PictureSource;
use stoop::prepare::paint::OsmPainter;
use stoop::prepare::source::SourceFile;

fn monaco() -> Option<OsmPainter> {
    let file = "../shared/data/monaco/monaco-latest-without-changesets.osm.pbf";
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join(file);
    if !path.is_file() {
        println!("skipped: ../shared/data is not here");
        return None;
    }
    let section = toml::from_str("file = \"monaco.osm.pbf\"").expect("a sound section");
    Some(OsmPainter::open(&section, &SourceFile { path, inside: None }).expect("a sound extract"))
}

fn color(painter: &OsmPainter, lat_deg: f64, lon_deg: f64, texel_m: f64) -> Option<[u8; 4]> {
    painter.color(lat_deg.to_radians(), lon_deg.to_radians(), texel_m / SEMI_MAJOR_M)
}

fn is_water([r, _, b, _]: [u8; 4]) -> bool {
    b > r + 25
}

fn is_green([r, g, b, _]: [u8; 4]) -> bool {
    g > r && g > b + 20
}

#[test]
fn harbour_stadium_and_streets_are_where_they_are() {
    let Some(painter) = monaco() else { return };
    for texel_m in [0.5, 1.0, 4.0, 7.0] {
        let harbour = color(&painter, 43.7347, 7.4255, texel_m).expect("the harbour");
        let pitch = color(&painter, 43.72762, 7.41557, texel_m).expect("the stadium's lawn");
        let town = color(&painter, 43.7385, 7.4245, texel_m).expect("houses");
        assert!(is_water(harbour), "{harbour:?}");
        assert!(is_green(pitch), "{pitch:?}");
        assert!(!is_water(town) && !is_green(town), "{town:?}");
    }
}

#[test]
fn nothing_is_painted_where_nothing_is_mapped() {
    let Some(painter) = monaco() else { return };
    assert_eq!(color(&painter, 43.726, 7.445, 1.0), None, "open sea, far from all that is mapped");
    assert_eq!(color(&painter, 48.0, 2.0, 1.0), None);
    let bounds = painter.bounds()[0];
    assert!(painter.color(bounds.south_rad, bounds.west_rad, 1e-7).is_none_or(|color| color[3] < 8));
}

#[test]
fn tiles_meet_without_seams_and_threads_agree() {
    let Some(painter) = monaco() else { return };
    // Across the border between two tiles nothing jumps that would not jump elsewhere: neighbours in steps of a
    // hundredth of a texel differ by at most what a texel's edge allows.
    let center = painter.bounds()[0].center();
    let step = 0.01 / SEMI_MAJOR_M;
    let at = |i: i32| painter.color(center.lat_rad, center.lon_rad + f64::from(i - 200) * step, 1.0 / SEMI_MAJOR_M);
    let row: Vec<_> = (0..400).filter_map(at).collect();
    assert_eq!(row.len(), 400);
    for pair in row.windows(2) {
        for channel in 0..3 {
            assert!(pair[0][channel].abs_diff(pair[1][channel]) <= 4, "{pair:?}");
        }
    }
    let again: Vec<_> = std::thread::scope(|scope| {
        let halves = [0..200, 200..400].map(|half| scope.spawn(move || half.filter_map(at).collect::<Vec<_>>()));
        halves.into_iter().flat_map(|half| half.join().expect("no panic")).collect()
    });
    assert_eq!(row, again);
}
