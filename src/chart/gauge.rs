//! Points over the drawn ground of one frame: what is drawn there, what is true, and what the piece claims.

use super::heights::{HeightCounts, Truth};
use crate::content::Surface;
use crate::forest::index::IndexForest;
use crate::geodesy::{GeoBounds, Geodetic};
use crate::select::{DrawPiece, OutOfView, Sight, Tolerance};
use crate::simulate::Frame;

/// Points along a side of a piece, at least.
pub const SIDE_POINTS: u32 = 4;
/// Parts that take more of the screen than this are quartered, so often at most: near the eye a small part of a piece may
/// fill the picture.
pub const PART_SHARE_MAX: f64 = 1.0 / 256.0;
const QUARTERINGS_MAX: u32 = 12;
/// Bounds are compared with this much room, as a share: pieces carry them in f32.
const ROUNDING: f64 = 1e-6;

/// A place on the drawn ground.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Point {
    /// Share of the screen; of a whole frame they add up to 1 in the end.
    pub weight: f64,
    /// |drawn − truth|.
    pub miss_m: f64,
    /// What its piece claims.
    pub bound_m: f64,
    pub px_per_m: f64,
}

impl Point {
    pub fn is_over_bound(&self) -> bool {
        is_over(self.miss_m, self.bound_m)
    }
}

/// Sum of the points' weights.
pub fn weight<'a>(points: impl IntoIterator<Item = &'a Point>) -> f64 {
    // A sum of nothing would be −0.
    points.into_iter().fold(0.0, |sum, point| sum + point.weight)
}

/// Whether an error is beyond a bound.
pub fn is_over(miss_m: f64, bound_m: f64) -> bool {
    miss_m > bound_m * (1.0 + ROUNDING)
}

/// What was found in one frame.
#[derive(Default)]
pub struct Found {
    pub points: Vec<Point>,
    /// What the pieces take of the screen.
    share: f64,
    pub counts: HeightCounts,
}

impl Found {
    pub fn of(frame: &Frame, index: &IndexForest, truth: &dyn Truth) -> Self {
        let tolerance = Tolerance::new(frame.report.tolerance_drawn_px, frame.report.tolerance_drawn_px);
        let sight = Sight::new(index, &frame.view, tolerance, OutOfView::Left);
        let mut found = Self::default();
        for piece in frame.selection.pieces.iter().filter(|piece| sight.sees(&piece.around)) {
            found.take(&Gauge { sight: &sight, piece, truth });
        }
        found.count();
        found
    }

    fn count(&mut self) {
        let counts = &mut self.counts;
        counts.points = self.points.len() as u64;
        if counts.points > 0 {
            counts.frames = 1;
            counts.unmeasured_shares = (1.0 - weight(&self.points) / self.share).max(0.0);
        }
        for point in self.points.iter().filter(|point| point.is_over_bound()) {
            counts.over_bound_points += 1;
            counts.over_bound_max_m = counts.over_bound_max_m.max(point.miss_m - point.bound_m);
        }
    }

    /// The points of a piece share out what the piece takes of the screen, those out of view included.
    fn take(&mut self, gauge: &Gauge<'_>) {
        let parts = gauge.parts();
        let share: f64 = parts.iter().map(|part| part.share).sum();
        self.share += share;
        let seen: Vec<&Part> = parts.iter().filter(|part| part.is_seen && part.share > 0.0).collect();
        let seen_share: f64 = seen.iter().map(|part| part.share).sum();
        for part in seen {
            self.points.extend(gauge.point(part, part.share * share / seen_share));
            if let Some(miss_m) = gauge.post_miss_m(part) {
                self.counts.take_post(miss_m, gauge.bound_m());
            }
        }
    }

    /// With weights that add up to 1.
    pub fn normalized(self) -> impl Iterator<Item = Point> {
        let sum = weight(&self.points);
        self.points.into_iter().map(move |point| Point { weight: point.weight / sum, ..point })
    }
}

/// A part of a piece, and its middle as it is drawn.
struct Part {
    bounds: GeoBounds,
    middle: Geodetic,
    /// Of the screen.
    share: f64,
    /// Whether the middle is in the view's pyramid and before the horizon.
    is_seen: bool,
}

/// Measures one piece.
struct Gauge<'a> {
    sight: &'a Sight<'a>,
    piece: &'a DrawPiece,
    truth: &'a dyn Truth,
}

impl Gauge<'_> {
    /// The piece in parts, smaller ones where it takes much of the screen.
    fn parts(&self) -> Vec<Part> {
        let surface = self.piece.terrain.surface(self.piece.own.into());
        let mut parts = Vec::new();
        for bounds in cut(&self.piece.cell.bounds(), SIDE_POINTS) {
            self.quarter(&surface, bounds, QUARTERINGS_MAX, &mut parts);
        }
        parts
    }

    fn quarter(&self, surface: &Surface<'_>, bounds: GeoBounds, left: u32, parts: &mut Vec<Part>) {
        let center = bounds.center();
        let Some(height_m) = surface.height_m(center.lat_rad, center.lon_rad) else { return };
        let share = self.sight.screen_share(&bounds, height_m);
        if share > PART_SHARE_MAX && left > 0 {
            cut(&bounds, 2).for_each(|quarter| self.quarter(surface, quarter, left - 1, parts));
            return;
        }
        let middle = center.at_height(height_m);
        let place = middle.to_ecef();
        let is_seen = self.sight.frustum.meets_ball(place, 0.0) && !self.sight.horizon.hides(place);
        parts.push(Part { bounds, middle, share, is_seen });
    }

    fn point(&self, part: &Part, weight: f64) -> Option<Point> {
        let Geodetic { lat_rad, lon_rad, height_m } = part.middle;
        let miss_m = (height_m - self.truth.height_m(lat_rad, lon_rad)?).abs();
        let distance_m = (part.middle.to_ecef() - self.sight.eye).xyz().length();
        let px_per_m = self.sight.view.projected_px(1.0, distance_m);
        Some(Point { weight, miss_m, bound_m: self.bound_m(), px_per_m })
    }

    /// How far the drawn ground is off the source's post beside a part's middle.
    fn post_miss_m(&self, part: &Part) -> Option<f64> {
        let post = self.truth.post_near(part.middle.lat_rad, part.middle.lon_rad, &part.bounds)?;
        let drawn_m = self.piece.terrain.surface_height_m(post.lat_rad, post.lon_rad, self.piece.own.into())?;
        Some((drawn_m - post.height_m).abs())
    }

    /// What the piece claims.
    fn bound_m(&self) -> f64 {
        self.piece.error_m.into()
    }
}

