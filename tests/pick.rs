//! What a pixel shows, where the ground is and what stands in the way: against the renderer's own depths over the
//! default world, and against each drawn triangle.

#![allow(clippy::unwrap_used, reason = "tests fail by panicking")]

use glam::DVec3;
use std::path::Path;
use std::sync::Arc;
use stoop::camera::{Pose, Surroundings, View};
use stoop::content::{ObjectMesh, ObjectPage, Page, PageId, Prism, TerrainPage, TerrainPost};

use stoop::engine::{DrawnGround, Engine, EngineParams, FrameRequest, Lifts, Mode, PickCache, PickWork, Source};
use stoop::forest::CellId;
use stoop::geodesy::{Geodetic, OrientedBox, Point, Ray, meets_front};
use stoop::render::{SKY_ID, is_cell};
use stoop::select::{DrawObjects, DrawPiece, Selection};
use stoop::store::World;

const SIZE_PX: [u32; 2] = [320, 180];
const HELSINKI: [f64; 2] = [60.1708, 24.9375];

fn world() -> Source {
    Source::of(World::open(&Path::new(env!("CARGO_MANIFEST_DIR")).join("tiles/default/world")).unwrap())
}

fn engine(source: &Source) -> Engine {
    Engine::new(source.clone(), EngineParams { mode: Mode::Settled, ..EngineParams::default() }).unwrap()
}

fn view([lat, lon]: [f64; 2], height_m: f64, [heading, pitch]: [f64; 2]) -> View {
    let eye = Geodetic::from_degrees(lat, lon, height_m);
    let pose = Pose { eye, heading_rad: heading.to_radians(), pitch_rad: pitch.to_radians() };
    View::new(pose, 60f64.to_radians(), SIZE_PX)
}

fn draw(engine: &mut Engine, view: View) {
    engine.frame(&FrameRequest { view, t_s: 0.0, ids: true }).unwrap();
}

/// Middles of pixels in rows and columns `step` apart, with their places in the picture.
fn pixels(step: usize) -> impl Iterator<Item = (usize, [f64; 2])> {
    let [width, height] = SIZE_PX.map(|side| side as usize);
    (step / 2..height).step_by(step).flat_map(move |y| {
        (step / 2..width).step_by(step).map(move |x| (y * width + x, [x as f64 + 0.5, y as f64 + 0.5]))
    })
}

/// How picks compare with a drawn picture.
#[derive(Debug, Default)]
struct Agreement {
    tried: u32,
    sky: u32,
    objects: u32,
    /// Depths that differ by more than a pixel is wide there.
    off: u32,
    /// Sky on one side only.
    holes: u32,
    most: PickWork,
}

fn compare(engine: &mut Engine, view: &View, step: usize) -> Agreement {
    let (depths_m, ids) = (engine.picture().read_depth().unwrap(), engine.picture().read_ids().unwrap());
    let around = engine.surroundings();
    let mut found = Agreement::default();
    for (at, at_px) in pixels(step) {
        let picked = around.pick(view, at_px);
        found.most.triangles = found.most.triangles.max(around.work().triangles);
        found.most.pieces = found.most.pieces.max(around.work().pieces);
        found.most.objects = found.most.objects.max(around.work().objects);
        found.most.boxes = found.most.boxes.max(around.work().boxes);
        found.tried += 1;
        found.objects += u32::from(ids[at] != SKY_ID && !is_cell(ids[at]));
        let drawn_m = f64::from(depths_m[at]);
        match picked {
            None if drawn_m.is_infinite() => found.sky += 1,
            Some(point) if drawn_m.is_finite() => {
                let picked_m = (point - view.eye()).xyz().dot(view.forward());
                let is_off = (picked_m - drawn_m).abs() > drawn_m / view.focal_px();
                found.off += u32::from(is_off);
                if is_off {
                    println!("off at {at_px:?}: picked {picked_m} drawn {drawn_m}, beside {:?}", beside(&depths_m, at));
                }
            }
            other => {
                println!("hole at {at_px:?}: picked {other:?} drawn {drawn_m}");
                found.holes += 1;
            }
        }
    }
    found
}

