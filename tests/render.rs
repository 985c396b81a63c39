//! What is drawn against f64 truth: silhouettes, depths, places of pixels; arenas and their limits.

#![allow(
    clippy::unwrap_used,
    clippy::single_range_in_vec_init,
    reason = "tests fail by panicking; ranges are meant as ranges"
)]

mod scene;

use glam::{DVec3, Mat3, Mat4, Vec3};
use scene::{AOV, LIMITS, bare_globe, draw, facing_plate, painted_globe, piece, plates, renderer, terrain, view};
use stoop::camera::View;
use stoop::content::{Page, PageId, PageKind};
use stoop::forest::{CellId, Zone};
use stoop::geodesy::{Ecef, Geodetic, Point, SEMI_MAJOR_M, SEMI_MINOR_M};
use stoop::render::{DrawOptions, Fading, GpuLimits, IdOf, RenderError, Renderer, SKY_ID};
use stoop::select::{DrawObjects, GroundPress, Selection};

/// The direction through the centre of a pixel, ECEF axes; the component along the view axis is 1.
fn ray(view: &View, x: u32, y: u32) -> DVec3 {
    let [width, height] = view.size_px.map(f64::from);
    let focal = view.focal_px();
    let local =
        DVec3::new((f64::from(x) + 0.5 - width / 2.0) / focal, (height / 2.0 - f64::from(y) - 0.5) / focal, -1.0);
    view.ecef_from_view().rotation() * local
}

/// Depth along the view axis at which the ray through a pixel meets the ellipsoid raised by `raise_m`.
fn ellipsoid_depth(view: &View, x: u32, y: u32, raise_m: f64) -> Option<f64> {
    let inverse = 1.0 / (DVec3::new(SEMI_MAJOR_M, SEMI_MAJOR_M, SEMI_MINOR_M) + raise_m);
    let (eye, way) = (view.eye().xyz() * inverse, ray(view, x, y) * inverse);
    let (a, b, c) = (way.length_squared(), eye.dot(way), eye.length_squared() - 1.0);
    let root = b * b - a * c;
    (root >= 0.0 && b < 0.0).then(|| (-b - root.sqrt()) / a)
}

fn pixels(view: &View) -> impl Iterator<Item = (u32, u32, usize)> + use<> {
    let [width, height] = view.size_px;
    (0..height).flat_map(move |y| (0..width).map(move |x| (x, y, (y * width + x) as usize)))
}

#[test]
fn thirty_two_roots_cover_the_disc_without_a_hole_at_the_right_depth() {
    let mut renderer = renderer();
    let selection = bare_globe();
    for [lat, lon, height_m] in [[20.0, 30.0, 1e7], [90.0, 0.0, 1e7], [-89.0, 170.0, 2e7], [0.0, 180.0, 4e6]] {
        let view = view([lat, lon, height_m], [0.0, -90.0], 60.0, [320, 180]);
        draw(&mut renderer, &view, &selection);
        let (ids, depths) = (renderer.read_ids().unwrap(), renderer.read_depth_m().unwrap());
        // A pixel at the limb is this large; diagonals between posts lie up to 240 m inside.
        let pixel_m = 2.0 * height_m / view.focal_px();
        for (x, y, at) in pixels(&view) {
            if let Some(truth) = ellipsoid_depth(&view, x, y, -pixel_m) {
                assert_ne!(ids[at], SKY_ID, "hole at {x} {y} from {lat} {lon}");
                assert!(matches!(renderer.resolve_id(ids[at]), Some(IdOf::Cell(_))));
                let surface = ellipsoid_depth(&view, x, y, 0.0).unwrap_or(truth);
                // At the limb a small difference in height is a long way along the ray.
                let up = Geodetic::from_ecef(view.eye() + stoop::geodesy::Vector::new(ray(&view, x, y) * surface)).up();
                let slant = -up.dot(ray(&view, x, y).normalize());
                let allowed = 250.0 / slant.max(0.02) + 1e-6 * surface;
                assert!((f64::from(depths[at]) - surface).abs() < allowed, "{x} {y}: {} {surface}", depths[at]);
            } else if ellipsoid_depth(&view, x, y, pixel_m).is_none() {
                assert_eq!(ids[at], SKY_ID, "ground beside the globe at {x} {y}");
                assert_eq!(depths[at], f32::INFINITY);
            }
        }
    }
}

fn selection_of(objects: Vec<DrawObjects>) -> Selection {
    Selection { objects, ..Default::default() }
}

