//! Recipes: what a world is made of, as TOML.

use super::PrepareError;
use super::view_section::{self, ViewSection};
use crate::geodesy::VerticalDatum;
use crate::store::NamedView;
use serde::Deserialize;
use std::path::{Path, PathBuf};

/// A whole recipe, checked. Paths in it are relative to the recipe's folder, or to `--root`.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Recipe {
    pub name: String,
    #[serde(default)]
    pub elevation: Vec<ElevationSection>,
    #[serde(default)]
    pub imagery: Vec<ImagerySection>,
    #[serde(default)]
    pub buildings: Vec<BuildingsSection>,
    #[serde(default)]
    pub objects: Vec<ObjectsSection>,
    #[serde(default)]
    pub layout: Vec<LayoutSection>,
    #[serde(default)]
    pub view: Vec<ViewSection>,
    /// The text that this was read from.
    #[serde(skip)]
    pub text: String,
    /// Where it was read from.
    #[serde(skip)]
    pub path: PathBuf,
}

/// A number, or text: an attribute's name or an expression over attributes.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(untagged)]
pub enum Amount {
    Number(f64),
    Text(String),
}

/// `[[elevation]]`: heights, metres.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ElevationSection {
    /// A file, a folder, a glob, or a .zip that holds such.
    pub file: String,
    /// What its heights count from.
    #[serde(default = "default_vertical")]
    pub vertical: VerticalDatum,
    /// Width of the seam with coarser sources, metres; by default 16 of its own posts.
    pub feather_m: Option<f64>,
    /// Heights are held between these (in the source's own datum); [0, 9000] gives a sea surface instead of its floor.
    pub clamp_m: Option<[f64; 2]>,
    /// Cells whose `error_m` is already below this are not refined; default [`DEFAULT_PRUNE_ERROR_M`].
    pub prune_error_m: Option<f64>,
    /// Cells are refined once more where `error_m` is still above this.
    pub finest_error_m: Option<f64>,
    /// The value that marks posts without data; overrides the file's own.
    pub nodata: Option<f64>,
    /// Of the file, such as "EPSG:3857"; overrides the file's own.
    pub crs: Option<String>,
    /// Variable of a netCDF file.
    pub layer: Option<String>,
    #[serde(default)]
    pub credit: String,
    #[serde(default)]
    pub licence: String,
}

/// Heights are above mean sea level unless a recipe says otherwise.
fn default_vertical() -> VerticalDatum {
    VerticalDatum::Egm96
}

/// See [`ElevationSection::prune_error_m`].
pub const DEFAULT_PRUNE_ERROR_M: f64 = 0.25;

/// `[[imagery]]`: pictures of the ground; an `.osm.pbf` is painted.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ImagerySection {
    pub file: String,
    /// West, south, east, north of the picture's outer edges, for pictures without georeference.
    pub bounds_deg: Option<[f64; 4]>,
    pub crs: Option<String>,
    /// Pixels with this value in all bands are empty.
    pub nodata: Option<f64>,
    pub layer: Option<String>,
    /// Width of the seam with coarser pictures, metres; by default 8 of its own texels.
    pub feather_m: Option<f64>,
    /// The file holds heights: sea (0 and below) and land are painted by them.
    #[serde(default)]
    pub heights: bool,
    /// Ground size of a texel of what is painted, metres; default [`DEFAULT_PAINT_TEXEL_M`].
    pub texel_m: Option<f64>,
    #[serde(default)]
    pub credit: String,
    #[serde(default)]
    pub licence: String,
}

/// See [`ImagerySection::texel_m`].
pub const DEFAULT_PAINT_TEXEL_M: f64 = 1.0;