/// The four depths round a pixel, to tell a silhouette from a fault.
fn beside(depths_m: &[f32], at: usize) -> [Option<f32>; 4] {
    let width = SIZE_PX[0] as usize;
    [at.checked_sub(1), Some(at + 1), at.checked_sub(width), Some(at + width)]
        .map(|at| at.and_then(|at| depths_m.get(at).copied()))
}

#[test]
fn picks_are_where_the_picture_is() {
    let mut engine = engine(&world());
    let places = [
        (HELSINKI, 1e7, [0.0, -90.0]),
        (HELSINKI, 1e7, [30.0, -60.0]),
        (HELSINKI, 1e4, [0.0, -90.0]),
        (HELSINKI, 1e4, [200.0, -15.0]),
        (HELSINKI, 500.0, [0.0, -90.0]),
        (HELSINKI, 500.0, [120.0, -20.0]),
        (HELSINKI, 50.0, [300.0, -60.0]),
        (HELSINKI, 50.0, [60.0, -8.0]),
        ([37.83, -122.48], 900.0, [150.0, -12.0]),
        ([89.99, 10.0], 3e5, [20.0, -90.0]),
        // Above the ice: the press of an eye below would turn the skirts at the pole, where no direction is north.
        ([-89.9999, 10.0], 4e3, [20.0, -20.0]),
        ([-17.0, 179.99], 2e4, [90.0, -30.0]),
        ([66.0, -179.999], 1e6, [-90.0, -70.0]),
    ];
    let (mut tried, mut wrong, mut objects, mut sky) = (0, 0, 0, 0);
    for (place, height_m, turned) in places {
        let view = view(place, height_m, turned);
        draw(&mut engine, view);
        let found = compare(&mut engine, &view, 7);
        println!("{place:?} {height_m} m {turned:?}: {found:?}");
        let allowed = f64::from(found.tried) * 0.005;
        assert!(f64::from(found.off + found.holes) <= allowed, "{place:?} {height_m} m {turned:?}: {found:?}");
        tried += found.tried;
        wrong += found.off + found.holes;
        objects += found.objects;
        sky += found.sky;
    }
    println!("{wrong} of {tried} off");
    assert!(objects > 1000 && sky > 1000, "{objects} pixels of objects and {sky} of the sky try little");
}

#[test]
fn an_eye_in_the_ground_picks_what_is_pressed_down_round_it() {
    let mut engine = engine(&world());
    // Under Mount Tamalpais.
    let view = view([37.9292, -122.5777], 600.0, [40.0, -25.0]);
    draw(&mut engine, view);
    assert!(engine.drawn().press.unwrap().buries_eye());
    let found = compare(&mut engine, &view, 7);
    assert!(f64::from(found.off + found.holes) <= f64::from(found.tried) * 0.005, "{found:?}");
    let ground_m = engine.surroundings().ground_m(view.pose.eye.lat_rad, view.pose.eye.lon_rad).unwrap();
    assert!(ground_m > 650.0, "what navigation keeps above is not pressed: {ground_m}");
}

/// The nearest front of all drawn terrain less its skirts, with the morph at 1.
fn nearest_of_all(selection: &Selection, ray: &Ray) -> Option<f64> {
    selection.pieces.iter().flat_map(|piece| terrain_hits(piece, ray)).min_by(f64::total_cmp)
}

fn terrain_hits(piece: &DrawPiece, ray: &Ray) -> Vec<f64> {
    let mesh = piece.terrain.cut(piece.cell);
    let corner = |index: &u32| {
        let vertex = &mesh.vertices[*index as usize];
        let own = mesh.origin.xyz() + DVec3::from(vertex.position_m.map(f64::from));
        let rise_m = (1.0 - f64::from(piece.own)) * f64::from(vertex.morph_m);
        own + Geodetic::from_ecef(Point::new(own)).up() * rise_m - ray.origin.xyz()
    };
    let surface = &mesh.indices[..mesh.surface_len as usize];
    let triangles = surface.chunks_exact(3).map(|t| [corner(&t[0]), corner(&t[1]), corner(&t[2])]);
    triangles.filter_map(|corners| meets_front(ray.direction, corners)).collect()
}

