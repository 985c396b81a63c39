//! What a drag holds on to, and following the cursor with it.

use super::Pose;
use super::Surroundings;
use super::clearance::Clearance;
use super::hold::{LEAST_ELEVATION_RAD, Reach, elevation_over, face, hold};
use super::motion::{Lens, MAX_HEIGHTS_PER_S, moved, radius_m};
use super::orbit::Orbit;
use super::zoom::Anchor;
use crate::geodesy::{Ecef, Point};
use glam::DVec3;

/// What follows the cursor.
#[derive(Clone, Copy, Debug)]
pub(super) enum Grab {
    /// A point of the ground stays under it.
    Point(Point<Ecef>),
    /// A direction (unit, ECEF) stays under it, the eye where it is.
    Direction(DVec3),
    /// The eye goes round a point; with the cursor of the last frame.
    Orbit(Orbit, [f64; 2]),
}

/// How following went.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Followed {
    /// What is held is under the cursor, as near as it can be.
    There,
    /// It was too far for this frame.
    Behind,
    /// The globe's edge or a wall is in the way.
    Stopped,
}

impl Grab {
    /// The point at a pixel. What lies at the eye's own level or above it, and the sky, is held by turning: no way of
    /// the eye at its height would keep it there.
    pub(super) fn at(pose: Pose, lens: Lens, at_px: [f64; 2], around: &dyn Surroundings) -> Self {
        match Anchor::pick(pose, lens, at_px, around) {
            Some(anchor) if elevation_over(&pose, anchor.point) > LEAST_ELEVATION_RAD => Self::Point(anchor.point),
            Some(anchor) => Self::Direction((anchor.point - pose.eye.to_ecef()).xyz().normalize_or_zero()),
            None => Self::direction(pose, lens, at_px),
        }
    }

    /// Round what is in the middle of the picture; in its place where that is the sky.
    pub(super) fn round(pose: Pose, lens: Lens, at_px: [f64; 2], around: &dyn Surroundings) -> Self {
        match middle(pose, lens, around) {
            Some(pivot) => Self::Orbit(Orbit::new(&pose, pivot), at_px),
            None => Self::direction(pose, lens, at_px),
        }
    }

    fn direction(pose: Pose, lens: Lens, at_px: [f64; 2]) -> Self {
        Self::Direction(lens.view(pose).ecef_from_view().rotation() * lens.direction(at_px))
    }

    /// Whether the eye's place is free to be moved by something else.
    pub(super) fn leaves_the_eye(&self) -> bool {
        matches!(self, Self::Direction(_))
    }

    /// The pose after following the cursor for `dt_s`.
    pub(super) fn follow(
        &mut self,
        pose: Pose,
        lens: Lens,
        at_px: [f64; 2],
        dt_s: f64,
        clear: Clearance,
    ) -> (Pose, Followed) {
        match self {
            Self::Point(point) => follow_point(pose, lens, *point, at_px, dt_s, clear),
            Self::Direction(direction) => (face(pose, lens, *direction, at_px), Followed::There),
            Self::Orbit(orbit, last_px) => {
                let by_px = [at_px[0] - last_px[0], at_px[1] - last_px[1]];
                *last_px = at_px;
                if by_px == [0.0; 2] {
                    return (pose, Followed::There);
                }
                *orbit = orbit.dragged(by_px, lens, clear);
                (orbit.pose(), Followed::There)
            }
        }
    }
}

/// The point in the middle of the picture: on the middle ray, at the distance of what is drawn there.
pub(super) fn middle(pose: Pose, lens: Lens, around: &dyn Surroundings) -> Option<Point<Ecef>> {
    let picked = Anchor::pick(pose, lens, lens.middle_px(), around)?.point;
    let view = lens.view(pose);
    let distance_m = (picked - view.eye()).xyz().dot(view.forward());
    (distance_m > 0.0).then(|| Point::new(view.eye().xyz() + view.forward() * distance_m))
}

fn follow_point(
    pose: Pose,
    lens: Lens,
    point: Point<Ecef>,
    at_px: [f64; 2],
    dt_s: f64,
    clear: Clearance,
) -> (Pose, Followed) {
    let Some(way) = hold(pose, lens, point, at_px) else {
        return (pose, Followed::Stopped);
    };
    // The eye's own way is longer than the one on the ground below it.
    let length_m = way.east_m.hypot(way.north_m) * (1.0 + pose.eye.height_m.max(0.0) / radius_m(pose.eye));
    let most_m = MAX_HEIGHTS_PER_S * clear.height_m(pose.eye) * dt_s;
    let cap = (most_m / length_m.max(f64::MIN_POSITIVE)).min(1.0);
    let go = |share: f64| moved(pose, way.east_m * cap * share, way.north_m * cap * share);
    let share = clear.clear_share(length_m * cap, go);
    if share < 1.0 {
        return climbed(go(share), go(1.0), clear);
    }
    let followed = match way.reach {
        _ if cap < 1.0 => Followed::Behind,
        Reach::Cursor => Followed::There,
        Reach::Limb => Followed::Stopped,
    };
    (go(1.0), followed)
}

/// Where a gentle slope holds a drag back, the eye rises with it; walls and cliffs stop it.
fn climbed(held_back: Pose, wanted: Pose, clear: Clearance) -> (Pose, Followed) {
    let left_m = held_back.eye.to_ecef().distance_m(wanted.eye.to_ecef());
    let lack_m = clear.lack_m(wanted.eye);
    let raised = Pose { eye: wanted.eye.at_height(wanted.eye.height_m + lack_m), ..wanted };
    let climbs = lack_m <= left_m && clear.lack_m(raised.eye) <= 0.0;
    if climbs { (raised, Followed::Behind) } else { (held_back, Followed::Stopped) }
}
