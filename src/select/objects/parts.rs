//! What is drawn of resident pages: the objects that are in view and above the threshold, by page.

use super::super::sight::Sight;
use super::super::{DrawObjects, SelectStats};
use super::family::Draw;
use crate::content::{CellObjects, ObjectPage};
use crate::geodesy::{OrientedBox, SEMI_MAJOR_M};
use glam::DVec3;
use std::collections::HashMap;
use std::f64::consts::{FRAC_PI_4, SQRT_2};
use std::ops::Range;

/// Pages wider than this are culled by the horizon cell by cell.
const HORIZON_BY_CELL_M: f64 = 20_000.0;

pub struct Parts<'a, 'b> {
    sight: &'a Sight<'a>,
    /// Least projected dimension, px.
    threshold_px: f64,
    stats: &'b mut SelectStats,
    drawn: Vec<DrawObjects>,
    /// Where each page is among the drawn.
    at: HashMap<*const ObjectPage, usize>,
}

impl<'a, 'b> Parts<'a, 'b> {
    pub fn new(sight: &'a Sight<'a>, threshold_px: f64, stats: &'b mut SelectStats) -> Self {
        Self { sight, threshold_px, stats, drawn: Vec::new(), at: HashMap::new() }
    }

    /// Adds a page, or its part for one subtree.
    pub fn add(&mut self, draw: &Draw) {
        let mut ranges = Vec::new();
        for cell in draw.page.cells.iter().filter(|cell| draw.part.is_none_or(|part| part == cell.cell)) {
            let drawn =
                if self.is_in_view(draw, cell) { self.above_threshold(&draw.page, cell, &mut ranges) } else { 0 };
            let count = cell.objects.end - cell.objects.start;
            self.stats.objects_tested += count;
            self.stats.objects_drawn += drawn;
            self.stats.objects_culled += count - drawn;
        }
        if ranges.is_empty() {
            return;
        }
        let at = *self.at.entry(std::sync::Arc::as_ptr(&draw.page)).or_insert(self.drawn.len());
        match self.drawn.get_mut(at) {
            Some(drawn) => drawn.objects.extend(ranges),
            None => self.drawn.push(DrawObjects { page: draw.page.clone(), objects: ranges }),
        }
    }

    pub fn finish(mut self) -> Vec<DrawObjects> {
        for drawn in &mut self.drawn {
            drawn.objects.sort_unstable_by_key(|range| range.start);
        }
        self.drawn
    }

    fn is_in_view(&self, draw: &Draw, cell: &CellObjects) -> bool {
        let Some(first) = draw.page.objects.get(cell.objects.start as usize) else {
            return false;
        };
        // A ball round any of the cell's objects that holds the cell; no cell is wider than high.
        let side_m = SEMI_MAJOR_M * 1.01 * FRAC_PI_4 / f64::from(1u32 << cell.cell.level());
        let (low_m, high_m) = cell.height_range_m;
        let radius_m = SQRT_2 * side_m + draw.reach_m / 2.0 + f64::from(high_m - low_m).max(0.0);
        if !self.sight.frustum.meets_ball(first.place, radius_m) {
            return false;
        }
        let distance_m = self.sight.eye.distance_m(first.place) - radius_m;
        if !self.is_above_threshold(f64::from(cell.dimension_m), distance_m) {
            return false;
        }
        let ball =
            OrientedBox { center: first.place, axes: [DVec3::X, DVec3::Y, DVec3::Z], half_m: DVec3::splat(radius_m) };
        !(draw.widest_m > HORIZON_BY_CELL_M && self.sight.horizon.hides_box(&ball))
    }

    fn is_above_threshold(&self, dimension_m: f64, distance_m: f64) -> bool {
        self.sight.view.projected_px(dimension_m, distance_m) >= self.threshold_px
    }

    fn above_threshold(&self, page: &ObjectPage, cell: &CellObjects, ranges: &mut Vec<Range<u32>>) -> u32 {
        let mut drawn = 0;
        for at in cell.objects.clone() {
            let Some(object) = page.objects.get(at as usize) else {
                break;
            };
            if self.is_above_threshold(f64::from(object.dimension_m), self.sight.eye.distance_m(object.place)) {
                drawn += 1;
                push(ranges, at);
            }
        }
        drawn
    }
}

fn push(ranges: &mut Vec<Range<u32>>, at: u32) {
    match ranges.last_mut() {
        Some(last) if last.end == at => last.end = at + 1,
        _ => ranges.push(at..at + 1),
    }
}
