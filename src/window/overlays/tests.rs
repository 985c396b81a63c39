use super::*;
use crate::camera::Pose;
use crate::content::{TerrainPage, TerrainPost};
use crate::forest::{Quadrant, Zone};
use crate::geodesy::OrientedBox;
use egui::{Pos2, RawInput, Rect};
use std::sync::Arc;

const SIZE_PX: [u32; 2] = [800, 600];

fn page(cell: CellId, height_m: f32) -> Arc<TerrainPage> {
    let post = |column, row| TerrainPost { column, row, height_m, parent_height_m: height_m, slope: [0, 0] };
    let posts = [(0, 0), (64, 0), (0, 64), (64, 64)].map(|(column, row)| post(column, row)).to_vec();
    Arc::new(TerrainPage::from_posts(cell, 1.0, posts).expect("four corners are a page"))
}

fn piece(cell: CellId, terrain: CellId, imagery: Option<CellId>) -> DrawPiece {
    let around = OrientedBox::around(&cell.bounds(), -10.0, 10.0);
    DrawPiece { cell, terrain: page(terrain, 0.0), imagery, own: 1.0, error_m: 0.0, skirt_m: 0.0, around }
}

fn own_pieces(level: u8) -> Vec<DrawPiece> {
    let mut cells: Vec<CellId> = Zone::all().map(Zone::root).collect();
    for _ in 0..level {
        cells = cells.into_iter().flat_map(CellId::children).collect();
    }
    cells.into_iter().map(|cell| piece(cell, cell, Some(cell))).collect()
}

fn view(lat_deg: f64, lon_deg: f64, height_m: f64, pitch_deg: f64) -> View {
    let eye = Geodetic::from_degrees(lat_deg, lon_deg, height_m);
    View::new(Pose { eye, heading_rad: 0.4, pitch_rad: pitch_deg.to_radians() }, 1.0, SIZE_PX)
}

/// Lines and texts of a frame.
fn drawn(overlays: Overlays, view: &View, pieces: &[DrawPiece]) -> (Vec<Vec<Pos2>>, Vec<(String, Pos2)>) {
    let ctx = Context::default();
    let size = egui::vec2(SIZE_PX[0] as f32, SIZE_PX[1] as f32);
    let input = RawInput { screen_rect: Some(Rect::from_min_size(Pos2::ZERO, size)), ..RawInput::default() };
    let output = ctx.run_pass(input, |ctx| show(ctx, overlays, &Drawn { view, pieces, lacking: &[] }));
    let (mut lines, mut texts) = (Vec::new(), Vec::new());
    for clipped in &output.shapes {
        match &clipped.shape {
            Shape::Path(path) => lines.push(path.points.clone()),
            Shape::LineSegment { points, .. } => lines.push(points.to_vec()),
            Shape::Text(text) => texts.push((text.galley.text().to_owned(), text.pos)),
            _ => {}
        }
    }
    output.drop_without_applying_deltas();
    (lines, texts)
}

const ZONES: Overlays = Overlays { zones: true, cells: false, page_state: false };
const CELLS: Overlays = Overlays { zones: false, cells: true, page_state: false };

/// The place on the ellipsoid that a point of the screen shows, in degrees; `None` for the sky.
fn place_at(view: &View, at: Pos2) -> Option<Geodetic> {
    let [width, height] = view.size_px.map(f64::from);
    let focal = view.focal_px();
    let ray = glam::DVec3::new(f64::from(at.x) - width / 2.0, height / 2.0 - f64::from(at.y), -focal).normalize();
    let ray = view.ecef_from_view().rotation() * ray;
    // In space scaled so that the ellipsoid is the unit ball.
    let radii =
        glam::DVec3::new(crate::geodesy::SEMI_MAJOR_M, crate::geodesy::SEMI_MAJOR_M, crate::geodesy::SEMI_MINOR_M);
    let (from, along) = (view.eye().xyz() / radii, ray / radii);
    let (a, b, c) = (along.length_squared(), from.dot(along), from.length_squared() - 1.0);
    let root = (b * b - a * c).max(0.0).sqrt();
    let distance = (-b - root) / a;
    (distance > 0.0).then(|| Geodetic::from_ecef(crate::geodesy::Point::new(view.eye().xyz() + ray * distance)))
}

/// How far a place is from the nearest border of zones, degrees.
fn off_border_deg(place: Geodetic) -> f64 {
    let off = |degrees: f64| (degrees / 45.0 - (degrees / 45.0).round()).abs() * 45.0;
    off(place.lat_deg()).min(off(place.lon_deg()) * place.lat_rad.cos())
}

#[test]
fn zone_borders_lie_where_the_grid_is_and_are_smooth() {
    for (lat_deg, lon_deg) in [(20.0, 10.0), (-80.0, 170.0), (90.0, 0.0), (45.0, 180.0)] {
        let view = view(lat_deg, lon_deg, 1.2e7, -90.0);
        let (lines, _) = drawn(ZONES, &view, &[]);
        let inside = Rect::from_min_max(Pos2::ZERO, egui::pos2(SIZE_PX[0] as f32, SIZE_PX[1] as f32));
        let (mut checked, mut length_px) = (0, 0.0);
        for pair in lines.iter().flat_map(|line| line.windows(2)) {
            length_px += pair[0].distance(pair[1]);
            // Between its points too: the line follows the arc.
            for share in [0.0, 0.3, 0.5, 1.0] {
                let at = pair[0] + (pair[1] - pair[0]) * share;
                let Some(place) = place_at(&view, at).filter(|_| inside.contains(at)) else { continue };
                // Near the rim a pixel is a long way on the ground.
                let to_eye = (view.eye() - place.to_ecef()).xyz();
                let grazing = to_eye.normalize().dot(place.up());
                if grazing < 0.1 {
                    continue;
                }
                let pixel_deg = (to_eye.length() / view.focal_px() / grazing / 111_000.0).max(1e-9);
                assert!(off_border_deg(place) < 1.5 * pixel_deg, "{place:?}");
                checked += 1;
            }
        }
        assert!(checked > 100 && length_px > 800.0, "{checked} {length_px}");
    }
}