/// Signed distance in pixels of a pixel's centre from the border of a convex polygon; positive inside.
fn inside_px(polygon: &[[f64; 2]; 4], x: u32, y: u32) -> f64 {
    let p = [f64::from(x) + 0.5, f64::from(y) + 0.5];
    (0..4)
        .map(|i| {
            let ([ax, ay], [bx, by]) = (polygon[i], polygon[(i + 1) % 4]);
            let (dx, dy) = (bx - ax, by - ay);
            // Counter-clockwise with y up is clockwise with y down.
            -(dx * (p[1] - ay) - dy * (p[0] - ax)) / dx.hypot(dy)
        })
        .fold(f64::INFINITY, f64::min)
}

fn street_view(step: u32) -> View {
    // A hand's breadth a frame, on a street of Helsinki.
    view([60.1699 + 1e-7 * f64::from(step), 24.9384, 21.7], [33.0 + 0.01 * f64::from(step), -2.0], 60.0, [320, 180])
}

fn street_plates(view: &View) -> Vec<[Point<Ecef>; 4]> {
    [[-0.9, 0.3, 8.0], [0.4, -0.2, 3.0], [15.0, 4.0, 40.0], [-300.0, 20.0, 900.0]]
        .map(|place| facing_plate(view, place, [place[2] / 6.0, place[2] / 5.0]))
        .to_vec()
}

#[test]
fn at_street_level_every_pixel_stands_where_f64_puts_it() {
    let mut renderer = renderer();
    let corners = street_plates(&street_view(0));
    let (lat, lon) = (60.1699f64.to_radians(), 24.9384f64.to_radians());
    let cell = CellId::containing(lat, lon, 14);
    let (page, objects) = plates(cell, cell.bounds().center().to_ecef(), &corners);
    renderer.upload(&page).unwrap();
    let selection = selection_of(vec![objects]);
    for step in 0..12 {
        let view = street_view(step);
        draw(&mut renderer, &view, &selection);
        let ids = renderer.read_ids().unwrap();
        for (index, plate) in corners.iter().enumerate() {
            let polygon = plate.map(|corner| view.project_px(corner).unwrap());
            let mut seen = 0;
            for (x, y, at) in pixels(&view) {
                let hit = renderer.resolve_id(ids[at]) == Some(IdOf::Object { collection: 1, id: index as u32 });
                let inside = inside_px(&polygon, x, y);
                assert!(inside.abs() < 0.1 || hit == (inside > 0.0), "plate {index} at {x} {y} in step {step}");
                seen += usize::from(hit);
            }
            assert!(seen > 100, "plate {index} is out of sight in step {step}");
        }
    }
}

#[test]
fn positions_in_f32_from_the_earths_centre_would_jump() {
    let mut worst_px = 0f64;
    for step in 0..12 {
        let view = street_view(step);
        let rotation: Mat3 = view.view_from_eye();
        let eye = view.eye().xyz().as_vec3();
        let clip_from_ecef = view.clip_from_view(0.2) * Mat4::from_mat3(rotation) * Mat4::from_translation(-eye);
        for corner in street_plates(&street_view(0)).into_iter().flatten() {
            let clip = clip_from_ecef * corner.xyz().as_vec3().extend(1.0);
            let at = Vec3::new(clip.x, clip.y, clip.z) / clip.w;
            let naive = [(f64::from(at.x) * 0.5 + 0.5) * 320.0, (0.5 - f64::from(at.y) * 0.5) * 180.0];
            let truth = view.project_px(corner).unwrap();
            worst_px = worst_px.max((naive[0] - truth[0]).hypot(naive[1] - truth[1]));
        }
    }
    assert!(worst_px > 5.0, "{worst_px}");
}

