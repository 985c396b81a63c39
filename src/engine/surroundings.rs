//! What is drawn, for navigation: the point at a pixel, the ground at a place, the building there.
//!
//! All answers come from the last drawn list, so that hands meet what eyes see. Costs follow what lies near the ray or
//! the place: boxes of pieces and balls of pages and cells are tried first. [`DrawnGround::work`] counts it.

use super::lift::{Ground, KnownLifts};
use super::pick_mesh::{PickMeshes, PickWork, Pose, Pressing};
use crate::camera::{Obstacle, Surroundings, View};
use crate::content::{Ball, ObjectPage};
use crate::forest::{CellId, LEVEL_MAX};
use crate::geodesy::{Ecef, Geodetic, Point, Ray, ellipsoid_normal};
use crate::select::{DrawObjects, DrawPiece, Selection};
use glam::DVec3;
use std::cell::{Cell, OnceCell, RefCell};
use std::f64::consts::{PI, TAU};

/// Skirts lean out by up to 8 times their depth.
const SKIRT_REACH: f64 = 8.1;

/// What queries keep from one selection to the next: cut meshes, up to
/// [`PICK_MESH_BYTES_MAX`](super::PICK_MESH_BYTES_MAX).
#[derive(Default)]
pub struct PickCache(RefCell<PickMeshes>);

/// The surroundings of a drawn list. Make one for each selection; the index of its pieces is built when first needed.
pub struct DrawnGround<'a> {
    selection: &'a Selection,
    lifts: &'a dyn KnownLifts,
    cache: &'a PickCache,
    ground: OnceCell<Ground<'a>>,
    work: Cell<PickWork>,
}

impl<'a> DrawnGround<'a> {
    /// `lifts` are those that the selection was drawn with.
    pub fn new(selection: &'a Selection, lifts: &'a dyn KnownLifts, cache: &'a PickCache) -> Self {
        Self { selection, lifts, cache, ground: OnceCell::new(), work: Cell::default() }
    }

    /// What the last query looked at.
    pub fn work(&self) -> PickWork {
        self.work.get()
    }

    /// The piece drawn over a place.
    fn piece_at(&self, lat_rad: f64, lon_rad: f64) -> Option<&'a DrawPiece> {
        let ground = self.ground.get_or_init(|| Ground::new(&self.selection.pieces));
        ground.covering(CellId::containing(lat_rad, lon_rad, LEVEL_MAX))
    }

    /// Bounds the distance between the drawn ground at a place and the truth, metres; `None` where none is drawn.
    pub fn ground_error_m(&self, lat_rad: f64, lon_rad: f64) -> Option<f64> {
        self.piece_at(lat_rad, west_to_east(lon_rad)).map(|piece| f64::from(piece.error_m))
    }

    fn pick_terrain(&self, ray: &Ray, press: Option<&Pressing>, work: &mut PickWork) -> Option<f64> {
        let depth_m = press.map_or(0.0, |press| press.depth_m);
        let mut entered: Vec<(f64, &DrawPiece)> = Vec::new();
        for piece in &self.selection.pieces {
            let mut around = piece.around;
            around.half_m += DVec3::splat(f64::from(piece.skirt_m) * SKIRT_REACH + depth_m);
            entered.extend(ray.enters_box(&around).map(|entry_m| (entry_m, piece)));
        }
        work.boxes += self.selection.pieces.len() as u32;
        entered.sort_by(|a, b| a.0.total_cmp(&b.0));
        let mut nearest_m = f64::INFINITY;
        for (entry_m, piece) in entered {
            if entry_m >= nearest_m {
                break;
            }
            let mesh = self.cache.0.borrow_mut().get(piece);
            let pose = Pose { own: f64::from(piece.own), skirt_m: f64::from(piece.skirt_m), press };
            work.pieces += 1;
            nearest_m = mesh.meet(ray, pose, nearest_m, work).unwrap_or(nearest_m);
        }
        nearest_m.is_finite().then_some(nearest_m)
    }

    fn pick_objects(&self, ray: &Ray, press: Option<&Pressing>, before_m: f64, work: &mut PickWork) -> Option<f64> {
        let mut near: Vec<(f64, usize, usize)> = Vec::new();
        for (at, drawn) in self.selection.objects.iter().enumerate() {
            let lifts = Standing::of(self.lifts, drawn);
            lifts.near(
                work,
                &mut |center, radius_m| ray.enters_ball(center, radius_m).filter(|&entry_m| entry_m < before_m),
                &mut |entry_m, which| near.push((entry_m, at, which)),
            );
        }
        near.retain(|&(_, at, which)| is_drawn(&self.selection.objects[at], which));
        near.sort_by(|a, b| a.0.total_cmp(&b.0));
        let mut nearest_m = before_m;
        for (entry_m, at, which) in near {
            if entry_m >= nearest_m {
                break;
            }
            let drawn = &self.selection.objects[at];
            let lift_m = Standing::of(self.lifts, drawn).pressed_lift_m(which, press);
            work.objects += 1;
            nearest_m = drawn.page.meet_ray(which, ray, lift_m).map_or(nearest_m, |met_m| met_m.min(nearest_m));
        }
        (nearest_m < before_m).then_some(nearest_m)
    }
}