/// As many equal parts along each side.
fn cut(whole: &GeoBounds, side: u32) -> impl Iterator<Item = GeoBounds> {
    let whole = *whole;
    let share = move |at: u32| f64::from(at) / f64::from(side);
    let corner = move |row: u32, column: u32| whole.at(share(column), share(row), 0.0);
    let places = (0..side).flat_map(move |row| (0..side).map(move |column| (row, column)));
    places.map(move |(row, column)| {
        let (low, high) = (corner(row, column), corner(row + 1, column + 1));
        GeoBounds { west_rad: low.lon_rad, south_rad: low.lat_rad, east_rad: high.lon_rad, north_rad: high.lat_rad }
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::camera::{Pose, View};
    use crate::content::{TerrainPage, TerrainPost};
    use crate::forest::CellId;
    use crate::geodesy::OrientedBox;
    use std::sync::Arc;

    const GROUND_M: f32 = 100.0;
    const BOUND_M: f32 = 5.0;

    /// Flat at a height, in the eastern half of the Earth; its posts are 3 m higher than what lies between.
    struct Plateau {
        height_m: f64,
    }

    impl Truth for Plateau {
        fn height_m(&self, _lat_rad: f64, lon_rad: f64) -> Option<f64> {
            (lon_rad > 0.0).then_some(self.height_m)
        }

        fn post_near(&self, lat_rad: f64, lon_rad: f64, within: &GeoBounds) -> Option<Geodetic> {
            assert!(within.contains(lat_rad, lon_rad));
            Some(Geodetic { lat_rad, lon_rad, height_m: self.height_m + 3.0 })
        }
    }

    /// A small flat cell, below the eye in its middle.
    fn piece(lon_deg: f64, own: f32) -> DrawPiece {
        let cell = CellId::containing(0.7, lon_deg.to_radians(), 12);
        let post = |column, row| TerrainPost {
            column,
            row,
            height_m: GROUND_M,
            parent_height_m: GROUND_M + 8.0,
            slope: [0; 2],
        };
        let posts = vec![post(0, 0), post(64, 0), post(0, 64), post(64, 64)];
        let terrain = Arc::new(TerrainPage::from_posts(cell, BOUND_M, posts).unwrap());
        let around = OrientedBox::around(&cell.bounds(), f64::from(GROUND_M) - 1.0, f64::from(GROUND_M) + 9.0);
        DrawPiece { cell, terrain, imagery: None, own, error_m: BOUND_M, skirt_m: 0.0, around }
    }

    fn found(piece: DrawPiece, height_m: f64, eye_m: f64) -> Found {
        let eye = piece.cell.bounds().center().at_height(eye_m);
        let pose = Pose { eye, heading_rad: 0.0, pitch_rad: -std::f64::consts::FRAC_PI_2 };
        let view = View::new(pose, 1.0, [640, 360]);
        let index = IndexForest::default();
        let sight = Sight::new(&index, &view, Tolerance::new(1.0, 1.0), OutOfView::Left);
        let mut found = Found::default();
        found.take(&Gauge { sight: &sight, piece: &piece, truth: &Plateau { height_m } });
        found
    }

    #[test]
    fn points_have_the_drawn_error_at_their_own_distance() {
        let high = found(piece(10.0, 1.0), 98.0, 1e5);
        assert_eq!((high.points.len(), high.counts.posts, high.counts.over_bound_posts), (16, 16, 0));
        let focal_px = 180.0 / 0.5f64.tan();
        for point in &high.points {
            // A chord of a kilometre and a half lies centimetres below the ellipsoid.
            assert!((point.miss_m - 2.0).abs() < 0.2 && !point.is_over_bound(), "{point:?}");
            assert!((point.px_per_m * 99_900.0 / focal_px - 1.0).abs() < 1e-3, "{point:?}");
        }
        // Half way to the parent's surface the ground is 4 m higher: 7 m off between the posts, 4 m at them.
        let half = found(piece(10.0, 0.5), 97.0, 1e5);
        assert!(half.points.iter().all(|point| (point.miss_m - 7.0).abs() < 0.2 && point.is_over_bound()));
        assert_eq!((half.counts.posts, half.counts.over_bound_posts), (16, 0));
        assert_eq!(found(piece(10.0, 1.0), 80.0, 1e5).counts.over_bound_posts, 16);
    }

    #[test]
    fn what_is_out_of_view_or_of_the_source_is_left_out() {
        assert_eq!(found(piece(-10.0, 1.0), 98.0, 1e5).points.len(), 0);
        // Low above its middle a small part of the piece fills the screen.
        let low = found(piece(10.0, 1.0), 98.0, 400.0);
        assert!((256..1100).contains(&low.points.len()), "{}", low.points.len());
        assert!((weight(&low.points) - 1.0).abs() < 0.01 && (low.share - 1.0).abs() < 0.01, "{}", low.share);
    }
}
