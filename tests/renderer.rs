//! What a window asks of the renderer: culling in the drawn view, pictures without waiting, limits at run time, and the
//! loss of the device.

#![allow(clippy::unwrap_used, reason = "tests fail by panicking")]

mod scene;

use glam::DVec3;
use scene::{AOV, LIMITS, draw, painted_globe, piece, renderer, terrain, view};
use stoop::camera::View;
use stoop::content::{Page, PageId, PageKind};
use stoop::forest::{CellId, Zone};
use stoop::geodesy::OrientedBox;
use stoop::render::{DrawOptions, FrameStats, GpuLimits, RenderError, Renderer};
use stoop::select::{GroundPress, Selection};

type Picture = (Vec<u8>, Vec<u32>, Vec<f32>);

fn picture(renderer: &mut Renderer, view: &View, selection: &Selection) -> (FrameStats, Picture) {
    let stats = draw(renderer, view, selection);
    let pixels = (renderer.read_color().unwrap(), renderer.read_ids().unwrap(), renderer.read_depth_m().unwrap());
    (stats, pixels)
}

/// Boxes so large that all pieces are in all views.
fn never_culled(selection: &Selection) -> Selection {
    let mut selection = selection.clone();
    for piece in &mut selection.pieces {
        let everywhere = OrientedBox { half_m: DVec3::splat(1e9), ..piece.around };
        piece.around = everywhere;
    }
    selection
}

const VIEWS: [([f64; 3], [f64; 2]); 8] = [
    ([35.0, 20.0, 1e7], [0.0, -90.0]),
    ([35.0, 20.0, 1.5e5], [30.0, -12.0]),
    ([35.0, 20.0, 1e4], [30.0, -8.0]),
    ([-20.0, 179.9, 2e6], [120.0, -40.0]),
    ([89.0, 10.0, 3e5], [200.0, -25.0]),
    ([-0.1, -45.1, 6e3], [270.0, 1.0]),
    ([10.0, 100.0, 5e3], [10.0, 60.0]),
    ([67.0, -90.0, 3e7], [0.0, -89.0]),
];

#[test]
fn pieces_out_of_the_drawn_view_are_left_out_and_nobody_sees_it() {
    let mut renderer = renderer();
    let mut globe = painted_globe(&mut renderer);
    let mut culled = 0;
    for skirt_m in [0.0, 40_000.0] {
        globe.pieces.iter_mut().for_each(|piece| piece.skirt_m = skirt_m);
        for (eye, way) in VIEWS {
            let view = view(eye, way, 60.0, [160, 90]);
            let (some, with) = picture(&mut renderer, &view, &globe);
            let (all, without) = picture(&mut renderer, &view, &never_culled(&globe));
            assert!(with == without, "{eye:?} {way:?} with skirts of {skirt_m} m");
            assert_eq!((all.pieces, all.pieces_culled), (32, 0));
            assert_eq!(some.pieces + some.pieces_culled, 32);
            assert!(some.draw_calls <= some.pieces + 1 && some.pieces_built <= some.pieces);
            culled += some.pieces_culled;
        }
    }
    let looking_up = view([10.0, 100.0, 5e3], [10.0, 80.0], 40.0, [64, 64]);
    let (stats, _) = picture(&mut renderer, &looking_up, &globe);
    assert!(stats.pieces <= 1 && stats.terrain_triangles <= 2 * 64 * 64 + 4 * 2 * 64, "{stats:?}");
    assert!(culled > 2 * 8 * 12, "{culled} of {} pieces", 2 * 8 * 32);
}