#[test]
fn nothing_is_drawn_through_the_earth() {
    let view = view(20.0, 10.0, 1.2e7, -90.0);
    let horizon = HorizonCone::new(view.eye(), 0.0);
    // The antipode's borders project onto the globe's disc, and are hidden.
    let antipode = Geodetic::from_degrees(0.0, -170.0, 0.0).to_ecef();
    assert!(horizon.hides(antipode) && view.project_px(antipode).is_some());
    let (lines, texts) = drawn(CELLS, &view, &own_pieces(2));
    assert!(lines.len() > 50);
    let center = Geodetic::from_degrees(20.0, 10.0, 0.0).to_ecef();
    let rim =
        lines.iter().flatten().filter_map(|&at| place_at(&view, at)).map(|place| place.to_ecef().distance_m(center));
    assert!(rim.fold(0.0, f64::max) < 9e6);
    assert!(texts.len() > 10 && texts.iter().all(|(text, _)| text == "2"), "{texts:?}");
}

#[test]
fn close_to_the_ground_lines_still_show_and_are_few() {
    // 30 m over the corner of four zones, looking at the horizon: borders run from below the eye to the horizon.
    let view = view(44.9999, 0.0001, 30.0, -10.0);
    let (lines, _) = drawn(ZONES, &view, &[]);
    let points: usize = lines.iter().map(Vec::len).sum();
    assert!((2..400).contains(&points), "{points}");
    let lowest = lines.iter().flatten().map(|at| at.y).fold(0.0, f32::max);
    let highest = lines.iter().flatten().map(|at| at.y).fold(f32::MAX, f32::min);
    assert!(lowest >= SIZE_PX[1] as f32 && highest < 250.0, "{highest} {lowest}");
}

#[test]
fn points_cells_and_labels_are_bounded() {
    let pieces = own_pieces(5);
    assert!(pieces.len() > 10_000);
    let (lines, texts) = drawn(CELLS, &view(10.0, 10.0, 3e7, -90.0), &pieces);
    assert!(lines.len() <= CELLS_MAX * 5 && lines.iter().map(Vec::len).sum::<usize>() <= POINTS_MAX + 8);
    assert!(texts.len() <= LABELS_MAX);
    assert!(lines.len() > 500);
}

#[test]
fn no_view_makes_lines_without_end() {
    let pieces = own_pieces(1);
    for (height_m, pitch_deg) in [(0.0, 0.0), (-5000.0, 90.0), (f64::NAN, 0.0), (1e300, -90.0), (2.0, f64::INFINITY)] {
        let view = view(45.0, 45.0, height_m, pitch_deg);
        let all = Overlays { zones: true, cells: true, page_state: true };
        let (lines, _) = drawn(all, &view, &pieces);
        let points = lines.iter().flatten();
        assert!(points.clone().count() <= 2 * POINTS_MAX);
        assert!(points.clone().all(|at| at.x.is_finite() && at.y.is_finite()));
    }
}

#[test]
fn states_are_the_worst_of_what_lacks_below() {
    let root = Zone::root(Zone::new(20).unwrap());
    let child = root.child(Quadrant::SouthWest).unwrap();
    let other = root.child(Quadrant::NorthEast).unwrap();
    let grandchild = child.child(Quadrant::NorthEast).unwrap();
    let own = piece(child, child, Some(child));
    let coarse = piece(child, child, Some(root));
    for (drawn, lacking, state) in [
        (&own, vec![], PieceState::Own),
        (&own, vec![(other, PageState::Failed), (root, PageState::Failed)], PieceState::Own),
        (&own, vec![(grandchild, PageState::Requested)], PieceState::Requested),
        (&own, vec![(child, PageState::Requested), (grandchild, PageState::Failed)], PieceState::Failed),
        (&own, vec![(grandchild, PageState::Absent)], PieceState::StandIn),
        (&coarse, vec![], PieceState::StandIn),
        (&coarse, vec![(child, PageState::Requested)], PieceState::Requested),
    ] {
        let mut lacking = lacking;
        lacking.sort_unstable();
        assert_eq!(piece_state(drawn, &lacking), state, "{lacking:?}");
    }
    assert_eq!((label(&own), label(&coarse)), ("1".into(), "1 i0".into()));
    assert_eq!(label(&piece(child, root, None)), "1 t0 i–");
}

#[test]
fn zone_borders_rest_on_the_drawn_ground() {
    let root = Zone::root(Zone::new(20).unwrap());
    let mut high = piece(root, root, None);
    high.terrain = page(root, 3000.0);
    let view = view(10.0, 10.0, 1e6, -90.0);
    let pieces = [high];
    let scene = Scene::new(Drawn { view: &view, pieces: &pieces, lacking: &[] }, 1.0);
    let middle = root.bounds().center();
    let ground_m = scene.ground_m(middle.lat_rad, middle.lon_rad);
    assert_eq!(ground_m, surface_m(&pieces[0], middle));
    assert!(ground_m < 3000.0 && ground_m != 0.0);
    assert_eq!(scene.ground_m(-middle.lat_rad, middle.lon_rad), 0.0);
}