/// One part in ten thousand of the distance keeps two plates apart, whichever is drawn first.
#[test]
fn reversed_depth_keeps_the_order_from_one_metre_to_ten_thousand_kilometres() {
    let mut renderer = renderer();
    let view = view([10.0, 20.0, 100.0], [45.0, 10.0], 60.0, [64, 64]);
    let roots: Vec<_> = Zone::all().map(Zone::root).collect();
    for exponent in 0..=7 {
        let distance_m = 10f64.powi(exponent);
        for near_page_comes_first in [true, false] {
            let near = facing_plate(&view, [0.0, 0.0, distance_m], [distance_m; 2]);
            let far = facing_plate(&view, [0.0, 0.0, distance_m * 1.0001], [distance_m; 2]);
            // Pages are drawn from near to far by their origins; plates may lie elsewhere.
            let behind = view.ecef_from_view() * Point::new(DVec3::new(0.0, 0.0, 0.25 * distance_m));
            let beyond = view.ecef_from_view() * Point::new(DVec3::new(0.0, 0.0, -1.5 * distance_m));
            let (near_origin, far_origin) = if near_page_comes_first { (behind, beyond) } else { (beyond, behind) };
            let (near_page, near_draw) = plates(roots[0], near_origin, &[near]);
            let (far_page, far_draw) = plates(roots[1], far_origin, &[far, far]);
            let far_draw = DrawObjects { objects: vec![1..2], ..far_draw };
            renderer.upload(&near_page).unwrap();
            renderer.upload(&far_page).unwrap();
            draw(&mut renderer, &view, &selection_of(vec![near_draw, far_draw]));
            let middle = 32 * 64 + 32;
            let id = renderer.read_ids().unwrap()[middle];
            assert_eq!(renderer.resolve_id(id), Some(IdOf::Object { collection: 1, id: 0 }), "{distance_m} m");
            let depth = f64::from(renderer.read_depth_m().unwrap()[middle]);
            assert!((depth / distance_m - 1.0).abs() < 1e-5, "{depth} {distance_m}");
            renderer.remove(near_page.id());
            renderer.remove(far_page.id());
        }
    }
    assert_eq!(renderer.allocated_bytes(), 0);
}

#[test]
fn depth_from_zero_to_one_would_confuse_what_is_far() {
    let (near, far) = (0.2f32, 1e8f32);
    let standard = |z: f32| far / (far - near) - far * near / (far - near) / z;
    let reversed = |z: f32| near / z;
    assert_eq!(standard(1e7), standard(1.0001e7));
    assert!(reversed(1e7) > reversed(1.0001e7));
}

fn hills(lat: f64, lon: f64) -> f64 {
    200.0 + 60.0 * (lat * 40_000.0).sin() * (lon * 30_000.0).cos()
}

/// Looks straight down from 1 km at one piece of terrain; gives the depth in the middle.
fn depth_below(renderer: &mut Renderer, change: impl Fn(&mut Selection)) -> f64 {
    let cell = CellId::containing(0.8, 0.2, 11);
    let page = terrain(cell, 1, &|_, _| 100.0, &|_, _| 150.0);
    let center = cell.bounds().center();
    let view = view([center.lat_deg() + 1e-5, center.lon_deg() + 1e-5, 1000.0], [0.0, -90.0], 60.0, [65, 65]);
    let mut selection = Selection { pieces: vec![piece(cell, &page, None)], ..Default::default() };
    change(&mut selection);
    draw(renderer, &view, &selection);
    f64::from(renderer.read_depth_m().unwrap()[32 * 65 + 32])
}

#[test]
fn ground_morphs_to_its_parent_and_is_pressed_down_below_the_eye() {
    let mut renderer = renderer();
    let near = |depth: f64, truth: f64| assert!((depth - truth).abs() < 0.2, "{depth} {truth}");
    near(depth_below(&mut renderer, |_| {}), 900.0);
    near(depth_below(&mut renderer, |selection| selection.pieces[0].own = 0.0), 850.0);
    near(depth_below(&mut renderer, |selection| selection.pieces[0].own = 0.25), 862.5);
    let press = |depth_m, radius_m| {
        move |selection: &mut Selection| {
            selection.press = Some(GroundPress { depth_m, radius_m });
        }
    };
    near(depth_below(&mut renderer, press(40.0, 500.0)), 940.0);
}

#[test]
fn a_lift_raises_an_object_along_the_normal() {
    let mut renderer = renderer();
    let view = view([60.0, 25.0, 50.0], [0.0, 0.0], 60.0, [128, 128]);
    let cell = CellId::containing(60f64.to_radians(), 25f64.to_radians(), 12);
    let plate = facing_plate(&view, [0.0, 0.0, 30.0], [4.0, 4.0]);
    let (page, objects) = plates(cell, view.eye(), &[plate]);
    renderer.upload(&page).unwrap();
    let selection = selection_of(vec![objects]);
    let top_row = |renderer: &mut Renderer| {
        draw(renderer, &view, &selection);
        renderer.read_ids().unwrap().iter().position(|&id| id != SKY_ID).unwrap() as f64 / 128.0
    };
    let before = top_row(&mut renderer);
    renderer.set_lifts(page.id(), &[5.0, 7.0, 9.0]);
    let after = top_row(&mut renderer);
    let expected = 5.0 / 30.0 * view.focal_px();
    assert!((before.floor() - after.floor() - expected).abs() <= 1.0, "{before} {after} {expected}");
}

