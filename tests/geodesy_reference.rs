//! Geodesy against others: PROJ, PROJ's own test cases, GeographicLib's geodesics, published geoid grids.

use stoop::geodesy::{Course, Geodetic, VerticalDatum};

mod exact;
mod gie;

use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

fn shared_data() -> Option<PathBuf> {
    let data = Path::new(env!("CARGO_MANIFEST_DIR")).join("../shared/data");
    if data.is_dir() {
        return Some(data);
    }
    println!("skipped: ../shared/data is not here");
    None
}

/// Numbers from a file's lines.
fn numbers(text: &str) -> Vec<Vec<f64>> {
    text.lines().map(|line| line.split_whitespace().filter_map(|word| word.parse().ok()).collect()).collect()
}

/// What PROJ's `cct` makes of lines of coordinates; `None` where it is not installed.
fn cct(operation: &[&str], input: &str) -> Option<Vec<Vec<f64>>> {
    let run = Command::new("cct").args(operation).stdin(Stdio::piped()).stdout(Stdio::piped()).spawn();
    let Ok(mut child) = run else {
        println!("skipped: PROJ's cct is not installed (apt-get install proj-bin)");
        return None;
    };
    let mut stdin = child.stdin.take().expect("it is piped");
    let input = input.to_owned();
    let write = move || stdin.write_all(input.as_bytes());
    let writer = std::thread::Builder::new().name("cct-input".to_owned()).spawn(write).expect("a thread starts");
    let output = child.wait_with_output().expect("cct ends");
    writer.join().expect("the writer does not panic").expect("cct reads its input");
    Some(numbers(&String::from_utf8(output.stdout).expect("cct prints text")))
}

/// A few more places than 10,000: random ones up to 100 km of height, and poles, equator and antimeridian.
/// Multiples of 2⁻¹⁰, so that their decimals are the same number for every reader.
fn places() -> Vec<[f64; 3]> {
    let mut state = 0x9e37_79b9_7f4a_7c15u64;
    let mut random = |low: f64, high: f64| {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        ((low + (high - low) * (state >> 11) as f64 / (1u64 << 53) as f64) * 1024.0).round() / 1024.0
    };
    let mut places: Vec<_> =
        (0..10_000).map(|_| [random(-180.0, 180.0), random(-90.0, 90.0), random(-10_000.0, 100_000.0)]).collect();
    for lat in [-90.0, -89.999_023_437_5, 0.0, 0.000_976_562_5, 89.999_023_437_5, 90.0] {
        for lon in [-180.0, -90.0, 0.0, 45.0, 90.0, 180.0] {
            places.extend([0.0, -10_000.0, 100_000.0].map(|height_m| [lon, lat, height_m]));
        }
    }
    places
}

fn lines(places: impl IntoIterator<Item = [f64; 3]>) -> String {
    places.into_iter().map(|[x, y, z]| format!("{x:.10} {y:.10} {z:.10} 0\n")).collect()
}

#[test]
fn forward_agrees_with_proj() {
    let places = places();
    let Some(theirs) = cct(&["-d", "12", "+proj=cart", "+ellps=WGS84"], &lines(places.iter().copied())) else {
        return;
    };
    assert_eq!(theirs.len(), places.len());
    let (mut apart, mut ours_off, mut theirs_off) = (0f64, 0f64, 0f64);
    for ([lon, lat, height_m], proj) in places.into_iter().zip(theirs) {
        let place = Geodetic::from_degrees(lat, lon, height_m);
        let ours = place.to_ecef().xyz();
        let proj = glam::DVec3::new(proj[0], proj[1], proj[2]);
        let truth = exact::ecef(place.lat_rad, place.lon_rad, height_m);
        apart = apart.max(ours.distance(proj));
        ours_off = ours_off.max(exact::distance_m(truth, ours.to_array()));
        theirs_off = theirs_off.max(exact::distance_m(truth, proj.to_array()));
    }
    println!("forward: ours and PROJ apart {apart:.2e} m; off the truth: ours {ours_off:.2e}, PROJ {theirs_off:.2e} m");
    assert!(apart <= 10e-9, "{apart}");
    assert!(ours_off <= 3.5e-9, "{ours_off}");
}

