//! Recipe → world, in stages: read the sources, the terrain and imagery of each zone, each collection, the world's
//! files. What a stage made is kept until the world is whole, so that a stopped build goes on where it stopped.

use super::assemble;
use super::buildings::Ground;
use super::collections::{self, Collection, TerrainErrors};
use super::imagery;
use super::stage::{StageError, StageReader, Stages};
use super::task::{Stopped, Task};
use super::terrain::Terrain;
use super::zone::{CellPages, EmitError, EncodedTerrain, ZonePages};
use super::{Elevation, OnProgress, Pictures, PrepareError, Recipe, recipe_hash};
use crate::forest::index::IndexError;
use crate::forest::{CellId, Zone};
use crate::store::{EncodeError, Manifest, StoreError};
use crate::units::ByteSize;
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::sync::atomic::AtomicBool;
use std::time::Instant;

/// Why no world came out. Nothing half-written stays where the world was to be.
#[derive(Debug, thiserror::Error)]
pub enum BuildError {
    #[error(transparent)]
    Source(#[from] PrepareError),
    #[error(transparent)]
    Stopped(#[from] Stopped),
    #[error(transparent)]
    Stage(#[from] StageError),
    #[error(transparent)]
    Store(#[from] StoreError),
    #[error("a page cannot be written: {0}")]
    Encode(#[from] EncodeError),
    #[error("the index cannot be built: {0}")]
    Index(#[from] IndexError),
    #[error("a stage file holds what this version cannot read; remove the folder {0} and run again")]
    StageContent(String),
}

impl From<EmitError<StageError>> for BuildError {
    fn from(error: EmitError<StageError>) -> Self {
        match error {
            EmitError::Stopped(stopped) => Self::Stopped(stopped),
            EmitError::Encode(error) => Self::Encode(error),
            EmitError::Sink(error) => Self::Stage(error),
        }
    }
}

/// What to do.
#[derive(Clone, Debug)]
pub struct BuildOptions {
    pub out: PathBuf,
    /// What the recipe's paths are relative to, when not its own folder.
    pub root: Option<PathBuf>,
    /// For decoded sources, bytes.
    pub memory: ByteSize,
    /// A world that is there already is replaced once the new one is whole.
    pub replace: bool,
}

/// A stage that is done.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct StageDone {
    pub stage: &'static str,
    pub item: String,
    /// Cells, pages or objects.
    pub count: u64,
    pub bytes: u64,
    pub seconds: f64,
    /// Taken over from an earlier run.
    pub resumed: bool,
}

/// How a build is watched and stopped.
pub struct Control<'a> {
    /// Set to stop after the steps that are under way.
    pub stop: &'a AtomicBool,
    pub on_progress: OnProgress<'a>,
    pub on_done: &'a dyn Fn(&StageDone),
    /// Things that people should know, such as work of another recipe being dropped.
    pub on_note: &'a dyn Fn(&str),
}

/// Prepares a world; returns its manifest.
pub fn build(recipe: &Recipe, options: &BuildOptions, control: &Control) -> Result<Manifest, BuildError> {
    assemble::check_target(&options.out, options.replace)?;
    let root = options.root.as_deref().unwrap_or(recipe.root());
    let fingerprint = recipe_hash::of(recipe, root)?;
    let started = Instant::now();
    let elevation = Elevation::open(recipe, root, half(options.memory), control.on_progress)?;
    let pictures = Pictures::open(recipe, root, half(options.memory), control.on_progress)?;
    let mut sources: Vec<_> = elevation.sources().into_iter().chain(pictures.sources()).collect();
    let samples = sources.iter().map(|source| source.count).sum();
    done(control, "read", "sources", samples, 0, started, false);

    let (stages, was_other) = Stages::open(&options.out, fingerprint.stages)?;
    if was_other {
        (control.on_note)(
            "the unfinished work beside the output was for another recipe or other sources: starting afresh",
        );
    }
    let inputs = Inputs { elevation: &elevation, pictures: &pictures, stages: &stages, control };
    for zone in Zone::all() {
        inputs.zone(zone)?;
    }
    let errors = inputs.errors()?;
    let count = u8::try_from(recipe.buildings.len()).map_err(|_| too_many_collections(recipe))?;
    let collections: Vec<Collection> =
        (0..count).map(|number| inputs.collection(recipe, root, &errors, number)).collect::<Result<_, _>>()?;
    sources.extend(collections.iter().map(|collection| collection.source.clone()));
    let started = Instant::now();
    let manifest = assemble::world(recipe, fingerprint.world, options, &stages, sources, collections, control)?;
    done(
        control,
        "write",
        &options.out.display().to_string(),
        0,
        manifest.pack_bytes + manifest.index_bytes,
        started,
        false,
    );
    stages.remove()?;
    Ok(manifest)
}

pub(super) fn too_many_collections(recipe: &Recipe) -> PrepareError {
    let what = format!("{} building sets are too many", recipe.buildings.len());
    PrepareError::value(recipe.path.display(), "[[buildings]]", what, "a world holds at most 255; join some")
}

pub(super) fn half(memory: ByteSize) -> ByteSize {
    ByteSize(memory.0 / 2)
}

pub(super) fn done(
    control: &Control,
    stage: &'static str,
    item: &str,
    count: u64,
    bytes: u64,
    since: Instant,
    resumed: bool,
) {
    let seconds = since.elapsed().as_secs_f64();
    (control.on_done)(&StageDone { stage, item: item.to_owned(), count, bytes, seconds, resumed });
}

struct Inputs<'a> {
    elevation: &'a Elevation,
    pictures: &'a Pictures,
    stages: &'a Stages,
    control: &'a Control<'a>,
}

impl Inputs<'_> {
    fn task(&self, stage: &'static str, item: &str, total: u64) -> Task<'_> {
        Task::new(stage, item, total, self.control.stop, self.control.on_progress)
    }

    /// Terrain and imagery of a zone.
    fn zone(&self, zone: Zone) -> Result<(), BuildError> {
        let (name, started) = (zone_stage(zone), Instant::now());
        if let Some(mut reader) = self.stages.read(&name)? {
            let (mut count, mut bytes) = (0, 0);
            while let Some(record) = reader.record()? {
                (count, bytes) = (count + 1, bytes + record.len() as u64);
            }
            done(self.control, "zone", &name, count, bytes, started, true);
            return Ok(());
        }
        let terrain = Terrain { truth: self.elevation, task: &self.task("measure terrain", &name, 0) }.plan(zone)?;
        let imagery = imagery::plan(self.pictures, zone, &self.task("plan imagery", &name, 0))?;
        let cells: BTreeSet<_> = terrain.keys().chain(&imagery).collect();
        let task = self.task("make pages", &name, cells.len() as u64);
        let pages = ZonePages {
            truth: self.elevation,
            terrain: &terrain,
            pictures: self.pictures,
            imagery: &imagery,
            task: &task,
        };
        let mut writer = self.stages.write(&name)?;
        let (mut count, mut bytes) = (0, 0);
        pages.emit(zone, &mut |cell, pages| {
            let record = cell_record(cell, &pages);
            (count, bytes) = (count + 1, bytes + record.len() as u64);
            writer.record(&record)
        })?;
        self.heights_were_read()?;
        writer.finish()?;
        done(self.control, "zone", &name, count, bytes, started, false);
        Ok(())
    }

    /// A stage made of heights that could not be read must not be kept.
    fn heights_were_read(&self) -> Result<(), BuildError> {
        self.elevation.failure().map_or(Ok(()), |failure| Err(failure.into()))
    }

    fn errors(&self) -> Result<TerrainErrors, BuildError> {
        let mut errors = TerrainErrors::default();
        for zone in Zone::all() {
            for_each_cell(self.stages, zone, &mut |cell, pages| {
                if let Some(terrain) = pages.terrain {
                    errors.insert(cell, terrain.error_m);
                }
                Ok(())
            })?;
        }
        Ok(errors)
    }

    fn collection(
        &self,
        recipe: &Recipe,
        root: &Path,
        errors: &TerrainErrors,
        number: u8,
    ) -> Result<Collection, BuildError> {
        let started = Instant::now();
        let section = &recipe.buildings[usize::from(number)];
        let report = |collection: &Collection, resumed| {
            let info = &collection.info;
            done(self.control, "objects", &section.name, info.objects, info.bytes, started, resumed);
        };
        if let Some(collection) = collections::kept(number.into(), self.stages)? {
            report(&collection, true);
            return Ok(collection);
        }
        let task = self.task("objects", &section.name, 0);
        task.step()?;
        let ground = Ground {
            height_m: &|lat_rad, lon_rad| self.elevation.height_m(lat_rad, lon_rad),
            error_m: &|lat_rad, lon_rad| errors.finest_m(lat_rad, lon_rad),
        };
        let vertical = collections::vertical_of(recipe);
        let check = || {
            task.go_on()?;
            self.heights_were_read()
        };
        let on_progress = self.control.on_progress;
        let order = collections::Order { section, number, root, vertical, stages: self.stages, on_progress };
        let collection = collections::prepare(&order, &ground, &check)?;
        report(&collection, false);
        Ok(collection)
    }
}

/// Name of a zone's stage.
pub fn zone_stage(zone: Zone) -> String {
    format!("zone-{:02}", zone.index())
}

/// Cell, error, lowest and highest height, lengths of the two pages (little-endian), then the pages. A length of 0
/// stands for no page.
fn cell_record(cell: CellId, pages: &CellPages) -> Vec<u8> {
    let (terrain, imagery) = (pages.terrain.as_ref(), pages.imagery.as_deref().unwrap_or_default());
    let mut record = cell.to_u64().to_le_bytes().to_vec();
    let range = terrain.map_or((0.0, 0.0), |terrain| terrain.height_range_m);
    for value in [terrain.map_or(0.0, |terrain| terrain.error_m), range.0, range.1] {
        record.extend(value.to_le_bytes());
    }
    let bytes = terrain.map_or(&[][..], |terrain| &terrain.bytes);
    for len in [bytes.len() as u32, imagery.len() as u32] {
        record.extend(len.to_le_bytes());
    }
    record.extend(bytes);
    record.extend(imagery);
    record
}

const RECORD_HEAD: usize = 8 + 3 * 4 + 2 * 4;

fn read_cell_record(record: &[u8]) -> Option<(CellId, CellPages)> {
    let word = |at: usize| record.get(at..at + 4)?.try_into().ok();
    let float = |at: usize| Some(f32::from_le_bytes(word(at)?));
    let cell = CellId::from_u64(u64::from_le_bytes(record.get(..8)?.try_into().ok()?))?;
    let len = |at: usize| Some(u32::from_le_bytes(word(at)?) as usize);
    let (terrain_len, imagery_len) = (len(20)?, len(24)?);
    let (terrain, imagery) = record.get(RECORD_HEAD..)?.split_at_checked(terrain_len)?;
    let terrain = (terrain_len > 0).then_some(EncodedTerrain {
        bytes: terrain.to_vec(),
        error_m: float(8)?,
        height_range_m: (float(12)?, float(16)?),
    });
    (imagery.len() == imagery_len)
        .then(|| (cell, CellPages { terrain, imagery: (imagery_len > 0).then(|| imagery.to_vec()) }))
}

/// Visits the pages of a finished zone in their order.
pub fn for_each_cell(
    stages: &Stages,
    zone: Zone,
    visit: &mut dyn FnMut(CellId, CellPages) -> Result<(), BuildError>,
) -> Result<(), BuildError> {
    let name = zone_stage(zone);
    let missing = || BuildError::StageContent(name.clone());
    let mut reader: StageReader = stages.read(&name)?.ok_or_else(missing)?;
    while let Some(record) = reader.record()? {
        let (cell, pages) = read_cell_record(&record).ok_or_else(missing)?;
        visit(cell, pages)?;
    }
    Ok(())
}
