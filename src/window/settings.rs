//! What a user set, kept from run to run in a TOML file at the platform's place.

use super::overlays::Overlays;
use super::panels::{Open, Quality};
use crate::camera::Pose;
use crate::geodesy::Geodetic;
use crate::select::CollectionSet;
use crate::store::{CollectionInfo, write_whole};
use crate::units::ByteSize;
use serde::{Deserialize, Deserializer, Serialize, Serializer};
use std::fs::File;
use std::io::{self, Read, Write};
use std::path::{Path, PathBuf};

/// Worlds whose last view is remembered; the longest unvisited is forgotten first.
pub const LAST_VIEWS_MAX: usize = 32;
/// A larger file is none of ours.
const FILE_BYTES_MAX: u64 = 1 << 20;
/// Names tried for a broken file before giving up.
const ASIDE_MAX: u32 = 100;
/// Sides that a window may be asked to have, logical pixels.
const SIDE_PX: [f64; 2] = [160.0, 16_384.0];
const SCALE: [f64; 2] = [0.5, 4.0];
const EYE_HEIGHT_M: [f64; 2] = [-12_000.0, 1e9];

/// Missing keys have defaults; unknown ones are kept as they are, but for those of panels, overlays and views.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct Settings {
    pub window: WindowSettings,
    pub quality: QualitySettings,
    pub panels: Open,
    pub overlays: Overlays,
    pub sets: SetSettings,
    /// Latest first; at most [`LAST_VIEWS_MAX`].
    #[serde(rename = "last_view")]
    pub last_views: Vec<LastView>,
    /// Of other versions of the program.
    #[serde(flatten)]
    pub others: toml::Table,
}

/// Building sets and the like.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct SetSettings {
    /// Names of those that are hidden, in whatever world; at most [`HIDDEN_NAMES_MAX`], latest first.
    pub hidden: Vec<String>,
    #[serde(flatten)]
    pub others: toml::Table,
}

/// See [`SetSettings::hidden`].
pub const HIDDEN_NAMES_MAX: usize = 256;

impl SetSettings {
    /// Those of a world's collections that are hidden.
    pub fn hidden(&self, collections: &[CollectionInfo]) -> CollectionSet {
        let numbered = (0..=u8::MAX).zip(collections).filter(|(_, info)| self.hidden.contains(&info.name));
        numbered.fold(CollectionSet::NONE, |set, (number, _)| set.with(number))
    }

    /// Keeps which sets were hidden at last, by name; what is told of no set stays.
    pub fn keep<'a>(&mut self, sets: impl Iterator<Item = (&'a str, bool)>) {
        let told: Vec<(&str, bool)> = sets.collect();
        self.hidden.retain(|name| told.iter().all(|(other, _)| other != name));
        let hidden = told.iter().filter(|(_, is_hidden)| *is_hidden).map(|(name, _)| (*name).to_owned());
        self.hidden.splice(0..0, hidden);
        self.hidden.truncate(HIDDEN_NAMES_MAX);
    }
}

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct WindowSettings {
    /// Logical pixels, 160 to 16,384; of the window while it is not maximized.
    pub width_px: f64,
    pub height_px: f64,
    pub maximized: bool,
    /// Size of texts and panels over what the display asks for, 0.5 to 4.
    pub scale: f64,
    #[serde(flatten)]
    pub others: toml::Table,
}

impl Default for WindowSettings {
    fn default() -> Self {
        Self { width_px: 1280.0, height_px: 720.0, maximized: false, scale: 1.0, others: toml::Table::new() }
    }
}

/// [`Quality`] as the file has it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct QualitySettings {
    pub tolerance_px: f64,
    pub footprint_bytes: u64,
    /// `"off"`, or the time that a frame may take.
    #[serde(with = "off_or_number")]
    pub frame_ms: Option<f64>,
    #[serde(flatten)]
    pub others: toml::Table,
}

impl Default for QualitySettings {
    fn default() -> Self {
        Self::from(Quality::default())
    }
}

impl From<Quality> for QualitySettings {
    fn from(quality: Quality) -> Self {
        Self {
            tolerance_px: quality.tolerance_px,
            footprint_bytes: quality.footprint.0,
            frame_ms: quality.frame_ms,
            others: toml::Table::new(),
        }
    }
}

