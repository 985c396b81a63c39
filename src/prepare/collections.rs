//! Building sets as a stage: prepared on the finished terrain, kept, and read back for the packs.

use super::buildings::{CollectionSummary, Ground, ObjectsPage, Packing, prepare_pages};
use super::pipeline::BuildError;
use super::recipe::BuildingsSection;
use super::stage::{StageReader, Stages};
use super::{OnProgress, Recipe};
use crate::forest::{CellId, LEVEL_MAX, Zone};
use crate::geodesy::VerticalDatum;
use crate::store::{CollectionInfo, SourceInfo};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::path::Path;

/// Declared errors of the terrain cells.
#[derive(Clone, Debug, Default)]
pub struct TerrainErrors {
    by_cell: BTreeMap<CellId, f32>,
}

impl TerrainErrors {
    pub fn insert(&mut self, cell: CellId, error_m: f32) {
        self.by_cell.insert(cell, error_m);
    }

    /// Of the finest cell at a place, metres; 0 where there is none.
    pub fn finest_m(&self, lat_rad: f64, lon_rad: f64) -> f64 {
        let chain = (0..=LEVEL_MAX).map_while(|level| self.by_cell.get(&CellId::containing(lat_rad, lon_rad, level)));
        chain.last().map_or(0.0, |&error_m| f64::from(error_m))
    }
}

/// A finished building set. Its pages stay in its stage, so that sets larger than memory can be made.
#[derive(Clone, Debug)]
pub struct Collection {
    pub info: CollectionInfo,
    pub source: SourceInfo,
    /// Lowest and highest drawn height above the ellipsoid, metres; the first above the second where nothing is drawn.
    pub height_range_m: (f64, f64),
    number: usize,
    /// Roots and places in the stage, in the order in which the pages are to lie in the packs.
    pages: Vec<(CellId, u64)>,
}

impl Collection {
    /// Whether there are pages in a zone.
    pub fn is_in(&self, zone: Zone) -> bool {
        self.pages.iter().any(|(root, _)| root.zone() == zone)
    }

    /// Visits the pages in a zone, in their order.
    pub fn for_each_page(
        &self,
        zone: Zone,
        stages: &Stages,
        visit: &mut dyn FnMut(ObjectsPage) -> Result<(), BuildError>,
    ) -> Result<(), BuildError> {
        let name = stage_name(self.number);
        let mut records = stages.records(&name)?;
        for &(_, position) in self.pages.iter().filter(|(root, _)| root.zone() == zone) {
            let record = records.read(position)?;
            visit(read_page_record(&record).ok_or_else(|| BuildError::StageContent(name.clone()))?)?;
        }
        Ok(())
    }
}

/// The last record of a collection's stage, JSON; the pages lie before it.
#[derive(Serialize, Deserialize)]
struct Summary {
    info: CollectionInfo,
    source: SourceInfo,
    /// Absent where nothing is drawn: JSON has no infinities.
    height_range_m: Option<(f64, f64)>,
}

/// What is to be prepared.
pub struct Order<'a> {
    pub section: &'a BuildingsSection,
    /// Of the collection in its world.
    pub number: u8,
    pub root: &'a Path,
    /// What bases count from where the section does not say.
    pub vertical: VerticalDatum,
    pub stages: &'a Stages,
    pub on_progress: OnProgress<'a>,
}

/// Prepares a collection as a finished stage. `check` is asked before each page and before the stage is kept: work may be
/// stopped, and a stage made of heights that could not be read must not be kept.
pub fn prepare(
    order: &Order<'_>,
    ground: &Ground,
    check: &dyn Fn() -> Result<(), BuildError>,
) -> Result<Collection, BuildError> {
    let Order { section, number, root, vertical, stages, on_progress } = *order;
    let name = stage_name(number.into());
    let bad = || BuildError::StageContent(name.clone());
    let mut writer = stages.write(&name)?;
    let mut keep = |page: ObjectsPage| {
        check()?;
        Ok(writer.record(&page_record(&page))?)
    };
    let of = Packing { name: &section.name, collection: number, ground, progress: on_progress };
    let CollectionSummary { info, source, height_range_m, .. } =
        prepare_pages::<BuildError>(section, root, vertical, &of, &mut keep)?;
    check()?;
    let height_range_m = (height_range_m.0 <= height_range_m.1).then_some(height_range_m);
    let summary = Summary { info, source, height_range_m };
    writer.record(&serde_json::to_vec(&summary).map_err(|_| bad())?)?;
    writer.finish()?;
    kept(number.into(), stages)?.ok_or_else(bad)
}