/// `[[buildings]]`: footprints to be extruded.
#[derive(Clone, Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct BuildingsSection {
    /// Of the collection.
    pub name: String,
    pub file: String,
    /// Metres: attribute, number, or expression such as `storeys * 3.5`.
    pub height: Option<Amount>,
    /// Height of the ground floor's floor in the source's vertical datum; without it the terrain carries the building.
    pub base: Option<Amount>,
    pub vertical: Option<VerticalDatum>,
    /// Number of storeys, where the height is missing.
    pub levels: Option<Amount>,
    /// Metres, where nothing else is known.
    pub default_height: Option<f64>,
    /// Height of the underside above the ground, metres.
    pub min_height: Option<Amount>,
    /// Roof shape: an attribute's name or a shape's.
    pub roof: Option<String>,
    /// An attribute's name or `#rrggbb`.
    pub color: Option<String>,
    /// The attribute that names a building.
    pub id: Option<String>,
    /// Attributes to keep; all when absent.
    pub attributes: Option<Vec<String>>,
    /// Which level of detail of the source to take.
    pub lod: Option<Amount>,
    /// A table with lon_deg, lat_deg, heading_deg: the collection is set down at each.
    pub copies: Option<String>,
    pub crs: Option<String>,
    pub nodata: Option<f64>,
    /// The table of a GeoPackage.
    pub layer: Option<String>,
    #[serde(default)]
    pub credit: String,
    #[serde(default)]
    pub licence: String,
    /// Of a section `[[objects]]`: the model that `file`, a table, sets down.
    #[serde(skip)]
    pub model: Option<ModelFile>,
}

/// A model and how it is simplified.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ModelFile {
    pub file: String,
    pub error_m: f64,
}

/// `[[objects]]`: models placed by a table; a collection like `[[buildings]]`.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ObjectsSection {
    pub name: String,
    /// glTF or GLB.
    pub file: String,
    /// CSV with lon_deg, lat_deg, and where it has them height_m, heading_deg, scale.
    pub place: String,
    /// What height_m counts from.
    pub vertical: Option<VerticalDatum>,
    /// How far a simplified model may be off, metres; the model as it is when absent.
    pub error_m: Option<f64>,
    /// Columns of the table to keep; all when absent.
    pub attributes: Option<Vec<String>>,
    #[serde(default)]
    pub credit: String,
    #[serde(default)]
    pub licence: String,
}

impl ObjectsSection {
    fn collection(&self) -> BuildingsSection {
        BuildingsSection {
            name: self.name.clone(),
            file: self.place.clone(),
            model: Some(ModelFile { file: self.file.clone(), error_m: self.error_m.unwrap_or(0.0) }),
            vertical: self.vertical,
            attributes: self.attributes.clone(),
            credit: self.credit.clone(),
            licence: self.licence.clone(),
            ..BuildingsSection::default()
        }
    }
}

/// `[[layout]]`: a single-seek layout over a collection, or over a region.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LayoutSection {
    /// What `--layout` names, and its file is named by.
    pub name: String,
    /// Of the collection over whose bounds it is made, unless `region_deg` tells them.
    pub collection: Option<String>,
    /// West, south, east, north.
    pub region_deg: Option<[f64; 4]>,
    /// Heights above ground at which bands of cells begin and end, ascending.
    #[serde(default = "default_bands_m")]
    pub altitude_bands_m: Vec<f64>,
    #[serde(default = "default_tolerance_px")]
    pub tolerance_px: f64,
    #[serde(default = "default_viewport_h_px")]
    pub viewport_h_px: f64,
    /// The storage model that the side is chosen for; see `--storage` of `stoop fly`.
    #[serde(default = "default_storage")]
    pub storage: String,
    /// Bytes of the layout over the bytes of its pages, at most.
    #[serde(default = "default_max_redundancy")]
    pub max_redundancy: f64,
    /// Side of its cells; without it the knee of the curve.
    pub side_m: Option<f64>,
}

fn default_bands_m() -> Vec<f64> {
    vec![2.0, 50.0, 200.0]
}

fn default_tolerance_px() -> f64 {
    1.0
}

fn default_viewport_h_px() -> f64 {
    720.0
}

fn default_storage() -> String {
    "wan".to_owned()
}

fn default_max_redundancy() -> f64 {
    16.0
}