impl QualitySettings {
    pub fn quality(&self) -> Quality {
        Quality { tolerance_px: self.tolerance_px, footprint: ByteSize(self.footprint_bytes), frame_ms: self.frame_ms }
    }

    /// Takes over what is set and leaves unknown keys as they are.
    pub fn set(&mut self, quality: Quality) {
        *self = Self { others: std::mem::take(&mut self.others), ..Self::from(quality) };
    }
}

/// Where the eye was when a world was left.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct LastView {
    pub world: String,
    /// Of the manifest: another world of the same name is another world.
    pub recipe_hash: String,
    pub lat_deg: f64,
    pub lon_deg: f64,
    /// Above the ellipsoid.
    pub height_m: f64,
    pub heading_deg: f64,
    pub pitch_deg: f64,
}

impl LastView {
    /// `None` where a number is out of its range.
    fn pose(&self) -> Option<Pose> {
        let fits = self.lat_deg.abs() <= 90.0
            && self.lon_deg.abs() <= 180.0
            && (EYE_HEIGHT_M[0]..=EYE_HEIGHT_M[1]).contains(&self.height_m)
            && self.heading_deg.abs() <= 360.0
            && self.pitch_deg.abs() <= 90.0;
        fits.then(|| Pose {
            eye: Geodetic::from_degrees(self.lat_deg, self.lon_deg, self.height_m),
            heading_rad: self.heading_deg.to_radians(),
            pitch_rad: self.pitch_deg.to_radians(),
        })
    }
}

impl Settings {
    /// Where the eye was in a world; `None` for a world not seen before.
    pub fn last_view(&self, world: &str, recipe_hash: &str) -> Option<Pose> {
        self.last_views.iter().find(|view| view.world == world && view.recipe_hash == recipe_hash)?.pose()
    }

    pub fn remember_view(&mut self, world: &str, recipe_hash: &str, pose: Pose) {
        self.last_views.retain(|view| view.world != world || view.recipe_hash != recipe_hash);
        let view = LastView {
            world: world.to_owned(),
            recipe_hash: recipe_hash.to_owned(),
            lat_deg: pose.eye.lat_deg(),
            lon_deg: pose.eye.lon_deg(),
            height_m: pose.eye.height_m,
            heading_deg: pose.heading_rad.to_degrees() % 360.0,
            pitch_deg: pose.pitch_rad.to_degrees(),
        };
        if view.pose().is_some() {
            self.last_views.insert(0, view);
        }
        self.last_views.truncate(LAST_VIEWS_MAX);
    }

    /// Numbers brought into their ranges.
    fn sane(mut self) -> Self {
        let fallback = WindowSettings::default();
        self.window.width_px = within(self.window.width_px, SIDE_PX, fallback.width_px);
        self.window.height_px = within(self.window.height_px, SIDE_PX, fallback.height_px);
        self.window.scale = within(self.window.scale, SCALE, fallback.scale);
        let sane = self.quality.quality().sane();
        self.quality.set(sane);
        self.last_views.truncate(LAST_VIEWS_MAX);
        self
    }
}

fn within(value: f64, [low, high]: [f64; 2], fallback: f64) -> f64 {
    if value.is_finite() { value.clamp(low, high) } else { fallback }
}

mod off_or_number {
    use super::{Deserialize, Deserializer, Serialize, Serializer};

    #[derive(Serialize, Deserialize)]
    #[serde(untagged)]
    enum Written {
        Number(f64),
        Whole(i64),
        Word(String),
    }

    pub fn serialize<S: Serializer>(value: &Option<f64>, serializer: S) -> Result<S::Ok, S::Error> {
        value.map_or_else(|| Written::Word("off".into()), Written::Number).serialize(serializer)
    }

    pub fn deserialize<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Option<f64>, D::Error> {
        match Written::deserialize(deserializer)? {
            Written::Number(number) => Ok(Some(number)),
            Written::Whole(number) => Ok(Some(number as f64)),
            Written::Word(word) if word == "off" => Ok(None),
            Written::Word(word) => {
                Err(serde::de::Error::custom(format!("{word:?} is neither \"off\" nor a time in milliseconds")))
            }
        }
    }
}