/// The nearest front of all drawn objects, as stored.
fn nearest_object(source: &Source, selection: &Selection, rays: &[Ray]) -> Vec<Option<f64>> {
    let mut nearest = vec![None::<f64>; rays.len()];
    for drawn in &selection.objects {
        let mesh = mesh_of(source, drawn.page.id());
        for range in drawn.objects.iter().map(|range| drawn.page.indices_of(range.clone())) {
            for t in mesh.indices[range.start as usize..range.end as usize].chunks_exact(3) {
                let corners = [t[0], t[1], t[2]].map(|index| {
                    drawn.page.origin.xyz() + DVec3::from(mesh.vertices[index as usize].position_m.map(f64::from))
                });
                for (nearest, ray) in nearest.iter_mut().zip(rays) {
                    let hit = meets_front(ray.direction, corners.map(|corner| corner - ray.origin.xyz()));
                    *nearest = [*nearest, hit].into_iter().flatten().min_by(f64::total_cmp);
                }
            }
        }
    }
    nearest
}

fn mesh_of(source: &Source, id: PageId) -> Arc<ObjectMesh> {
    let stoop::content::PageKind::Objects { collection, rep } = id.kind else { panic!("a page of objects") };
    let node = source.index.find(id.cell).unwrap();
    let entry = node.objects().find(|entry| (entry.collection, entry.rep) == (collection, rep)).unwrap();
    let Page::Objects(_, mesh) = source.reader.load(id, entry.place).unwrap() else { panic!("a page of objects") };
    mesh
}

#[test]
fn the_nearest_of_all_triangles_is_picked_with_little_work() {
    let source = world();
    let mut engine = engine(&source);
    for (height_m, turned, step) in [(300.0, [120.0, -20.0], 29), (2e6, [0.0, -70.0], 61)] {
        let view = view(HELSINKI, height_m, turned);
        draw(&mut engine, view);
        let (cache, lifts) = (PickCache::default(), Lifts::default());
        // Without lifts, as the meshes are stored.
        let around = DrawnGround::new(engine.drawn(), &lifts, &cache);
        let at_px: Vec<_> = pixels(step).map(|(_, at_px)| at_px).collect();
        let ray = |&at_px: &[f64; 2]| Ray { origin: view.eye(), direction: view.ray(at_px) };
        let rays: Vec<_> = at_px.iter().map(ray).collect();
        let objects = nearest_object(&source, engine.drawn(), &rays);
        let (mut same, mut nearer) = (0, 0);
        for ((&at_px, ray), object) in at_px.iter().zip(&rays).zip(objects) {
            let ground = nearest_of_all(engine.drawn(), ray);
            let wanted = [ground, object].into_iter().flatten().min_by(f64::total_cmp);
            let picked = around.pick(&view, at_px).map(|point| point.distance_m(view.eye()));
            match (picked, wanted) {
                (Some(picked), Some(wanted)) if (picked - wanted).abs() < 0.05 + 1e-6 * wanted => same += 1,
                (None, None) => same += 1,
                // A skirt, which is drawn where pieces part.
                (Some(picked), wanted) if wanted.is_none_or(|wanted| picked < wanted) => nearer += 1,
                other => panic!("{height_m} m at {at_px:?}: {other:?}"),
            }
        }
        println!("{height_m} m: {same} the same, {nearer} on skirts");
        assert!(same > 10 && nearer * 100 <= same, "{same} {nearer}");
    }
}