#[test]
fn ground_that_is_pressed_down_into_the_view_is_drawn() {
    let mut renderer = renderer();
    let cell = CellId::containing(0.8, 0.2, 14);
    let page = terrain(cell, 8, &|_, _| 100.0, &|_, _| 100.0);
    let center = cell.bounds().center();
    // Level with the ground and looking slightly down, so that the ground comes into view by being pressed down only.
    let view = view([center.lat_deg(), center.lon_deg(), 102.0], [0.0, -20.0], 30.0, [64, 64]);
    let around = OrientedBox::around(&cell.bounds(), 99.0, 101.0);
    let mut selection = Selection { pieces: vec![piece(cell, &page, None)], ..Default::default() };
    selection.pieces[0].around = OrientedBox { half_m: around.half_m.with_y(1.0), ..around };
    selection.press = Some(GroundPress { depth_m: 200.0, radius_m: 4000.0 });
    let (stats, with) = picture(&mut renderer, &view, &selection);
    let (_, without) = picture(&mut renderer, &view, &never_culled(&selection));
    assert_eq!(stats.pieces, 1);
    assert!(with == without);
}

#[test]
fn what_the_lowest_ground_hides_depends_on_how_low_it_is() {
    let mut renderer = renderer();
    let globe = painted_globe(&mut renderer);
    let level = view([20.0, 10.0, 500.0], [0.0, 0.0], 60.0, [64, 36]);
    let drawn = |renderer: &mut Renderer, lowest_m| {
        renderer.draw(&level, &globe, &DrawOptions { lowest_m, ..AOV }).unwrap().pieces
    };
    let (high, low, lowest) =
        (drawn(&mut renderer, 0.0), drawn(&mut renderer, DrawOptions::LOWEST_M), drawn(&mut renderer, -6e6));
    assert!(high <= low && low < lowest, "{high} {low} {lowest}");
}

#[test]
fn a_picture_that_is_asked_for_comes_without_waiting_and_is_the_last_one() {
    let mut renderer = renderer();
    let globe = painted_globe(&mut renderer);
    assert!(matches!(renderer.request_picture(), Err(RenderError::NotDrawn { .. })));
    assert!(renderer.poll_picture().is_none());
    let first = view([35.0, 20.0, 1e7], [0.0, -90.0], 70.0, [161, 90]);
    draw(&mut renderer, &first, &globe);
    let expected = renderer.read_color().unwrap();
    renderer.request_picture().unwrap();
    // What is drawn meanwhile, in another size, and asked for again, does not change what was asked for.
    draw(&mut renderer, &view([0.0, 0.0, 1e7], [0.0, -90.0], 70.0, [64, 64]), &globe);
    renderer.request_picture().unwrap();
    renderer.finish().unwrap();
    let (size_px, pixels) = renderer.poll_picture().unwrap().unwrap();
    assert_eq!(size_px, first.size_px);
    assert!(pixels == expected);
    assert!(renderer.poll_picture().is_none(), "a picture comes once");
}

#[test]
fn limits_change_at_run_time() {
    let none = GpuLimits { imagery_bytes: 0, mesh_bytes: 0, objects_bytes: 0 };
    let mut renderer = Renderer::new(none).unwrap();
    let cells: Vec<_> = Zone::all().map(Zone::root).collect();
    let pages: Vec<Page> = cells.iter().map(|&cell| scene::imagery(cell, &|_, _| [90, 120, 60])).collect();
    let one_bytes = Renderer::gpu_bytes(&pages[0]);
    assert!(renderer.upload(&pages[0]).is_err());
    // Three pictures, then many, then no more.
    renderer.set_limits(GpuLimits { imagery_bytes: 3 * one_bytes, ..none });
    assert!(pages[..3].iter().all(|page| renderer.upload(page).is_ok()));
    assert!(renderer.upload(&pages[3]).is_err());
    assert_eq!(renderer.allocated_bytes(), 3 * one_bytes);
    renderer.set_limits(GpuLimits { imagery_bytes: 20 * one_bytes, ..none });
    assert!(pages[3..19].iter().all(|page| renderer.upload(page).is_ok()));
    assert!(renderer.upload(&pages[19]).is_err());
    assert_eq!(renderer.allocated_bytes(), 19 * one_bytes);
    renderer.set_limits(none);
    assert_eq!(renderer.allocated_bytes(), 19 * one_bytes, "what is there stays");
    assert!(renderer.upload(&pages[18]).is_ok() && renderer.upload(&pages[19]).is_err());
    cells.iter().for_each(|&cell| renderer.remove(PageId { cell, kind: PageKind::Imagery }));
    assert_eq!(renderer.allocated_bytes(), 0);
    // A lower limit of meshes holds from the next mesh on.
    renderer.set_limits(LIMITS);
    let globe = scene::bare_globe();
    draw(&mut renderer, &view([20.0, 30.0, 1e7], [0.0, -90.0], 60.0, [64, 36]), &globe);
    assert!(renderer.mesh_bytes() > 1 << 20);
    renderer.set_limits(GpuLimits { mesh_bytes: 512 << 10, ..LIMITS });
    draw(&mut renderer, &view([20.0, -150.0, 1e7], [0.0, -90.0], 60.0, [64, 36]), &globe);
    assert!(renderer.mesh_bytes() <= 512 << 10);
}

