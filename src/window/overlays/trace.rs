//! Lines of latitude and longitude on the screen: split until they look smooth, cut where they cannot be seen.

use crate::camera::{Frustum, View};
use crate::geodesy::{Ecef, Geodetic, HorizonCone, Point};
use egui::{Pos2, pos2};

/// A line between two places along which latitude and longitude grow evenly; longitudes do not wrap.
#[derive(Clone, Copy)]
pub(super) struct Edge<'h> {
    pub from: Geodetic,
    pub to: Geodetic,
    /// Height at a latitude and longitude, metres; without it heights grow evenly too.
    pub height_m: Option<&'h dyn Fn(f64, f64) -> f64>,
}

/// Halvings of an edge at most: 45° becomes 5 m.
const DEPTH_MAX: u32 = 20;
/// Longer pieces are always halved, radians: they may bend both ways.
const ALWAYS_SPLIT_RAD: f64 = 0.12;
/// How far a drawn line may be off, pixels.
const OFF_PX: f32 = 0.7;
/// Where a line passes out of sight it is cut to this, pixels.
const CUT_PX: f32 = 3.0;
/// Points further than this from the picture are as good as behind the eye, in sizes of the picture.
const FAR: f64 = 3.0;

/// Collects lines; the sum of their points is bounded.
pub(super) struct Tracer<'v> {
    view: &'v View,
    frustum: Frustum,
    horizon: HorizonCone,
    pixels_per_point: f32,
    points_left: usize,
    lines: Vec<Vec<Pos2>>,
    /// The line that the next piece may go on; empty or of two points and more.
    open: Vec<Pos2>,
}

/// A point of an edge.
#[derive(Clone, Copy)]
struct Spot {
    /// Share of the edge.
    share: f64,
    place: Point<Ecef>,
    at: Option<Pos2>,
    is_hidden: bool,
}

impl Spot {
    fn seen(&self) -> Option<Pos2> {
        self.at.filter(|_| !self.is_hidden)
    }
}

/// In points; `None` behind the eye and far outside the picture.
pub(super) fn on_screen(view: &View, place: Point<Ecef>, pixels_per_point: f32) -> Option<Pos2> {
    let [x, y] = view.project_px(place)?;
    let [width, height] = view.size_px.map(f64::from);
    let fits = |value: f64, size: f64| (-FAR * size..=(1.0 + FAR) * size).contains(&value);
    (fits(x, width) && fits(y, height)).then(|| pos2(x as f32, y as f32) / pixels_per_point)
}

impl<'v> Tracer<'v> {
    pub(super) fn new(view: &'v View, horizon: HorizonCone, pixels_per_point: f32, points_max: usize) -> Self {
        let (lines, open) = (Vec::new(), Vec::new());
        Self { view, frustum: view.frustum(), horizon, pixels_per_point, points_left: points_max, lines, open }
    }

    /// What was collected since the last call.
    pub(super) fn take_lines(&mut self) -> Vec<Vec<Pos2>> {
        self.end_line();
        std::mem::take(&mut self.lines)
    }

    pub(super) fn add(&mut self, edge: &Edge<'_>) {
        let (from, to) = (self.spot(edge, 0.0), self.spot(edge, 1.0));
        self.piece(edge, from, to, 0);
    }

    fn spot(&self, edge: &Edge<'_>, share: f64) -> Spot {
        let mix = |from: f64, to: f64| if share == 1.0 { to } else { from + share * (to - from) };
        let (lat_rad, lon_rad) = (mix(edge.from.lat_rad, edge.to.lat_rad), mix(edge.from.lon_rad, edge.to.lon_rad));
        let height_m =
            edge.height_m.map_or_else(|| mix(edge.from.height_m, edge.to.height_m), |of| of(lat_rad, lon_rad));
        let place = Geodetic { lat_rad, lon_rad, height_m }.to_ecef();
        let at = on_screen(self.view, place, self.pixels_per_point);
        Spot { share, place, at, is_hidden: self.horizon.hides(place) }
    }

    fn piece(&mut self, edge: &Edge<'_>, from: Spot, to: Spot, depth: u32) {
        if self.points_left == 0 {
            return;
        }
        let middle = self.spot(edge, (from.share + to.share) / 2.0);
        let length_m = from.place.distance_m(middle.place) + middle.place.distance_m(to.place);
        // The arc, and what mountains between may add to it, lie in this ball.
        if !self.frustum.meets_ball(middle.place, length_m) {
            return self.end_line();
        }
        if depth < DEPTH_MAX && must_split(edge, &from, &middle, &to) {
            self.piece(edge, from, middle, depth + 1);
            return self.piece(edge, middle, to, depth + 1);
        }
        match (from.seen(), to.seen()) {
            (Some(start), Some(end)) => self.draw(start, end),
            _ => self.end_line(),
        }
    }

    fn draw(&mut self, start: Pos2, end: Pos2) {
        if self.open.last() != Some(&start) {
            self.end_line();
            self.open.push(start);
            self.points_left = self.points_left.saturating_sub(1);
        }
        self.open.push(end);
        self.points_left = self.points_left.saturating_sub(1);
    }

    fn end_line(&mut self) {
        if !self.open.is_empty() {
            self.lines.push(std::mem::take(&mut self.open));
        }
    }
}

fn must_split(edge: &Edge<'_>, from: &Spot, middle: &Spot, to: &Spot) -> bool {
    let angle_rad = (edge.to.lat_rad - edge.from.lat_rad).hypot(edge.to.lon_rad - edge.from.lon_rad);
    if angle_rad * (to.share - from.share) > ALWAYS_SPLIT_RAD {
        return true;
    }
    match [from, middle, to].map(|spot| spot.at) {
        [Some(start), Some(between), Some(end)] => {
            let hidden = [from, middle, to].map(|spot| spot.is_hidden);
            let is_cut = hidden != [hidden[0]; 3] && start.distance(end) > CUT_PX;
            let is_bent = !hidden[0] && (start + (end - start) / 2.0).distance(between) > OFF_PX;
            is_cut || is_bent
        }
        // Behind the eye as a whole, as far as three points can tell: only what is left in the frustum is looked at.
        _ => true,
    }
}