impl LayoutSection {
    /// What is wrong with it: the key, and what to do.
    fn fault(&self) -> Option<(&'static str, String)> {
        let positive = |value: f64| value > 0.0 && value.is_finite();
        let bands = &self.altitude_bands_m;
        if bands.len() < 2 || !bands.is_sorted_by(|a, b| a < b) || !bands.iter().all(|edge| edge.is_finite()) {
            let what =
                format!("altitude_bands_m = {bands:?}: write heights above ground, ascending, such as [2, 50, 200]");
            return Some(("altitude_bands_m", what));
        }
        let numbers = [
            ("tolerance_px", self.tolerance_px),
            ("viewport_h_px", self.viewport_h_px),
            ("max_redundancy", self.max_redundancy),
            ("side_m", self.side_m.unwrap_or(1.0)),
        ];
        if let Some((key, value)) = numbers.into_iter().find(|(_, value)| !positive(*value)) {
            return Some((key, format!("{key} = {value}: write a number above 0")));
        }
        match (&self.region_deg, &self.collection) {
            (Some(bounds), _) if !sound_bounds(bounds) => {
                Some(("region_deg", format!("region_deg = {bounds:?}: write [west, south, east, north] in degrees")))
            }
            (None, None) => Some((
                "[[layout]]",
                "a layout needs a `collection`, or a `region_deg` = [west, south, east, north]".into(),
            )),
            _ => None,
        }
    }
}

impl Recipe {
    /// Reads and checks a recipe file.
    pub fn read(path: &Path) -> Result<Self, PrepareError> {
        let text = std::fs::read_to_string(path).map_err(|e| PrepareError::read(path, e))?;
        Self::parse(&text, path)
    }

    /// Checks a recipe's text; `path` is for messages and for [`Recipe::root`].
    pub fn parse(text: &str, path: &Path) -> Result<Self, PrepareError> {
        let mut recipe: Self = toml::from_str(text).map_err(|e| recipe_error(text, path, &e))?;
        recipe.text = text.to_owned();
        recipe.path = path.to_owned();
        recipe.buildings.extend(recipe.objects.iter().map(ObjectsSection::collection));
        recipe.check_values()?;
        Ok(recipe)
    }

    /// What relative paths are relative to, unless `--root` says otherwise: the recipe's folder.
    pub fn root(&self) -> &Path {
        self.path.parent().unwrap_or(Path::new(""))
    }

    /// The world's bookmarks.
    pub fn views(&self) -> Vec<NamedView> {
        self.view.iter().map(ViewSection::to_view).collect()
    }

    /// Whether it names anything that pages are made of; one of layouts alone does not.
    pub fn has_sources(&self) -> bool {
        !(self.elevation.is_empty() && self.imagery.is_empty() && self.buildings.is_empty())
    }

    fn check_views(&self) -> Result<(), PrepareError> {
        let Some((offset, what)) = view_section::fault(&self.view) else { return Ok(()) };
        let line = line_at(&self.text, offset);
        Err(PrepareError::Recipe { file: self.path.display().to_string(), line, what })
    }

    fn check_values(&self) -> Result<(), PrepareError> {
        let bad = |needle: &str, what: String| PrepareError::Recipe {
            file: self.path.display().to_string(),
            line: line_of(&self.text, needle),
            what,
        };
        if !self.has_sources() && self.layout.is_empty() {
            return Err(bad(
                "",
                "holds no sources; add [[elevation]], [[imagery]], [[buildings]] or [[objects]]".into(),
            ));
        }
        if self.imagery.iter().any(|section| section.layer.is_some()) {
            let what =
                "`layer` names a variable of a netCDF file of elevation, or a table of a GeoPackage; take it out here";
            return Err(bad("layer", what.into()));
        }
        for section in &self.elevation {
            if let Some([low, high]) =
                section.clamp_m.filter(|[low, high]| low >= high || low.is_nan() || high.is_nan())
            {
                return Err(bad("clamp_m", format!("clamp_m = [{low}, {high}] is empty; write [low, high]")));
            }
            let sizes = [
                ("feather_m", section.feather_m),
                ("prune_error_m", section.prune_error_m),
                ("finest_error_m", section.finest_error_m),
            ];
            for (key, value) in sizes {
                if value.is_some_and(|v| !(v >= 0.0 && v.is_finite())) {
                    return Err(bad(key, format!("{key} is a length in metres, 0 or more")));
                }
            }
        }
        for section in &self.imagery {
            if let Some(bounds) = section.bounds_deg.filter(|b| !sound_bounds(b)) {
                return Err(bad(
                    "bounds_deg",
                    format!(
                        "bounds_deg = {bounds:?}: write [west, south, east, north] in degrees, west < east, south < north"
                    ),
                ));
            }
            if section.texel_m.is_some_and(|v| !(v > 0.0 && v.is_finite())) {
                return Err(bad("texel_m", "texel_m is a length in metres above 0".into()));
            }
        }
        if self
            .objects
            .iter()
            .filter_map(|section| section.error_m)
            .any(|error_m| !(error_m >= 0.0 && error_m.is_finite()))
        {
            return Err(bad("error_m = ", "error_m is a length in metres, 0 or more".into()));
        }
        if let Some((key, what)) = self.layout.iter().find_map(LayoutSection::fault) {
            return Err(bad(key, what));
        }
        self.check_names(&bad)?;
        self.check_views()
    }