impl Surroundings for DrawnGround<'_> {
    /// Terrain with its skirts, and objects; both as they are pressed down round an eye that drawn ground would bury.
    fn pick(&self, view: &View, at_px: [f64; 2]) -> Option<Point<Ecef>> {
        let ray = Ray { origin: view.eye(), direction: view.ray(at_px) };
        let press = self.selection.press.map(|press| Pressing::new(view.eye(), view.pose.eye.up(), press));
        let mut work = PickWork::default();
        let ground_m = self.pick_terrain(&ray, press.as_ref(), &mut work);
        let object_m = self.pick_objects(&ray, press.as_ref(), ground_m.unwrap_or(f64::INFINITY), &mut work);
        self.work.set(work);
        object_m.or(ground_m).map(|distance_m| ray.at(distance_m))
    }

    /// Not pressed down: what will stand there once the eye has left the ground.
    fn ground_m(&self, lat_rad: f64, lon_rad: f64) -> Option<f64> {
        let lon_rad = west_to_east(lon_rad);
        let piece = self.piece_at(lat_rad, lon_rad);
        self.work.set(PickWork { pieces: u32::from(piece.is_some()), ..PickWork::default() });
        let piece = piece?;
        piece.terrain.surface_height_m(lat_rad, lon_rad, f64::from(piece.own))
    }

    /// Of all objects in the pages that are drawn, those out of view included. The base is the foot of the walls.
    fn obstacle(&self, lat_rad: f64, lon_rad: f64, margin_m: f64) -> Option<Obstacle> {
        let mut work = PickWork::default();
        let (foot, up) = (Geodetic { lat_rad, lon_rad, height_m: 0.0 }.to_ecef(), ellipsoid_normal(lat_rad, lon_rad));
        let mut highest: Option<Obstacle> = None;
        for drawn in &self.selection.objects {
            let standing = Standing::of(self.lifts, drawn);
            let mut near = Vec::new();
            standing.near(
                &mut work,
                &mut |center, radius_m| {
                    let from_foot = (center - foot).xyz();
                    let aside_m = (from_foot - up * from_foot.dot(up)).length();
                    (aside_m <= radius_m + margin_m).then_some(aside_m)
                },
                &mut |_, which| near.push(which),
            );
            for which in near {
                work.objects += 1;
                let known_m = highest.map_or(f64::NEG_INFINITY, |obstacle| obstacle.top_m);
                let found = standing.obstacle(which).filter(|found| found.top_m > known_m);
                if found.is_some() && drawn.page.footprint_holds(which, lat_rad, lon_rad, margin_m) {
                    highest = found;
                }
            }
        }
        self.work.set(work);
        highest
    }
}

