//! Lines over the picture: borders of zones and of drawn cells, and where the pages of these come from.
//!
//! Lines lie at the height of the drawn surface: along a cell's border between its corners, at their heights on the
//! page that is drawn; along a zone's at the surface of the cell there, or at the ellipsoid where none is drawn. They
//! are not hidden by mountains, only by the horizon.

mod trace;

use crate::camera::View;
use crate::content::{PageId, PageKind};
use crate::forest::CellId;
use crate::geodesy::{Geodetic, HorizonCone};
use crate::paging::PageState;
use crate::select::DrawPiece;
use egui::{Align2, Color32, Context, FontFamily, FontId, Id, LayerId, Order, Painter, Rect, Shape, Stroke, vec2};
use serde::{Deserialize, Serialize};
use std::f64::consts::{FRAC_PI_4, PI};
use trace::{Edge, Tracer};

/// Cells whose borders are drawn at most; the nearest first.
pub const CELLS_MAX: usize = 1500;
/// Levels written at most.
pub const LABELS_MAX: usize = 300;
/// Points of all lines of a frame at most.
pub const POINTS_MAX: usize = 30_000;
/// Cells smaller than this carry no text, pixels of half their diagonal.
const LABEL_MIN_PX: f64 = 26.0;
/// Borders are drawn this far inside, so that those of neighbours lie side by side; a share of the cell's side.
const INSET: f64 = 0.008;
/// Lines near the eye's own height would be hidden by rounding: the horizon's ellipsoid stays this far below, metres.
const EYE_CLEARANCE_M: f64 = 10.0;
const ZONE_COLOR: Color32 = Color32::from_rgb(255, 220, 120);
const PLAIN_COLOR: Color32 = Color32::from_rgb(150, 200, 255);

/// Which overlays are drawn.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(default)]
pub struct Overlays {
    pub zones: bool,
    /// Borders and levels of drawn cells.
    pub cells: bool,
    /// Drawn cells coloured by where their pages come from.
    pub page_state: bool,
}

impl Overlays {
    pub fn any(&self) -> bool {
        self.zones || self.cells || self.page_state
    }
}

/// Where the terrain and imagery of a drawn cell come from.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum PieceState {
    /// From its own pages.
    Own,
    /// From pages of a coarser cell: finer ones do not exist, or are not here yet and not asked for.
    StandIn,
    /// Finer pages are asked for.
    Requested,
    /// Finer pages could not be read.
    Failed,
}

impl PieceState {
    pub const ALL: [Self; 4] = [Self::Own, Self::StandIn, Self::Requested, Self::Failed];

    pub fn name(self) -> &'static str {
        match self {
            Self::Own => "own pages",
            Self::StandIn => "coarser ones",
            Self::Requested => "requested",
            Self::Failed => "failed",
        }
    }

    pub fn color(self) -> Color32 {
        match self {
            Self::Own => Color32::from_rgb(130, 220, 140),
            Self::StandIn => Color32::from_rgb(90, 190, 235),
            Self::Requested => Color32::from_rgb(255, 200, 90),
            Self::Failed => Color32::from_rgb(255, 100, 90),
        }
    }
}

/// What the overlays are drawn from.
#[derive(Clone, Copy, Debug)]
pub struct Drawn<'a> {
    pub view: &'a View,
    /// Those of the frame; cells out of view are left out here.
    pub pieces: &'a [DrawPiece],
    /// Pages that the front wants and that are not resident; objects do not count.
    pub lacking: &'a [(PageId, PageState)],
}

/// Draws what is switched on, below the panels.
pub fn show(ctx: &Context, overlays: Overlays, drawn: &Drawn<'_>) {
    if !overlays.any() {
        return;
    }
    let painter = ctx.layer_painter(LayerId::new(Order::Background, Id::unique("stoop overlays")));
    let scene = Scene::new(*drawn, ctx.pixels_per_point());
    let mut tracer = Tracer::new(drawn.view, scene.horizon, ctx.pixels_per_point(), POINTS_MAX);
    if overlays.cells || overlays.page_state {
        scene.cells(overlays, &mut tracer, &painter);
    }
    if overlays.zones {
        scene.zones(&mut tracer, &painter);
    }
}