#[test]
fn what_comes_is_drawn_in_the_pixels_that_what_goes_leaves_out() {
    let mut renderer = renderer();
    let view = view([60.0, 25.0, 50.0], [0.0, 0.0], 60.0, [96, 96]);
    let plate = facing_plate(&view, [0.0, 0.0, 30.0], [8.0, 8.0]);
    // The same plate in two pages, lit alike: what goes is as good as what comes, but for its colour.
    let [(old_page, old), (new_page, new)] = [12, 13].map(|level| {
        let cell = CellId::containing(60f64.to_radians(), 25f64.to_radians(), level);
        plates(cell, view.eye(), &[plate])
    });
    renderer.upload(&old_page).unwrap();
    renderer.upload(&new_page).unwrap();
    let nothing = selection_of(vec![]);
    let options = DrawOptions { aov: false, ..AOV };
    let mut picture = |fading: &[Fading]| {
        renderer.draw_fading(&view, &nothing, &[], fading, &options).unwrap();
        renderer.read_color().unwrap().chunks_exact(4).map(<[u8; 4]>::try_from).collect::<Result<Vec<_>, _>>().unwrap()
    };
    let fading = |draw: &DrawObjects, share: f32, comes: bool| Fading { draw: draw.clone(), share, comes };
    let sky = picture(&[]);
    let whole = picture(&[fading(&new, 1.0, true)]);
    let covered = whole.iter().zip(&sky).filter(|(a, b)| a != b).count();
    assert!(covered > 400);
    assert_eq!(picture(&[fading(&old, 0.0, false)]), whole);
    for share in [0.0f32, 0.1, 0.25, 0.5, 0.8, 0.97, 1.0] {
        let (comes, goes) = (picture(&[fading(&new, share, true)]), picture(&[fading(&old, share, false)]));
        let mut counts = [0; 2];
        for at in 0..sky.len() {
            let drawn = [comes[at] != sky[at], goes[at] != sky[at]];
            assert_eq!(drawn[0] ^ drawn[1], whole[at] != sky[at], "pixel {at} at {share}");
            counts = [counts[0] + u32::from(drawn[0]), counts[1] + u32::from(drawn[1])];
        }
        let shown = f64::from(counts[0]) / covered as f64;
        assert!((shown - f64::from(share)).abs() < 0.08, "{shown} of {share}");
        assert_eq!(picture(&[fading(&new, share, true), fading(&old, share, false)]), whole, "both at {share}");
    }
}

#[test]
fn a_frame_whose_meshes_do_not_fit_is_drawn_in_parts_and_looks_the_same() {
    let mut small = Renderer::new(GpuLimits { mesh_bytes: 0, ..LIMITS }).unwrap();
    let mut large = renderer();
    let view = view([20.0, 30.0, 1e7], [0.0, -90.0], 60.0, [160, 90]);
    let picture = |renderer: &mut Renderer| {
        let selection = painted_globe(renderer);
        let stats = draw(renderer, &view, &selection);
        (stats, renderer.read_color().unwrap(), renderer.read_ids().unwrap())
    };
    let (small_stats, small_color, small_ids) = picture(&mut small);
    let (large_stats, large_color, large_ids) = picture(&mut large);
    assert!(small_stats.mesh_flushes > 4 && large_stats.mesh_flushes == 0);
    assert_eq!(small_stats.triangles, large_stats.triangles);
    assert_eq!(large_stats.pieces + large_stats.pieces_culled, 32);
    assert!(small_color == large_color && small_ids == large_ids);
    assert!(small.allocated_bytes() <= (256 << 10) + LIMITS.imagery_bytes);
    let again = draw(&mut large, &view, &bare_globe());
    assert_eq!(again.pieces_built, 0, "meshes of the same cells are kept");
}