#[test]
fn a_lost_device_shows_and_a_new_renderer_takes_over() {
    let view = view([35.0, 20.0, 1e7], [0.0, -90.0], 70.0, [160, 90]);
    let mut old = renderer();
    let globe = painted_globe(&mut old);
    let (_, expected) = picture(&mut old, &view, &globe);
    old.request_picture().unwrap();
    assert!(!old.is_lost());
    old.lose_device();
    assert!(old.is_lost());
    let lost = |result: Result<(), RenderError>| assert!(matches!(result, Err(RenderError::Lost(_))), "{result:?}");
    lost(old.draw(&view, &globe, &AOV).map(drop));
    lost(old.draw(&scene::view([0.0, 0.0, 1e6], [0.0, -90.0], 60.0, [32, 32]), &globe, &AOV).map(drop));
    lost(old.read_color().map(drop));
    lost(old.request_picture());
    lost(old.poll_picture().unwrap().map(drop));
    lost(old.finish());
    old.flush_uploads();
    // Whoever owns the pages may go on handing them over until the loss is noticed.
    let page = scene::imagery(CellId::containing(0.1, 0.1, 5), &|_, _| [1, 2, 3]);
    let _ = old.upload(&page);
    old.remove(page.id());
    drop(old);
    let mut new = renderer();
    let globe = painted_globe(&mut new);
    let (_, again) = picture(&mut new, &view, &globe);
    assert!(expected == again);
}

#[test]
fn the_gpu_tells_its_time_once_a_frame_is_finished() {
    let mut renderer = renderer();
    let globe = painted_globe(&mut renderer);
    assert_eq!(renderer.gpu_ms(), None);
    // More frames than times are waited for.
    for step in 0..12 {
        draw(&mut renderer, &view([35.0, 20.0 + f64::from(step), 1e7], [0.0, -90.0], 70.0, [64, 36]), &globe);
    }
    renderer.finish().unwrap();
    match renderer.gpu_ms() {
        Some(ms) => assert!(ms.is_finite() && ms > 0.0, "{ms}"),
        None => assert!(!renderer.adapter_name().contains("llvmpipe"), "llvmpipe has timestamps"),
    }
}

#[test]
fn pictures_move_together_and_stay_as_they_are() {
    let mut renderer = renderer();
    let globe = painted_globe(&mut renderer);
    let seen = view([35.0, 20.0, 1e7], [0.0, -90.0], 60.0, [160, 90]);
    // Two of three pictures go: the chunks that held them are nearly empty.
    for (_, piece) in globe.pieces.iter().enumerate().filter(|(at, _)| at % 3 != 0) {
        renderer.remove(PageId { cell: piece.cell, kind: PageKind::Imagery });
    }
    let (before_bytes, (_, before)) = (renderer.allocated_bytes(), picture(&mut renderer, &seen, &globe));
    (0..8).for_each(|_| renderer.compact());
    let (_, after) = picture(&mut renderer, &seen, &globe);
    assert!(before == after);
    assert!(renderer.allocated_bytes() < before_bytes);
    renderer.compact();
    assert!(before == picture(&mut renderer, &seen, &globe).1, "nothing is left to move");
}
