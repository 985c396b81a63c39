//! What a frame's decisions cost over a prepared world, and what they hold:
//!
//! `cargo bench --bench world -- WORLD LON_DEG LAT_DEG HEIGHT_M HEADING_DEG PITCH_DEG`
//!
//! Selection is repeated until all that it demands is resident; then it is done 16 times in the function `measured`
//! alone, so that its instructions can be counted:
//!
//! `valgrind --tool=callgrind --toggle-collect='*measured*' PROGRAM WORLD …`
#![allow(clippy::unwrap_used, reason = "a bench that cannot go on should stop")]

use std::collections::HashMap;
use std::hint::black_box;
use std::path::Path;
use stoop::camera::{Pose, View};
use stoop::cells::LiveTree;
use stoop::content::{PageId, PageKind};
use stoop::geodesy::Geodetic;
use stoop::paging::held_bytes;
use stoop::select::{SelectParams, Selection, select};
use stoop::store::World;

const PARAMS: SelectParams = SelectParams::DEFAULT;
/// How often the frame is done under the eyes of callgrind.
const TIMES: usize = 16;
/// Rounds of loading until a front is whole: as many as the world has levels, and some.
const ROUNDS_MAX: usize = 64;

struct Scene {
    world: World,
    cells: LiveTree,
    view: View,
    /// Bytes of the pages that are resident.
    held: HashMap<PageId, u64>,
}

impl Scene {
    fn new(world: World, view: View) -> Self {
        let mut scene = Self { world, cells: LiveTree::default(), view, held: HashMap::new() };
        let roots: Vec<PageId> = scene.world.index().trees().map(|tree| tree.root().cell()).map(terrain).collect();
        roots.into_iter().for_each(|root| scene.bring(root));
        for _ in 0..ROUNDS_MAX {
            let wanted: Vec<PageId> = scene.select().demands.iter().map(|demand| demand.page).collect();
            let lacking: Vec<PageId> = wanted.into_iter().filter(|page| !scene.held.contains_key(page)).collect();
            if lacking.is_empty() {
                break;
            }
            lacking.into_iter().for_each(|page| scene.bring(page));
        }
        scene
    }

    fn bring(&mut self, id: PageId) {
        if let Some(place) = self.world.place(id) {
            let page = self.world.load(id, place).unwrap();
            self.held.insert(id, held_bytes(&page));
            self.cells.insert(&page);
        }
    }

    fn select(&self) -> Selection {
        select(self.world.index(), &self.cells, &self.view, &PARAMS)
    }

    /// Of the roots, which always stay, and of what the frame demands.
    fn resident_bytes(&self, selection: &Selection) -> u64 {
        let demanded = selection.demands.iter().map(|demand| demand.page);
        let mut pages: Vec<PageId> = demanded.collect();
        pages.extend(self.world.index().trees().map(|tree| terrain(tree.root().cell())));
        pages.sort();
        pages.dedup();
        pages.iter().filter_map(|page| self.held.get(page)).sum()
    }
}

fn terrain(cell: stoop::forest::CellId) -> PageId {
    PageId { cell, kind: PageKind::Terrain }
}

/// What instructions are counted of.
#[inline(never)]
fn measured(scene: &Scene) {
    for _ in 0..TIMES {
        black_box(scene.select());
    }
}

fn main() {
    let arguments: Vec<String> = std::env::args().skip(1).filter(|argument| argument != "--bench").collect();
    let [world, numbers @ ..] = arguments.as_slice() else { return };
    let numbers: Vec<f64> = numbers.iter().filter_map(|number| number.parse().ok()).collect();
    let &[lon_deg, lat_deg, height_m, heading_deg, pitch_deg] = numbers.as_slice() else {
        eprintln!("name a world, and after it lon_deg lat_deg height_m heading_deg pitch_deg of a view");
        std::process::exit(2);
    };
    let eye = Geodetic::from_degrees(lat_deg, lon_deg, height_m);
    let pose = Pose { eye, heading_rad: heading_deg.to_radians(), pitch_rad: pitch_deg.to_radians() };
    let view = View::new(pose, 60f64.to_radians(), [1280, 720]);
    let scene = Scene::new(World::open_whole(Path::new(world)).unwrap(), view);
    let selection = scene.select();
    measured(&scene);
    let stats = &selection.stats;
    println!(
        "{world}: {} bytes resident, index {} bytes, {} pages demanded, {} cells and {} objects tested, {} objects drawn",
        scene.resident_bytes(&selection),
        scene.world.index().byte_len(),
        selection.demands.len(),
        stats.cells_tested,
        stats.objects_tested,
        stats.objects_drawn,
    );
}
