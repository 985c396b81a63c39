//! Building sets as a stage: prepared on the finished terrain, kept, and read back for the packs.

use super::buildings::{Ground, ObjectsPage, PreparedCollection, prepare_collection};
use super::pipeline::BuildError;
use super::recipe::BuildingsSection;
use super::stage::{StageReader, Stages};
use super::{OnProgress, Recipe};
use crate::forest::{CellId, LEVEL_MAX};
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

/// A finished building set.
#[derive(Clone, Debug)]
pub struct Collection {
    pub info: CollectionInfo,
    pub source: SourceInfo,
    /// In the order in which they are to lie in the packs.
    pub pages: Vec<ObjectsPage>,
}

/// The first record of a collection's stage, JSON; the pages follow.
#[derive(Serialize, Deserialize)]
struct Head {
    info: CollectionInfo,
    source: SourceInfo,
}

/// Prepares the collection of a section. `vertical`: what its bases count from where it does not say.
pub fn prepare(
    section: &BuildingsSection,
    number: u8,
    root: &Path,
    vertical: VerticalDatum,
    ground: &Ground,
    on_progress: OnProgress<'_>,
) -> Result<Collection, BuildError> {
    let PreparedCollection { info, source, pages, .. } =
        prepare_collection(section, root, vertical, ground, number, on_progress)?;
    Ok(Collection { info, source, pages })
}

/// What bases count from where a section does not say: what the recipe's last elevation source counts from.
pub(super) fn vertical_of(recipe: &Recipe) -> VerticalDatum {
    recipe.elevation.last().map_or(VerticalDatum::Egm96, |section| section.vertical)
}

/// Name of a collection's stage.
pub fn stage_name(number: usize) -> String {
    format!("collection-{number}")
}

/// Keeps a collection as a finished stage.
pub fn keep(collection: &Collection, number: usize, stages: &Stages) -> Result<(), BuildError> {
    let head = Head { info: collection.info.clone(), source: collection.source.clone() };
    let bad = |_| BuildError::StageContent(stage_name(number));
    let mut writer = stages.write(&stage_name(number))?;
    writer.record(&serde_json::to_vec(&head).map_err(bad)?)?;
    for page in &collection.pages {
        writer.record(&page_record(page))?;
    }
    Ok(writer.finish()?)
}

/// Reads a kept collection; `None` when that stage is not done.
pub fn kept(number: usize, stages: &Stages) -> Result<Option<Collection>, BuildError> {
    let bad = || BuildError::StageContent(stage_name(number));
    let Some(mut reader): Option<StageReader> = stages.read(&stage_name(number))? else {
        return Ok(None);
    };
    let head = reader.record()?.ok_or_else(bad)?;
    let Head { info, source } = serde_json::from_slice(&head).map_err(|_| bad())?;
    let mut pages = Vec::new();
    while let Some(record) = reader.record()? {
        pages.push(read_page_record(&record).ok_or_else(bad)?);
    }
    Ok(Some(Collection { info, source, pages }))
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