/// 20,000 houses of 12 × 12 m in rows 20 m apart over flat ground, in one page.
fn made_up_city() -> Selection {
    let root = CellId::containing(0.59, -1.47, 10);
    let center = root.bounds().center();
    let frame = center.ecef_from_enu();
    let house = |n: u32| {
        let (x, y) = (f64::from(n % 200) * 20.0 - 2_000.0, f64::from(n / 200) * 20.0 - 1_000.0);
        let corner = |dx: f64, dy: f64| Geodetic::from_ecef(frame * Point::new(DVec3::new(x + dx, y + dy, 0.0)));
        let place = corner(6.0, 6.0);
        let ring = [(0.0, 0.0), (12.0, 0.0), (12.0, 12.0), (0.0, 12.0)].map(|(dx, dy)| {
            let corner = corner(dx, dy);
            [corner.lon_rad, corner.lat_rad]
        });
        Prism {
            id: n,
            cell: CellId::containing(place.lat_rad, place.lon_rad, 16),
            rings: vec![ring.to_vec()],
            roof: vec![[0, 1, 2], [0, 2, 3]],
            base_m: 0.0,
            top_m: 5.0 + (n * 7919 % 23) as f32,
            foundation_m: 2.0,
            wall_color: [0; 3],
            roof_color: [0; 3],
            detail: None,
        }
    };
    let (page, _) = ObjectPage::from_prisms(root, 0, 0, 0.0, (0..20_000).map(house).collect());
    let posts = [(0, 0), (64, 0), (0, 64), (64, 64)].map(|(column, row)| TerrainPost {
        column,
        row,
        height_m: 0.0,
        parent_height_m: 0.0,
        slope: [0; 2],
    });
    let terrain = Arc::new(TerrainPage::from_posts(root, 1.0, posts.to_vec()).unwrap());
    let around = OrientedBox::around(&root.bounds(), -10.0, 10.0);
    let piece = DrawPiece { cell: root, terrain, imagery: None, own: 1.0, error_m: 0.0, skirt_m: 1.0, around };
    let objects = vec![DrawObjects { page: Arc::new(page), objects: std::iter::once(0..20_000).collect() }];
    Selection { pieces: vec![piece], objects, ..Selection::default() }
}

#[test]
fn a_pick_in_a_city_looks_at_a_small_part_of_it() {
    let city = made_up_city();
    let page = &city.objects[0].page;
    let (lifts, cache) = (Lifts::default(), PickCache::default());
    let around = DrawnGround::new(&city, &lifts, &cache);
    let center = page.root.bounds().center();
    let (mut on_houses, mut on_ground) = (0, 0);
    for (height_m, turned) in [(400.0, [0.0, -90.0]), (60.0, [37.0, -12.0]), (4.0, [90.0, -1.0]), (9.0, [3.0, -4.0])] {
        let view = view([center.lat_deg(), center.lon_deg()], height_m, turned);
        for (_, at_px) in pixels(9) {
            let picked = around.pick(&view, at_px);
            let work = around.work();
            assert!(
                work.objects <= 64 && work.boxes <= 5_000 && work.triangles <= 64,
                "{work:?} of 20,000 at {at_px:?}"
            );
            let Some(place) = picked.map(Geodetic::from_ecef) else { continue };
            let obstacle = around.obstacle(place.lat_rad, place.lon_rad, 0.01);
            assert!(around.work().objects <= 4 && around.work().boxes <= 2_500, "{:?} of 20,000", around.work());
            match obstacle {
                Some(house) => assert!(place.height_m < house.top_m + 0.01 && house.base_m == -2.0),
                // Four kilometres of flat triangle lie deepest in their middle.
                None => assert!(place.height_m < 0.1, "{place:?} stands on nothing"),
            }
            on_houses += u32::from(obstacle.is_some());
            on_ground += u32::from(obstacle.is_none());
        }
    }
    assert!(on_houses > 300 && on_ground > 300, "{on_houses} {on_ground}");
}

#[test]
fn what_is_not_drawn_of_a_page_is_not_picked_but_stands_in_the_way() {
    let mut city = made_up_city();
    let (lifts, cache) = (Lifts::default(), PickCache::default());
    let page = Arc::clone(&city.objects[0].page);
    for which in [0usize, 7, 8, 9_999, 19_999] {
        let object = &page.objects[which];
        let view = view([object.lat_rad.to_degrees(), object.lon_rad.to_degrees()], 200.0, [0.0, -90.0]);
        let height_m = |city: &Selection| {
            let around = DrawnGround::new(city, &lifts, &cache);
            assert_eq!(around.obstacle(object.lat_rad, object.lon_rad, 0.0).unwrap().top_m, f64::from(object.top_m));
            Geodetic::from_ecef(around.pick(&view, [160.0, 90.0]).unwrap()).height_m
        };
        let at = which as u32;
        city.objects[0].objects = vec![0..at, at + 1..20_000];
        assert!(height_m(&city) < 1.0);
        city.objects[0].objects = vec![0..at / 2, at..at + 1];
        assert!((height_m(&city) - f64::from(object.top_m)).abs() < 1e-3);
    }
}