#[test]
fn inverse_agrees_with_proj_or_is_the_one_that_is_right() {
    // Positions at multiples of 2⁻¹⁰ m, and the axis.
    let round = |v: f64| (v * 1024.0).round() / 1024.0;
    let points: Vec<[f64; 3]> = places()
        .into_iter()
        .map(|[lon, lat, height_m]| Geodetic::from_degrees(lat, lon, height_m).to_ecef().xyz().to_array().map(round))
        .chain([[0.0, 0.0, 6_356_752.0], [0.0, 0.0, -6_400_000.5], [6_378_137.0, 0.0, 0.0], [0.0, -6_478_137.0, 0.0]])
        .collect();
    let Some(theirs) = cct(&["-d", "15", "-I", "+proj=cart", "+ellps=WGS84"], &lines(points.iter().copied())) else {
        return;
    };
    assert_eq!(theirs.len(), points.len());
    let (mut apart, mut ours_off, mut theirs_off, mut disputed) = (0f64, 0f64, 0f64, 0);
    for (point, proj) in points.into_iter().zip(theirs) {
        let ours = Geodetic::from_ecef(stoop::geodesy::Point::new(glam::DVec3::from_array(point)));
        let proj = Geodetic::from_degrees(proj[1], proj[0], proj[2]);
        let off = |place: Geodetic| exact::distance_m(exact::ecef(place.lat_rad, place.lon_rad, place.height_m), point);
        let between = ours.to_ecef().distance_m(proj.to_ecef());
        if between > 10e-9 {
            disputed += 1;
            assert!(off(ours) < off(proj), "{point:?}: ours {}, PROJ {}", off(ours), off(proj));
        }
        apart = apart.max(between);
        ours_off = ours_off.max(off(ours));
        theirs_off = theirs_off.max(off(proj));
    }
    println!(
        "inverse: ours and PROJ apart {apart:.2e} m, {disputed} places by more than 10 nm; off the truth: \
         ours {ours_off:.2e}, PROJ {theirs_off:.2e} m"
    );
    // 5 nm, of which the rounding of angles to doubles takes up to half.
    assert!(ours_off <= 5e-9, "{ours_off}");
}

#[test]
fn proj_test_cases_pass() {
    let Some(data) = shared_data() else {
        return;
    };
    let mut total = 0;
    for (file, expected) in [
        ("gie/more_builtins.gie", 18),
        ("gie/builtins.gie", 9),
        ("gie/4D-API_cs2cs-style.gie", 8),
        ("gigs/5201.gie", 81),
    ] {
        let text = std::fs::read_to_string(data.join("geodesy").join(file)).expect("it is readable");
        let count = gie::run(&text).unwrap_or_else(|failure| panic!("{file}: {failure}"));
        println!("{file}: {count} cases");
        assert_eq!(count, expected, "{file}");
        total += count;
    }
    println!("{total} cases of PROJ's");
}

#[test]
fn geographiclib_geodesics_come_out() {
    let Some(data) = shared_data() else {
        return;
    };
    let text = std::fs::read_to_string(data.join("geodesy/GeodTest-100.dat")).expect("it is readable");
    let turn_m = |a: f64, b: f64, radius_m: f64| ((a - b).sin().abs()) * radius_m;
    let mut count = 0;
    for row in numbers(&text) {
        let [lat_1, lon_1, azi_1, lat_2, lon_2, azi_2, s_m, _arc, reduced_m, _area] = row[..] else {
            panic!("ten columns: {row:?}");
        };
        let (from, to) = (Geodetic::from_degrees(lat_1, lon_1, 0.0), Geodetic::from_degrees(lat_2, lon_2, 0.0));
        let (departure, arrival) = (azi_1.to_radians(), azi_2.to_radians());
        let course = Course::between(from, to);
        assert!((course.distance_m - s_m).abs() < 5e-8, "{row:?}: {course:?}");
        // A turn at the start moves the end by the reduced length.
        assert!(turn_m(course.departure_rad, departure, reduced_m.abs()) < 2e-7, "{row:?}: {course:?}");
        assert!(turn_m(course.arrival_rad, arrival, reduced_m.abs()) < 2e-7, "{row:?}: {course:?}");
        let (end, end_rad) = from.travel(departure, s_m);
        assert!(end.to_ecef().distance_m(to.to_ecef()) < 2e-7, "{row:?}: {end:?}");
        assert!(turn_m(end_rad, arrival, reduced_m.abs()) < 2e-7, "{row:?}");
        count += 1;
    }
    assert_eq!(count, 100);
}

/// A grid in PROJ's GTX format: big-endian header (south, west, steps, rows, columns), f32 from the south-west.
fn gtx(path: &Path) -> Option<Vec<[f64; 3]>> {
    let bytes = std::fs::read(path).ok()?;
    let number = |at: usize| f64::from_be_bytes(bytes[at..at + 8].try_into().expect("8 bytes"));
    let columns = u32::from_be_bytes(bytes[36..40].try_into().expect("4 bytes"));
    let (south, west, step_lat, step_lon) = (number(0), number(8), number(16), number(24));
    let values = bytes[40..].as_chunks::<4>().0.iter().map(|&value| f64::from(f32::from_be_bytes(value)));
    let place = |(at, value)| {
        let (row, column) = (at as u32 / columns, at as u32 % columns);
        [south + f64::from(row) * step_lat, west + f64::from(column) * step_lon, value]
    };
    Some(values.enumerate().map(place).collect())
}