#[test]
fn arenas_keep_their_limits_and_take_again_what_was_freed() {
    let limits = GpuLimits { imagery_bytes: 8 << 20, mesh_bytes: 1 << 20, objects_bytes: 600 };
    let mut renderer = Renderer::new(limits).unwrap();
    let cells: Vec<_> = Zone::all().map(Zone::root).collect();
    let pages: Vec<_> = cells.iter().map(|&cell| scene::imagery(cell, &|_, _| [90, 120, 60])).collect();
    let taken: Vec<_> = pages.iter().map(|page| renderer.upload(page).is_ok()).collect();
    let count = taken.iter().filter(|&&taken| taken).count();
    assert!((16..=24).contains(&count), "{count} pictures in 8 MiB");
    assert!(renderer.allocated_bytes() <= limits.imagery_bytes);
    renderer.remove(PageId { cell: cells[3], kind: PageKind::Imagery });
    assert!(renderer.upload(&pages[31]).is_ok());
    assert!(renderer.upload(&pages[30]).is_err());
    for &cell in &cells {
        renderer.remove(PageId { cell, kind: PageKind::Imagery });
    }
    assert_eq!(renderer.allocated_bytes(), 0);
    let view = street_view(0);
    let (page, _) = plates(cells[0], view.eye(), &street_plates(&view));
    let bytes = Renderer::gpu_bytes(&page);
    assert_eq!(renderer.upload(&page), Ok(bytes));
    let (other, draw_other) = plates(cells[1], view.eye(), &street_plates(&view));
    assert!(renderer.upload(&other).is_err());
    let stats = draw(&mut renderer, &view, &selection_of(vec![draw_other]));
    assert_eq!((stats.objects_missing, stats.object_triangles), (1, 0));
}

#[test]
fn a_missing_picture_is_taken_from_above_and_counted() {
    let mut renderer = renderer();
    let cell = CellId::containing(0.8, 0.2, 11);
    let above = cell.ancestor(9).unwrap();
    renderer.upload(&scene::imagery(above, &|_, _| [250, 20, 20])).unwrap();
    let page = terrain(cell, 4, &hills, &hills);
    let center = cell.bounds().center();
    let view = view([center.lat_deg(), center.lon_deg(), 2000.0], [0.0, -90.0], 60.0, [33, 33]);
    let selection = Selection { pieces: vec![piece(cell, &page, Some(cell))], ..Default::default() };
    let stats = draw(&mut renderer, &view, &selection);
    assert_eq!(stats.pieces_without_picture, 1);
    let color = renderer.read_color().unwrap();
    let middle = &color[(16 * 33 + 16) * 4..][..3];
    assert!(middle[0] > 150 && middle[1] < 110, "{middle:?}");
}

#[test]
fn the_world_image_is_drawn_where_no_picture_is() {
    let mut renderer = renderer();
    let cell = CellId::containing(0.8, 0.2, 3);
    let zone = cell.zone().root();
    let center = cell.bounds().center();
    // Red in the western half of the zone, green in the eastern one.
    let middle_rad = zone.bounds().center().lon_rad;
    let paint = |_, lon_rad: f64| if lon_rad < middle_rad { [250, 20, 20] } else { [20, 250, 20] };
    renderer.add_to_world_image(match &scene::imagery(zone, &paint) {
        Page::Imagery(picture) => picture,
        _ => unreachable!(),
    });
    assert_eq!(renderer.allocated_bytes(), 0, "it is no page");
    let page = terrain(cell, 4, &hills, &hills);
    let view = view([center.lat_deg(), center.lon_deg(), 200_000.0], [0.0, -90.0], 60.0, [33, 33]);
    let is_west = center.lon_rad < middle_rad;
    for imagery in [None, Some(cell)] {
        let selection = Selection { pieces: vec![piece(cell, &page, imagery)], ..Default::default() };
        let stats = draw(&mut renderer, &view, &selection);
        assert_eq!(stats.pieces_without_picture, u32::from(imagery.is_some()));
        let color = renderer.read_color().unwrap();
        let [red, green] = [0, 1].map(|channel| i32::from(color[(16 * 33 + 16) * 4 + channel]));
        let (painted, other) = if is_west { (red, green) } else { (green, red) };
        assert!(painted > other + 50, "{red} {green}");
    }
}

#[test]
fn what_was_not_drawn_is_not_read() {
    let mut renderer = renderer();
    assert!(matches!(renderer.read_color(), Err(RenderError::NotDrawn { .. })));
    let view = street_view(0);
    let plain = stoop::render::DrawOptions { aov: false, ..AOV };
    renderer.draw(&view, &Selection::default(), &plain).unwrap();
    assert_eq!(renderer.read_color().unwrap().len(), 320 * 180 * 4);
    assert!(matches!(renderer.read_ids(), Err(RenderError::NotDrawn { .. })));
    let huge = View::new(view.pose, 1.0, [100_000, 2]);
    assert!(matches!(renderer.draw(&huge, &Selection::default(), &plain), Err(RenderError::Size(..))));
    assert!(matches!(plates(Zone::new(0).unwrap().root(), view.eye(), &[]).0, Page::Objects(..)));
}