/// π and −π are the same meridian; cells know it as −π.
fn west_to_east(lon_rad: f64) -> f64 {
    if (-PI..PI).contains(&lon_rad) { lon_rad } else { (lon_rad + PI).rem_euclid(TAU) - PI }
}

/// A drawn page with the lifts that its objects were drawn with.
struct Standing<'a> {
    page: &'a ObjectPage,
    lifts_m: &'a [f32],
    highest_m: f64,
}

impl<'a> Standing<'a> {
    fn of(lifts: &'a dyn KnownLifts, drawn: &'a DrawObjects) -> Self {
        let (lifts_m, highest_m) = lifts.of(&drawn.page);
        Self { page: &drawn.page, lifts_m, highest_m: f64::from(highest_m) }
    }

    /// Below 0 where only the foundation goes down.
    fn lift_m(&self, which: usize) -> f64 {
        self.lifts_m.get(which).map_or(0.0, |&lift_m| f64::from(lift_m))
    }

    /// As vs_main in objects.wgsl has it: pressed ground takes objects along, but never below their base.
    fn pressed_lift_m(&self, which: usize, press: Option<&Pressing>) -> f64 {
        let pressed_m = press.zip(self.page.objects.get(which)).map_or(0.0, |(press, object)| press.at_m(object.place));
        (self.lift_m(which) - pressed_m).max(0.0)
    }

    fn obstacle(&self, which: usize) -> Option<Obstacle> {
        let (object, lift_m) = (self.page.objects.get(which)?, self.lift_m(which));
        let base_m = f64::from(object.base_m) - self.page.foundation_m(which) + lift_m;
        Some(Obstacle { base_m, top_m: f64::from(object.top_m) + lift_m.max(0.0) })
    }

    /// Tells the objects whose balls are `met`, with its answer: the page's ball first, then those of its cells. A ball
    /// grows by the lift that may have moved what is in it.
    fn near(
        &self,
        work: &mut PickWork,
        met: &mut dyn FnMut(Point<Ecef>, f64) -> Option<f64>,
        tell: &mut dyn FnMut(f64, usize),
    ) {
        let mut ball_is_met = |ball: Option<Ball>, work: &mut PickWork| {
            work.boxes += 1;
            ball.is_some_and(|ball| met(ball.center(self.page.origin), ball.radius_m() + self.highest_m).is_some())
        };
        if !ball_is_met(self.page.ball(), work) {
            return;
        }
        let cells: Vec<_> = self
            .page
            .cells
            .iter()
            .enumerate()
            .filter(|&(entry, _)| ball_is_met(self.page.cell_ball(entry), work))
            .map(|(_, cell)| cell)
            .collect();
        for which in cells.into_iter().flat_map(|cell| cell.objects.start as usize..cell.objects.end as usize) {
            work.boxes += 1;
            let Some((center, radius_m)) = self.page.object_ball(which) else { continue };
            if let Some(answer) = met(center, radius_m + self.lift_m(which).abs()) {
                tell(answer, which);
            }
        }
    }
}