/// What bases count from where a section does not say: what the recipe's last elevation source counts from.
pub(super) fn vertical_of(recipe: &Recipe) -> VerticalDatum {
    recipe.elevation.last().map_or(VerticalDatum::Egm96, |section| section.vertical)
}

/// Name of a collection's stage.
pub fn stage_name(number: usize) -> String {
    format!("collection-{number}")
}

/// A kept collection; `None` when that stage is not done. It is read through once, for its checksum.
pub fn kept(number: usize, stages: &Stages) -> Result<Option<Collection>, BuildError> {
    let bad = || BuildError::StageContent(stage_name(number));
    let Some(mut reader): Option<StageReader> = stages.read(&stage_name(number))? else {
        return Ok(None);
    };
    let mut pages = Vec::new();
    let mut position = reader.position();
    let mut record = reader.record()?.ok_or_else(bad)?;
    loop {
        let next = reader.position();
        let Some(following) = reader.record()? else { break };
        let root = record.first_chunk().copied().map(u64::from_le_bytes).and_then(CellId::from_u64);
        pages.push((root.ok_or_else(bad)?, position));
        (position, record) = (next, following);
    }
    let Summary { info, source, height_range_m } = serde_json::from_slice(&record).map_err(|_| bad())?;
    let height_range_m = height_range_m.unwrap_or((f64::INFINITY, f64::NEG_INFINITY));
    Ok(Some(Collection { info, source, height_range_m, number, pages }))
}

/// Root, objects, dimension, reach, lowest and highest point, rep, error, largest dimension below or NaN (8 bytes each,
/// little-endian), then the page.
fn page_record(page: &ObjectsPage) -> Vec<u8> {
    let mut record = page.root.to_u64().to_le_bytes().to_vec();
    record.extend(page.objects.to_le_bytes());
    for value in [page.dimension_m, page.reach_m, page.height_range_m.0, page.height_range_m.1] {
        record.extend(value.to_le_bytes());
    }
    record.extend(u64::from(page.rep).to_le_bytes());
    for value in [page.error_m, page.below_dimension_m.unwrap_or(f64::NAN)] {
        record.extend(value.to_le_bytes());
    }
    record.extend(&page.bytes);
    record
}

fn read_page_record(record: &[u8]) -> Option<ObjectsPage> {
    let (head, bytes) = record.split_at_checked(9 * 8)?;
    let word = |at: usize| head[8 * at..8 * at + 8].try_into().map(u64::from_le_bytes).ok();
    let float = |at: usize| word(at).map(f64::from_bits);
    Some(ObjectsPage {
        root: CellId::from_u64(word(0)?)?,
        bytes: bytes.to_vec(),
        objects: word(1)?,
        dimension_m: float(2)?,
        reach_m: float(3)?,
        height_range_m: (float(4)?, float(5)?),
        rep: word(6)?.try_into().ok()?,
        error_m: float(7)?,
        below_dimension_m: float(8).filter(|dimension_m| !dimension_m.is_nan()),
        textures_scaled: 0,
        textures_lost: 0,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_page_survives_its_record() {
        let page = ObjectsPage {
            root: CellId::containing(0.6, -1.5, 14),
            bytes: vec![1, 2, 3],
            objects: 7,
            dimension_m: 80.5,
            reach_m: 40.25,
            height_range_m: (-3.0, 99.0),
            rep: 5,
            error_m: 12.5,
            below_dimension_m: Some(90.0),
            textures_scaled: 0,
            textures_lost: 0,
        };
        let back = read_page_record(&page_record(&page)).unwrap();
        assert_eq!((back.root, &back.bytes, back.objects), (page.root, &page.bytes, page.objects));
        assert_eq!(
            (back.dimension_m, back.reach_m, back.height_range_m),
            (page.dimension_m, page.reach_m, page.height_range_m)
        );
        assert_eq!((back.rep, back.error_m, back.below_dimension_m), (5, 12.5, Some(90.0)));
        let none = ObjectsPage { below_dimension_m: None, ..page.clone() };
        assert_eq!(read_page_record(&page_record(&none)).unwrap().below_dimension_m, None);
        assert!(read_page_record(&page_record(&page)[..40]).is_none());
    }
}