struct Scene<'a> {
    drawn: Drawn<'a>,
    horizon: HorizonCone,
    pixels_per_point: f32,
    /// Indices of pieces by their cells in order; pieces lie apart.
    by_cell: Vec<usize>,
    /// Terrain and imagery that lack, by cell in order.
    lacking: Vec<(CellId, PageState)>,
}

impl<'a> Scene<'a> {
    fn new(drawn: Drawn<'a>, pixels_per_point: f32) -> Self {
        let eye = drawn.view.eye();
        let sunk_m = (EYE_CLEARANCE_M - drawn.view.pose.eye.height_m).max(0.0);
        let mut by_cell: Vec<usize> = (0..drawn.pieces.len()).collect();
        by_cell.sort_unstable_by_key(|&at| drawn.pieces[at].cell);
        let is_ground = |page: &PageId| matches!(page.kind, PageKind::Terrain | PageKind::Imagery);
        let mut lacking: Vec<_> =
            drawn.lacking.iter().filter(|(page, _)| is_ground(page)).map(|&(page, lack)| (page.cell, lack)).collect();
        lacking.sort_unstable();
        Self { drawn, horizon: HorizonCone::new(eye, sunk_m), pixels_per_point, by_cell, lacking }
    }

    /// Pieces in view, the nearest first.
    fn in_view(&self) -> Vec<&'a DrawPiece> {
        let (frustum, eye) = (self.drawn.view.frustum(), self.drawn.view.eye());
        let sees = |piece: &&DrawPiece| frustum.meets(&piece.around) && !self.horizon.hides_box(&piece.around);
        let mut seen: Vec<(f64, &DrawPiece)> = self
            .drawn
            .pieces
            .iter()
            .filter(sees)
            .map(|piece| (piece.around.center.distance_m(eye) - piece.around.half_m.length(), piece))
            .collect();
        seen.sort_by(|(near, _), (far, _)| near.total_cmp(far));
        seen.into_iter().map(|(_, piece)| piece).take(CELLS_MAX).collect()
    }

    fn cells(&self, overlays: Overlays, tracer: &mut Tracer<'_>, painter: &Painter) {
        let seen = self.in_view();
        let color = |piece: &DrawPiece| {
            if overlays.page_state { piece_state(piece, &self.lacking).color() } else { PLAIN_COLOR }
        };
        for piece in &seen {
            let stroke = Stroke::new(1.0, color(piece));
            for edge in border(piece) {
                tracer.add(&edge);
            }
            painter.extend(tracer.take_lines().into_iter().map(|line| Shape::line(line, stroke)));
        }
        let mut taken: Vec<Rect> = Vec::new();
        for piece in seen.iter().filter(|_| overlays.cells) {
            if taken.len() == LABELS_MAX {
                break;
            }
            taken.extend(self.label(piece, color(piece), &taken, painter));
        }
    }

    /// Writes the cell's label where the cell is large enough, in the picture, and the place is not taken; returns
    /// what it takes.
    fn label(&self, piece: &DrawPiece, color: Color32, taken: &[Rect], painter: &Painter) -> Option<Rect> {
        let view = self.drawn.view;
        let middle = piece.cell.bounds().center();
        let place = middle.at_height(surface_m(piece, middle)).to_ecef();
        let size_px = view.projected_px(piece.around.half_m.length(), place.distance_m(view.eye()));
        let at = trace::on_screen(view, place, self.pixels_per_point)?;
        if size_px < LABEL_MIN_PX || self.horizon.hides(place) || !painter.clip_rect().contains(at) {
            return None;
        }
        let font = FontId::new(10.5, FontFamily::Monospace);
        let galley = painter.layout_no_wrap(label(piece), font, color);
        let rect = Align2::CENTER_CENTER.anchor_size(at, galley.size()).expand2(vec2(2.0, 0.0));
        if taken.iter().any(|other| other.intersects(rect)) {
            return None;
        }
        painter.rect_filled(rect, 2.0, Color32::from_black_alpha(130));
        painter.galley(rect.min + vec2(2.0, 0.0), galley, color);
        Some(rect)
    }

    fn zones(&self, tracer: &mut Tracer<'_>, painter: &Painter) {
        let height_m = |lat_rad: f64, lon_rad: f64| self.ground_m(lat_rad, lon_rad);
        for edge in zone_edges(&height_m) {
            tracer.add(&edge);
        }
        let stroke = Stroke::new(1.5, ZONE_COLOR);
        painter.extend(tracer.take_lines().into_iter().map(|line| Shape::line(line, stroke)));
    }

    /// Of the drawn surface; the ellipsoid where nothing is drawn.
    fn ground_m(&self, lat_rad: f64, lon_rad: f64) -> f64 {
        let finest = CellId::containing(lat_rad, lon_rad, crate::forest::LEVEL_MAX);
        let pieces = self.drawn.pieces;
        let after = self.by_cell.partition_point(|&at| pieces[at].cell <= finest);
        let over = after.checked_sub(1).map(|at| &pieces[self.by_cell[at]]);
        over.filter(|piece| piece.cell.contains(finest))
            .and_then(|piece| piece.terrain.surface_height_m(lat_rad, lon_rad, f64::from(piece.own)))
            .unwrap_or(0.0)
    }
}

