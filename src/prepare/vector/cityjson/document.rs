//! CityJSON 1.0 to 2.0 as it stands in a file; a CityJSONSeq is a document and then one a feature.

use serde::Deserialize;
use serde::de::{Deserializer, MapAccess, SeqAccess, Visitor};
use serde_json::{Map, Value};
use std::collections::BTreeMap;
use std::fmt;

/// A `CityJSON`, or a `CityJSONFeature` of a sequence.
#[derive(Debug, Deserialize)]
pub struct Document {
    #[serde(rename = "type")]
    pub kind: Option<String>,
    pub version: Option<String>,
    #[serde(default)]
    pub metadata: Metadata,
    pub transform: Option<Quantization>,
    #[serde(rename = "CityObjects", default, deserialize_with = "in_order")]
    pub objects: Vec<(String, CityObject)>,
    #[serde(default)]
    pub vertices: Vec<[f64; 3]>,
    #[serde(default)]
    pub appearance: Appearance,
    #[serde(rename = "geometry-templates", default)]
    pub templates: Templates,
}

#[derive(Debug, Default, Deserialize)]
pub struct Metadata {
    #[serde(rename = "referenceSystem")]
    pub reference_system: Option<String>,
}

/// How whole numbers become coordinates.
#[derive(Clone, Copy, Debug, Deserialize)]
pub struct Quantization {
    pub scale: [f64; 3],
    pub translate: [f64; 3],
}

#[derive(Debug, Default, Deserialize)]
pub struct Appearance {
    #[serde(default)]
    pub materials: Vec<Material>,
    #[serde(default)]
    pub textures: Vec<Texture>,
    /// Right and up from the lower left corner of a picture, as parts of its sides.
    #[serde(rename = "vertices-texture", default)]
    pub texture_vertices: Vec<[f64; 2]>,
    #[serde(rename = "default-theme-texture")]
    pub default_texture_theme: Option<String>,
    #[serde(rename = "default-theme-material")]
    pub default_theme: Option<String>,
}

#[derive(Debug, Deserialize)]
pub struct Material {
    #[serde(rename = "diffuseColor")]
    pub diffuse: Option<[f64; 3]>,
}

#[derive(Debug, Deserialize)]
pub struct Texture {
    /// A path from the file's folder.
    pub image: String,
    #[serde(rename = "wrapMode")]
    pub wrap: Option<String>,
}

#[derive(Debug, Default, Deserialize)]
pub struct Templates {
    #[serde(default)]
    pub templates: Vec<Geometry>,
    #[serde(rename = "vertices-templates", default)]
    pub vertices: Vec<[f64; 3]>,
}

#[derive(Debug, Deserialize)]
pub struct CityObject {
    #[serde(rename = "type")]
    pub kind: String,
    pub attributes: Option<Map<String, Value>>,
    #[serde(default)]
    pub children: Vec<String>,
    #[serde(default)]
    pub parents: Vec<String>,
    #[serde(default)]
    pub geometry: Vec<Geometry>,
}

#[derive(Debug, Deserialize)]
pub struct Geometry {
    #[serde(rename = "type")]
    pub kind: String,
    /// A number up to 1.0, a text since.
    pub lod: Option<Value>,
    #[serde(default)]
    pub boundaries: Tree,
    pub semantics: Option<Semantics>,
    #[serde(default)]
    pub material: BTreeMap<String, MaterialValues>,
    #[serde(default)]
    pub texture: BTreeMap<String, TextureValues>,
    pub template: Option<usize>,
    #[serde(rename = "transformationMatrix")]
    pub matrix: Option<Vec<f64>>,
}

impl Geometry {
    pub fn lod(&self) -> Option<f64> {
        match self.lod.as_ref()? {
            Value::String(text) => text.trim().parse().ok(),
            other => other.as_f64(),
        }
    }
}

#[derive(Debug, Deserialize)]
pub struct Semantics {
    #[serde(default)]
    pub surfaces: Vec<SemanticSurface>,
    #[serde(default)]
    pub values: Tree,
}

#[derive(Debug, Deserialize)]
pub struct SemanticSurface {
    #[serde(rename = "type")]
    pub kind: String,
}

#[derive(Debug, Deserialize)]
pub struct MaterialValues {
    /// One for all surfaces.
    pub value: Option<usize>,
    #[serde(default)]
    pub values: Tree,
}

/// For each ring of each surface the texture, then a texture vertex for each of its points.
#[derive(Debug, Deserialize)]
pub struct TextureValues {
    #[serde(default)]
    pub values: Tree,
}

/// Indices nested as deeply as a geometry's kind says.
#[derive(Debug, Default)]
pub enum Tree {
    #[default]
    Nothing,
    Index(usize),
    List(Vec<Tree>),
}

impl Tree {
    pub fn list(&self) -> &[Tree] {
        match self {
            Self::List(list) => list,
            _ => &[],
        }
    }

    pub fn index(&self) -> Option<usize> {
        match self {
            Self::Index(index) => Some(*index),
            _ => None,
        }
    }

    /// What stands at a place of a list; nothing where there is none.
    pub fn at(&self, at: usize) -> &Tree {
        self.list().get(at).unwrap_or(&Self::Nothing)
    }
}

impl<'de> Deserialize<'de> for Tree {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        deserializer.deserialize_any(TreeVisitor)
    }
}

struct TreeVisitor;

impl<'de> Visitor<'de> for TreeVisitor {
    type Value = Tree;

    fn expecting(&self, f: &mut fmt::Formatter) -> fmt::Result {
        f.write_str("an index, null, or a list of such")
    }

    fn visit_unit<E>(self) -> Result<Tree, E> {
        Ok(Tree::Nothing)
    }

    fn visit_u64<E>(self, index: u64) -> Result<Tree, E> {
        Ok(Tree::Index(index as usize))
    }

    fn visit_i64<E: serde::de::Error>(self, index: i64) -> Result<Tree, E> {
        Err(E::custom(format!("the index {index} is below 0")))
    }

    fn visit_seq<S: SeqAccess<'de>>(self, mut seq: S) -> Result<Tree, S::Error> {
        let mut list = Vec::with_capacity(seq.size_hint().unwrap_or(0));
        while let Some(part) = seq.next_element()? {
            list.push(part);
        }
        Ok(Tree::List(list))
    }
}

/// The entries of an object in the file's order.
fn in_order<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Vec<(String, CityObject)>, D::Error> {
    deserializer.deserialize_map(Entries)
}

struct Entries;

impl<'de> Visitor<'de> for Entries {
    type Value = Vec<(String, CityObject)>;

    fn expecting(&self, f: &mut fmt::Formatter) -> fmt::Result {
        f.write_str("city objects by their names")
    }

    fn visit_map<M: MapAccess<'de>>(self, mut map: M) -> Result<Self::Value, M::Error> {
        let mut entries = Vec::new();
        while let Some(entry) = map.next_entry()? {
            entries.push(entry);
        }
        Ok(entries)
    }
}