#[test]
fn obstacles_are_the_highest_of_all_that_hold_a_place() {
    let mut engine = engine(&world());
    let view = view(HELSINKI, 250.0, [0.0, -90.0]);
    draw(&mut engine, view);
    let ids = engine.picture().read_ids().unwrap();
    let (around, drawn) = (engine.surroundings(), engine.drawn());
    let (mut met, mut none) = (0, 0);
    for (at, at_px) in pixels(11) {
        let Some(point) = around.pick(&view, at_px) else { continue };
        let place = Geodetic::from_ecef(point);
        for margin_m in [0.0, 0.1, 2.5] {
            let all = drawn.objects.iter().flat_map(|drawn| (0..drawn.page.objects.len()).map(move |at| (drawn, at)));
            let holding = all.filter(|(d, at)| d.page.footprint_holds(*at, place.lat_rad, place.lon_rad, margin_m));
            let tops = holding.map(|(drawn, at)| f64::from(drawn.page.objects[at].top_m));
            let wanted = tops.max_by(f64::total_cmp);
            let found = around.obstacle(place.lat_rad, place.lon_rad, margin_m);
            // The finest terrain is drawn here: nothing is lifted.
            assert_eq!(found.map(|obstacle| obstacle.top_m), wanted, "{place:?} {margin_m}");
            met += u32::from(found.is_some());
            none += u32::from(found.is_none());
            let shows_object = ids[at] != SKY_ID && !is_cell(ids[at]);
            if shows_object && margin_m > 0.0 {
                let found = found.expect("an object is drawn here");
                assert!(found.base_m < found.top_m && place.height_m < found.top_m + 0.05, "{place:?} {found:?}");
            }
        }
    }
    assert!(met > 100 && none > 100, "{met} places in buildings, {none} not");
}

#[test]
fn the_ground_is_where_it_is_picked() {
    let mut engine = engine(&world());
    for (place, height_m) in
        [(HELSINKI, 1e4), ([37.93, -122.58], 3e3), ([89.9999, 0.0], 1e5), ([10.0, 179.9999], 1e6), ([0.0, -180.0], 1e7)]
    {
        let view = view(place, height_m, [10.0, -90.0]);
        draw(&mut engine, view);
        let mut tried = 0;
        for (_, at_px) in pixels(23) {
            let around = engine.surroundings();
            let Some(point) = around.pick(&view, at_px) else { continue };
            if around.work().objects > 0 {
                continue;
            }
            let there = Geodetic::from_ecef(point);
            for turn in [0.0, std::f64::consts::TAU, -std::f64::consts::TAU] {
                let ground_m = around.ground_m(there.lat_rad, there.lon_rad + turn).unwrap();
                // f32 meshes round by their size, and seams part by what skirts hide.
                assert!((ground_m - there.height_m).abs() < 0.05 + 2e-6 * height_m, "{there:?} {ground_m}");
            }
            tried += 1;
        }
        assert!(tried > 20, "{place:?} {tried}");
    }
}

#[test]
fn nothing_drawn_is_sky_without_ground_or_obstacles() {
    let (selection, lifts, cache) = (Selection::default(), Lifts::default(), PickCache::default());
    let around = DrawnGround::new(&selection, &lifts, &cache);
    let view = view(HELSINKI, 100.0, [0.0, -90.0]);
    assert_eq!(around.pick(&view, [160.0, 90.0]), None);
    assert_eq!((around.ground_m(1.0, 0.4), around.obstacle(1.0, 0.4, 1e9)), (None, None));
    // A piece whose box is somewhere else is not looked into.
    let mut engine = engine(&world());
    draw(&mut engine, view);
    let mut moved = engine.drawn().clone();
    moved.objects.clear();
    moved.pieces.truncate(1);
    moved.pieces[0].around = OrientedBox { center: Point::new(DVec3::ZERO), ..moved.pieces[0].around };
    let around = DrawnGround::new(&moved, &lifts, &cache);
    assert_eq!((around.pick(&view, [160.0, 90.0]), around.work().pieces), (None, 0));
}