/// The worst of what lacks in the cell or below it, else whether its pages are its own. `lacking` is in order.
fn piece_state(piece: &DrawPiece, lacking: &[(CellId, PageState)]) -> PieceState {
    let subtree = piece.cell.subtree();
    let from = lacking.partition_point(|(cell, _)| cell < subtree.start());
    let worst = lacking[from..].iter().take_while(|(cell, _)| cell <= subtree.end()).map(|&(_, lack)| lack).max();
    let is_own = piece.terrain.cell == piece.cell && piece.imagery.is_none_or(|cell| cell == piece.cell);
    match worst {
        Some(PageState::Failed) => PieceState::Failed,
        Some(PageState::Requested) => PieceState::Requested,
        Some(PageState::Absent | PageState::Resident) => PieceState::StandIn,
        None if is_own => PieceState::Own,
        None => PieceState::StandIn,
    }
}

/// The cell's level, and those of its pages where they are coarser: `14`, `14 t12 i13`.
fn label(piece: &DrawPiece) -> String {
    let mut text = piece.cell.level().to_string();
    if piece.terrain.cell != piece.cell {
        text += &format!(" t{}", piece.terrain.cell.level());
    }
    match piece.imagery {
        Some(cell) if cell != piece.cell => text += &format!(" i{}", cell.level()),
        None => text += " i–",
        _ => {}
    }
    text
}

fn surface_m(piece: &DrawPiece, place: Geodetic) -> f64 {
    piece.terrain.surface_height_m(place.lat_rad, place.lon_rad, f64::from(piece.own)).unwrap_or(0.0)
}

/// The four sides, a little inside, as one way round.
fn border(piece: &DrawPiece) -> [Edge<'static>; 4] {
    let bounds = piece.cell.bounds();
    let (low, high) = (INSET, 1.0 - INSET);
    let corners = [(low, low), (high, low), (high, high), (low, high)].map(|(u, v)| {
        let corner = bounds.at(u, v, 0.0);
        corner.at_height(surface_m(piece, corner))
    });
    [0, 1, 2, 3].map(|at| Edge { from: corners[at], to: corners[(at + 1) % 4], height_m: None })
}

/// Meridians and parallels every 45°, in pieces of 45°.
fn zone_edges<'h>(height_m: &'h dyn Fn(f64, f64) -> f64) -> impl Iterator<Item = Edge<'h>> {
    let at = |row: i32, column: i32| Geodetic {
        lat_rad: f64::from(row) * FRAC_PI_4,
        lon_rad: f64::from(column) * FRAC_PI_4 - PI,
        height_m: 0.0,
    };
    let edge = move |from, to| Edge { from, to, height_m: Some(height_m) };
    let meridians = (0..8).flat_map(move |column| (-2..2).map(move |row| edge(at(row, column), at(row + 1, column))));
    let parallels = (-1..2).flat_map(move |row| (0..8).map(move |column| edge(at(row, column), at(row, column + 1))));
    meridians.chain(parallels)
}

#[cfg(test)]
mod tests;