#[derive(Debug, thiserror::Error)]
pub enum SettingsError {
    #[error("cannot save the settings to {}: {cause}; check the folder's rights and the disk's free space", file.display())]
    Write { file: PathBuf, cause: io::Error },
    #[error("cannot save the settings: {0}")]
    Encode(#[from] toml::ser::Error),
}

/// The file of the settings.
#[derive(Clone, Debug)]
pub struct SettingsFile {
    path: PathBuf,
    /// Whether saving may replace what lies there.
    is_ours: bool,
}

impl SettingsFile {
    /// At the platform's place; `None` where the user has no home.
    pub fn of_user() -> Option<Self> {
        directories::ProjectDirs::from("", "", "stoop")
            .map(|places| Self::at(places.config_dir().join("settings.toml")))
    }

    pub fn at(path: impl Into<PathBuf>) -> Self {
        Self { path: path.into(), is_ours: true }
    }

    /// The settings, and what is to be said about them. A broken file is set aside under another name; a file that
    /// cannot be read or set aside is left, and nothing is saved in this run. Both give the defaults.
    pub fn load(&mut self) -> (Settings, Option<String>) {
        let text = match read_bounded(&self.path) {
            Ok(text) => text,
            Err(error) if error.kind() == io::ErrorKind::NotFound => return (Settings::default(), None),
            Err(error) if error.kind() == io::ErrorKind::InvalidData => return self.give_up(&error.to_string()),
            Err(error) => {
                self.is_ours = false;
                let path = self.path.display();
                let said =
                    format!("cannot read the settings {path}: {error}; using defaults, and saving nothing there");
                return (Settings::default(), Some(said));
            }
        };
        match toml::from_str::<Settings>(&text) {
            Ok(settings) => (settings.sane(), None),
            Err(error) => {
                let line =
                    error.span().map_or(1, |span| 1 + text.bytes().take(span.start).filter(|&b| b == b'\n').count());
                self.give_up(&format!("line {line}: {}", error.message()))
            }
        }
    }

    fn give_up(&mut self, cause: &str) -> (Settings, Option<String>) {
        let path = self.path.display();
        let said = match set_aside(&self.path) {
            Ok(aside) => format!(
                "the settings {path} are broken ({cause}); using defaults, the file is kept as {}",
                aside.display()
            ),
            Err(error) => {
                self.is_ours = false;
                format!(
                    "the settings {path} are broken ({cause}) and cannot be renamed ({error}); using defaults, and saving \
                     nothing there until the file is moved away"
                )
            }
        };
        (Settings::default(), Some(said))
    }

    /// Whole or not at all; nothing where the file turned out not to be ours to replace.
    pub fn save(&self, settings: &Settings) -> Result<(), SettingsError> {
        if !self.is_ours {
            return Ok(());
        }
        let text = toml::to_string(&settings.clone().sane())?;
        let fail = |cause| SettingsError::Write { file: self.path.clone(), cause };
        if let Some(folder) = self.path.parent() {
            std::fs::create_dir_all(folder).map_err(fail)?;
        }
        write_whole(&self.path, |file| file.write_all(text.as_bytes())).map_err(fail)
    }
}

fn read_bounded(path: &Path) -> io::Result<String> {
    let mut bytes = Vec::new();
    File::open(path)?.take(FILE_BYTES_MAX + 1).read_to_end(&mut bytes)?;
    if bytes.len() as u64 > FILE_BYTES_MAX {
        return Err(io::Error::new(io::ErrorKind::InvalidData, "it is too large"));
    }
    String::from_utf8(bytes).map_err(|_| io::Error::new(io::ErrorKind::InvalidData, "it is no text"))
}

/// Renames a file to the first free `NAME.broken-N` and tells which.
fn set_aside(path: &Path) -> io::Result<PathBuf> {
    for attempt in 1..=ASIDE_MAX {
        let mut name = path.file_name().unwrap_or_default().to_owned();
        name.push(format!(".broken-{attempt}"));
        let aside = path.with_file_name(name);
        if !aside.try_exists()? {
            std::fs::rename(path, &aside)?;
            return Ok(aside);
        }
    }
    Err(io::Error::other("there are too many broken ones beside it"))
}

#[cfg(test)]
mod tests;