    fn check_names(&self, bad: &dyn Fn(&str, String) -> PrepareError) -> Result<(), PrepareError> {
        for (i, section) in self.buildings.iter().enumerate() {
            if self.buildings[..i].iter().any(|other| other.name == section.name) {
                return Err(bad(
                    &format!("name = \"{}\"", section.name),
                    format!("two collections are named {:?}; names must differ", section.name),
                ));
            }
        }
        for (i, section) in self.layout.iter().enumerate() {
            if self.layout[..i].iter().any(|other| other.name == section.name) {
                return Err(bad("[[layout]]", format!("two layouts are named {:?}; names must differ", section.name)));
            }
        }
        Ok(())
    }
}

fn sound_bounds([west, south, east, north]: &[f64; 4]) -> bool {
    west < east
        && south < north
        && *south >= -90.0
        && *north <= 90.0
        && east - west <= 360.0 + 1e-9
        && west.abs() <= 360.0
}

/// 1-based line of the first place of `needle`.
fn line_of(text: &str, needle: &str) -> usize {
    line_at(text, text.find(needle).unwrap_or(0))
}

/// 1-based line of a byte.
fn line_at(text: &str, offset: usize) -> usize {
    let before = text.as_bytes().get(..offset).unwrap_or(text.as_bytes());
    before.iter().filter(|byte| **byte == b'\n').count() + 1
}

fn recipe_error(text: &str, path: &Path, error: &toml::de::Error) -> PrepareError {
    let line = error.span().map_or(1, |span| line_at(text, span.start));
    let message = error.message().trim().to_owned();
    let what = nearest_key(&message).unwrap_or(message);
    PrepareError::Recipe { file: path.display().to_string(), line, what }
}

/// serde says "unknown field `x`, expected one of `a`, `b`"; people want to hear which key they meant.
fn nearest_key(message: &str) -> Option<String> {
    let rest = message.strip_prefix("unknown field ")?;
    let mut quoted = rest.split('`').skip(1).step_by(2);
    let wrong = quoted.next()?;
    let known: Vec<&str> = quoted.collect();
    let nearest = known.iter().min_by_key(|key| edit_distance(wrong, key));
    let meant = nearest.map(|key| format!("; did you mean `{key}`?")).unwrap_or_default();
    Some(format!("unknown key `{wrong}`{meant} Known here: {}", known.join(", ")))
}

/// Levenshtein distance.
fn edit_distance(a: &str, b: &str) -> usize {
    let mut row: Vec<usize> = (0..=b.chars().count()).collect();
    for (i, x) in a.chars().enumerate() {
        let mut diagonal = row[0];
        row[0] = i + 1;
        for (j, y) in b.chars().enumerate() {
            let replaced = diagonal + usize::from(x != y);
            diagonal = row[j + 1];
            row[j + 1] = replaced.min(diagonal + 1).min(row[j] + 1);
        }
    }
    row[b.chars().count()]
}

#[cfg(test)]
mod tests {
    use super::*;

    fn parse(text: &str) -> Result<Recipe, String> {
        Recipe::parse(text, Path::new("r.toml")).map_err(|e| e.to_string())
    }