/// Whether an object is in the ranges that are drawn, which ascend.
fn is_drawn(drawn: &DrawObjects, which: usize) -> bool {
    let after = drawn.objects.partition_point(|range| range.start as usize <= which);
    after.checked_sub(1).is_some_and(|at| drawn.objects[at].contains(&(which as u32)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::camera::Pose as ViewPose;
    use crate::content::{Prism, TerrainPage, TerrainPost};
    use crate::forest::index::IndexForest;
    use crate::geodesy::OrientedBox;
    use std::sync::Arc;

    /// A tower of 40 m from a height of 10 m, on ground that is drawn at 35 m, half way to its parent's 70 m.
    fn tower_on_risen_ground(cell: CellId, place: Geodetic) -> Selection {
        let side_rad = 1e-6;
        let corner = |x: f64, y: f64| [place.lon_rad + x * side_rad, place.lat_rad + y * side_rad];
        let prism = Prism {
            id: 0,
            cell,
            rings: vec![vec![corner(-1.0, -1.0), corner(1.0, -1.0), corner(1.0, 1.0), corner(-1.0, 1.0)]],
            roof: vec![[0, 1, 2], [0, 2, 3]],
            base_m: 10.0,
            top_m: 50.0,
            foundation_m: 2.0,
            wall_color: [0; 3],
            roof_color: [0; 3],
            detail: None,
        };
        let (page, _) = ObjectPage::from_prisms(cell, 0, 0, 0.0, vec![prism]);
        let posts = [(0, 0), (64, 0), (0, 64), (64, 64)].map(|(column, row)| TerrainPost {
            column,
            row,
            height_m: 0.0,
            parent_height_m: 70.0,
            slope: [0; 2],
        });
        let terrain = Arc::new(TerrainPage::from_posts(cell, 1.0, posts.to_vec()).unwrap());
        let around = OrientedBox::around(&cell.bounds(), -100.0, 100.0);
        let objects = vec![DrawObjects { page: Arc::new(page), objects: std::iter::once(0..1).collect() }];
        let piece = DrawPiece { cell, terrain, imagery: None, own: 0.5, error_m: 0.0, skirt_m: 1.0, around };
        Selection { pieces: vec![piece], objects, ..Selection::default() }
    }

    #[test]
    fn lifted_objects_are_picked_and_stand_where_they_are_drawn() {
        let cell = CellId::containing(0.8, 0.3, 14);
        let place = cell.bounds().at(0.4, 0.6, 0.0);
        let selection = tower_on_risen_ground(cell, place);
        let (mut lifts, cache) = (crate::engine::Lifts::default(), PickCache::default());
        let ground = Ground::new(&selection.pieces);
        let (_, lifts_m) = lifts.update(&IndexForest::default(), &ground, &selection.objects[0]).unwrap();
        // No world has finer ground: of the parent's 60 m above the base, half is drawn.
        let lift_m = f64::from(lifts_m[0]);
        assert!((lift_m - 30.0).abs() < 0.1, "{lift_m}");
        let around = DrawnGround::new(&selection, &lifts, &cache);
        let met = around.obstacle(place.lat_rad, place.lon_rad, 0.5).unwrap();
        assert!((met.base_m - 8.0 - lift_m).abs() < 1e-6 && (met.top_m - 50.0 - lift_m).abs() < 1e-6);
        let pose = ViewPose { eye: place.at_height(500.0), heading_rad: 0.0, pitch_rad: -std::f64::consts::FRAC_PI_2 };
        let view = View::new(pose, 0.2, [300, 200]);
        let height_m =
            |around: &DrawnGround<'_>, at_px| Geodetic::from_ecef(around.pick(&view, at_px).unwrap()).height_m;
        assert!((height_m(&around, [150.0, 100.0]) - 50.0 - lift_m).abs() < 0.01);
        assert!((height_m(&around, [10.0, 10.0]) - 35.0).abs() < 0.1);
        // Pressed down by 20 m, and then by more than there is lift.
        for (depth_m, top_m) in [(20.0, 30.0 + lift_m), (45.0, 50.0)] {
            let press = Some(crate::select::GroundPress { depth_m, radius_m: 1e4 });
            let pressed = Selection { press, ..selection.clone() };
            let around = DrawnGround::new(&pressed, &lifts, &cache);
            assert!((height_m(&around, [150.0, 100.0]) - top_m).abs() < 0.01);
            assert!((height_m(&around, [10.0, 10.0]) - 35.0 + f64::from(depth_m)).abs() < 0.1);
        }
    }
}
