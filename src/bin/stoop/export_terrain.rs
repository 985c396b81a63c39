//! Terrain of a world as a GeoTIFF.

use std::path::Path;
use std::sync::Arc;
use stoop::content::{POSTS, Page, PageId, PageKind, TerrainPage};
use stoop::forest::{CellId, ZONE_DEG};
use stoop::geodesy::{GeoBounds, Geodetic};
use stoop::store::{StoreError, World};

/// The most posts that one file takes.
const POSTS_MAX: f64 = 400e6;

/// Heights on the posts of `level` inside `[west, south, east, north]` degrees; returns width and height.
pub fn write(world: &World, [west, south, east, north]: [f64; 4], level: u8, out: &Path) -> anyhow::Result<[u32; 2]> {
    let step_deg = ZONE_DEG / (POSTS - 1) as f64 / f64::from(1u32 << level);
    let (columns, rows) = (((east - west) / step_deg).floor() + 1.0, ((north - south) / step_deg).floor() + 1.0);
    anyhow::ensure!(
        columns * rows <= POSTS_MAX,
        "{columns} × {rows} posts are too many for one file: take a coarser --level or smaller --bounds"
    );
    let (columns, rows) = (columns as u32, rows as u32);
    let mut surfaces = Surfaces { world, level, page: None };
    let mut heights = Vec::with_capacity(columns as usize * rows as usize);
    for row in 0..rows {
        for column in 0..columns {
            let (lat_deg, lon_deg) = (north - f64::from(row) * step_deg, west + f64::from(column) * step_deg);
            heights.push(surfaces.height_m(Geodetic::from_degrees(lat_deg, lon_deg, 0.0))?);
        }
    }
    stoop::prepare::write_geotiff(out, [columns, rows], [west, north], step_deg, &heights)?;
    Ok([columns, rows])
}

/// Terrain pages, read as a walk over neighbouring places needs them: the last one is kept.
struct Surfaces<'a> {
    world: &'a World,
    level: u8,
    page: Option<(GeoBounds, Arc<TerrainPage>)>,
}

impl Surfaces<'_> {
    /// NaN where the world has no terrain.
    fn height_m(&mut self, place: Geodetic) -> Result<f32, StoreError> {
        let wanted = CellId::containing(place.lat_rad, place.lon_rad, self.level);
        let bounds = wanted.bounds();
        if self.page.as_ref().is_none_or(|(held, _)| *held != bounds) {
            self.page = self.finest_page(wanted)?.map(|page| (bounds, page));
        }
        let height_m =
            self.page.as_ref().and_then(|(_, page)| page.surface_height_m(place.lat_rad, place.lon_rad, 1.0));
        Ok(height_m.map_or(f32::NAN, |height_m| height_m as f32))
    }

    fn finest_page(&self, wanted: CellId) -> Result<Option<Arc<TerrainPage>>, StoreError> {
        for cell in wanted.ancestors() {
            let Some(entry) = self.world.index().find(cell).and_then(|node| node.terrain()) else { continue };
            let id = PageId { cell, kind: PageKind::Terrain };
            if let Page::Terrain(page) = self.world.load(id, entry.place)? {
                return Ok(Some(page));
            }
        }
        Ok(None)
    }
}