fn undulation_m(datum: VerticalDatum, lat_deg: f64, lon_deg: f64) -> f64 {
    datum.undulation_m(lat_deg.to_radians(), lon_deg.to_radians())
}

#[test]
fn egm96_is_that_of_proj() {
    let installed = gtx(Path::new("/usr/share/proj/egm96_15.gtx")).map(|grid| (grid, 997, 0.005));
    let shared =
        shared_data().and_then(|data| gtx(&data.join("geodesy/egm96_15_downsampled.gtx"))).map(|grid| (grid, 97, 5.0));
    let grids = installed.into_iter().chain(shared).collect::<Vec<_>>();
    if grids.is_empty() {
        println!("skipped: no egm96_15.gtx here (apt-get install proj-data)");
    }
    for (grid, stride, most_m) in grids {
        let (mut worst, mut square, mut count) = (0f64, 0.0, 0);
        for &[lat, lon, value] in grid.iter().step_by(stride) {
            let off = (undulation_m(VerticalDatum::Egm96, lat, lon) - value).abs();
            worst = worst.max(off);
            square += off * off;
            count += 1;
        }
        let mean = (square / f64::from(count)).sqrt();
        println!("EGM96: {count} nodes, off {worst:.3} m at most, {mean:.4} m in the mean square");
        assert!(count > 500 && worst < most_m && mean < most_m / 10.0, "{worst} {mean}");
    }
}

#[test]
fn geoids_have_their_known_heights() {
    for (datum, lat, lon, height_m, within_m) in [
        // Timbuktu; the documentation of GeographicLib's GeoidEval.
        (VerticalDatum::Egm96, 16.0 + 46.0 / 60.0 + 33.0 / 3600.0, -3.0 - 34.0 / 3600.0, 28.7068, 0.02),
        // As PROJ has it from the grid of 15′.
        (VerticalDatum::Egm96, 55.5, 12.5, 36.021_313, 0.001),
        (VerticalDatum::Egm96, 55.5, 372.5, 36.021_313, 0.001),
        (VerticalDatum::Egm2008, 0.0, 0.0, 17.225, 0.002),
        (VerticalDatum::Egm2008, 72.0, 141.0, -1.603, 0.002),
        // Between nodes; Timbuktu by EGM2008.
        (VerticalDatum::Egm2008, 16.775_833, -3.009_444, 28.7422, 1.0),
        (VerticalDatum::Ellipsoid, 16.0, -3.0, 0.0, 0.0),
    ] {
        let found_m = undulation_m(datum, lat, lon);
        assert!((found_m - height_m).abs() <= within_m, "{datum:?} {lat} {lon}: {found_m}");
    }
    let pole = undulation_m(VerticalDatum::Egm96, 90.0, 0.0);
    for lon in [-180.0, -33.3, 90.0, 179.99] {
        assert!((undulation_m(VerticalDatum::Egm96, 90.0, lon) - pole).abs() < 1e-3);
    }
}

#[test]
fn between_nodes_egm96_is_close_to_its_harmonics() {
    let (mut worst, mut square) = (0f64, 0.0);
    let count = 300;
    for at in 0..count {
        // Golden-ratio places, even over the sphere.
        let lat = (1.0 - 2.0 * (f64::from(at) + 0.5) / f64::from(count)).asin().to_degrees();
        let lon = (f64::from(at) * 222.492_235_949_962).rem_euclid(360.0) - 180.0;
        let off = (undulation_m(VerticalDatum::Egm96, lat, lon) - egm96::egm96_compute_altitude_offset(lat, lon)).abs();
        worst = worst.max(off);
        square += off * off;
    }
    let mean = (square / f64::from(count)).sqrt();
    println!("between nodes: {worst:.3} m at most, {mean:.4} m in the mean square");
    assert!(worst < 1.0 && mean < 0.05, "{worst} {mean}");
}

#[test]
fn threads_agree_about_the_geoid() {
    let ask = || (0..200).map(|at| undulation_m(VerticalDatum::Egm96, 40.03 + f64::from(at) * 0.01, 7.1)).collect();
    let answers: Vec<Vec<f64>> = std::thread::scope(|scope| {
        [0; 4].map(|_| scope.spawn(ask)).map(|thread| thread.join().expect("no panic")).into()
    });
    assert!(answers.windows(2).all(|pair| pair[0] == pair[1]));
}

#[test]
fn datums_are_written_in_small_letters() {
    for (datum, name) in [
        (VerticalDatum::Ellipsoid, "\"ellipsoid\""),
        (VerticalDatum::Egm96, "\"egm96\""),
        (VerticalDatum::Egm2008, "\"egm2008\""),
    ] {
        assert_eq!(serde_json::to_string(&datum).expect("an enum"), name);
        assert_eq!(serde_json::from_str::<VerticalDatum>(name).expect("its own name"), datum);
    }
}