    #[test]
    fn reads_a_whole_recipe() {
        let recipe = parse(
            r##"
            name = "dive"
            [[elevation]]
            file = "global.tif"
            vertical = "ellipsoid"
            clamp_m = [0, 9000]
            [[elevation]]
            file = "inset.tif"
            feather_m = 500
            credit = "made up"
            [[imagery]]
            file = "a.png"
            bounds_deg = [-180, -90, 180, 90]
            [[imagery]]
            file = "streets.osm.pbf"
            texel_m = 0.5
            [[buildings]]
            name = "city"
            file = "city.geojson"
            height = "storeys * 3.5"
            default_height = 6
            min_height = 2.5
            attributes = ["name"]
            "##,
        )
        .expect("sound");
        assert_eq!(recipe.elevation[0].vertical, VerticalDatum::Ellipsoid);
        assert_eq!(recipe.elevation[1].vertical, VerticalDatum::Egm96);
        assert_eq!(recipe.elevation[1].feather_m, Some(500.0));
        assert_eq!(recipe.buildings[0].height, Some(Amount::Text("storeys * 3.5".into())));
        assert_eq!(recipe.buildings[0].min_height, Some(Amount::Number(2.5)));
    }

    #[test]
    fn a_typo_names_file_line_key_and_the_key_that_was_meant() {
        let error = parse("name = \"x\"\n[[elevation]]\nfile = \"a\"\nfeatherm = 3\n").expect_err("typo");
        assert!(error.starts_with("r.toml, line 4: unknown key `featherm`; did you mean `feather_m`?"), "{error}");
        let error = parse("name = \"x\"\n[[elevatoin]]\nfile = \"a\"\n").expect_err("typo");
        assert!(error.contains("line 2") && error.contains("did you mean `elevation`?"), "{error}");
    }

    #[test]
    fn bad_recipes_give_one_clear_error() {
        for (text, says) in [
            ("name = 3", "line 1: invalid type"),
            ("name = \"x\"", "holds no sources"),
            ("[[elevation]]\nfile = \"a\"", "missing field `name`"),
            ("name = \"x\"\n[[elevation]]\nfile = \"a\"\nclamp_m = [5, 1]", "line 4: clamp_m"),
            ("name = \"x\"\n[[elevation]]\nfile = \"a\"\nvertical = \"egm97\"", "line 4: unknown variant `egm97`"),
            ("name = \"x\"\n[[imagery]]\nfile = \"a\"\nbounds_deg = [180, -90, -180, 90]", "line 4: bounds_deg"),
            ("name = \"x\"\n[[objects]]\nname=\"t\"\nfile=\"a\"", "missing field `place`"),
            ("name = \"x\"\n[[objects]]\nname=\"t\"\nfile=\"a\"\nplace=\"b\"\nerror_m = -1", "line 6: error_m"),
            (
                "name = \"x\"\n[[objects]]\nname=\"t\"\nfile=\"a\"\nplace=\"b\"\n[[buildings]]\nname = \"t\"\nfile = \"c\"",
                "two collections are named",
            ),
            ("name = \"x\"\n[[layout]]\nname=\"t\"", "line 2: a layout needs a `collection`"),
            (
                "name = \"x\"\n[[layout]]\nname=\"t\"\ncollection=\"a\"\naltitude_bands_m=[50, 2]",
                "line 5: altitude_bands_m = [50.0, 2.0]: write heights",
            ),
            ("name = \"x\"\n[[layout]]\nname=\"t\"\nregion_deg=[3, 1, 2, 4]", "line 4: region_deg"),
            ("name = \"x\"\n[[layout]]\nname=\"t\"\ncollection=\"a\"\nside_m=0", "line 5: side_m = 0"),
            ("name = \"x\"\n[[layout]]\nname=\"t\"\ncollection=\"a\"\nbands = 3", "unknown key `bands`"),
            ("name = \"x\"\n[[elevation]", "line 2"),
            ("name = \"x\"\n[[view]]\nname = \"a\"\nlon_deg = 1\nlat_deg = 2\nheight_m = 3", "holds no sources"),
        ] {
            let error = parse(text).expect_err(text);
            assert!(error.contains(says), "{text:?} gave {error:?}");
        }
    }
}
