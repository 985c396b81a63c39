//! The shaders' sources, and what the Rust side holds of their structs, for a test to compare.

use super::frame::Frame;
use super::objects::{ObjectRecord, ObjectsPlace};
use super::terrain::Piece;
use crate::content::{ObjectVertex, TerrainVertex};
use std::mem::offset_of;

macro_rules! pass_source {
    ($file:literal) => {
        concat!(
            include_str!("../../shaders/frame.wgsl"),
            include_str!("../../shaders/atmosphere.wgsl"),
            include_str!(concat!("../../shaders/", $file))
        )
    };
}

pub(super) const TERRAIN_WGSL: &str = pass_source!("terrain.wgsl");
pub(super) const OBJECTS_WGSL: &str = pass_source!("objects.wgsl");
pub(super) const SKY_WGSL: &str = pass_source!("sky.wgsl");
/// Knows nothing of the frame: it copies a picture.
pub(super) const PRESENT_WGSL: &str = include_str!("../../shaders/present.wgsl");
/// Knows nothing of the frame either: it draws panels.
pub(super) const OVERLAY_WGSL: &str = include_str!("../../shaders/overlay.wgsl");

/// Name and whole source of each pass.
pub fn shader_sources() -> [(&'static str, &'static str); 5] {
    [
        ("terrain", TERRAIN_WGSL),
        ("objects", OBJECTS_WGSL),
        ("sky", SKY_WGSL),
        ("present", PRESENT_WGSL),
        ("overlay", OVERLAY_WGSL),
    ]
}

/// A field of a struct in Rust: its name in WGSL, offset and size in bytes.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Field {
    pub name: &'static str,
    pub offset: usize,
    pub size: usize,
}

/// A struct that Rust writes and a shader reads.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Mirror {
    pub name: &'static str,
    /// Which of [`shader_sources`] declares it.
    pub pass: &'static str,
    pub size: usize,
    pub fields: Vec<Field>,
    /// Whether it is a vertex: its fields are then compared by the attributes' formats.
    pub is_vertex: bool,
}

fn size_of_field<S, F>(_: fn(&S) -> &F) -> usize {
    size_of::<F>()
}

macro_rules! mirror {
    ($pass:literal, $rust:ident { $($field:ident),+ $(,)? }) => {
        Mirror {
            name: stringify!($rust),
            pass: $pass,
            size: size_of::<$rust>(),
            is_vertex: false,
            fields: vec![$(Field {
                name: stringify!($field),
                offset: offset_of!($rust, $field),
                size: size_of_field(|s: &$rust| &s.$field),
            }),+],
        }
    };
}

/// All structs that stand both here and in the shaders.
pub fn mirrored_structs() -> Vec<Mirror> {
    vec![
        mirror!("sky", Frame { clip_from_eye, eye, zenith, sun, right, up, forward, press, haze }),
        mirror!("terrain", Piece { offset, own, uv_scale, uv_offset, skirt_m, layer, id, textured }),
        mirror!("objects", ObjectRecord { place_m, id, wall_color, roof_color, lift, has_foundation }),
        mirror!("objects", ObjectsPlace { offset, fade }),
        vertex_mirror(
            "terrain",
            "TerrainVertex",
            size_of::<TerrainVertex>(),
            &super::terrain::ATTRIBUTES,
            &["position_m", "morph_m", "uv", "slope_skirt"],
        ),
        vertex_mirror(
            "objects",
            "ObjectVertex",
            size_of::<ObjectVertex>(),
            &super::objects::ATTRIBUTES,
            &["position_m", "packed"],
        ),
    ]
}

fn vertex_mirror(
    pass: &'static str,
    name: &'static str,
    size: usize,
    attributes: &[wgpu::VertexAttribute],
    names: &[&'static str],
) -> Mirror {
    let fields = names
        .iter()
        .zip(attributes)
        .map(|(name, attribute)| Field {
            name,
            offset: attribute.offset as usize,
            size: attribute.format.size() as usize,
        })
        .collect();
    Mirror { name, pass, size, fields, is_vertex: true }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn vertex_attributes_lie_where_the_fields_do() {
        let terrain: Vec<_> = super::super::terrain::ATTRIBUTES.iter().map(|a| a.offset as usize).collect();
        assert_eq!(
            terrain,
            [
                offset_of!(TerrainVertex, position_m),
                offset_of!(TerrainVertex, morph_m),
                offset_of!(TerrainVertex, uv),
                offset_of!(TerrainVertex, slope_skirt)
            ]
        );
        let objects: Vec<_> = super::super::objects::ATTRIBUTES.iter().map(|a| a.offset as usize).collect();
        assert_eq!(objects, [offset_of!(ObjectVertex, position_m), offset_of!(ObjectVertex, look)]);
        assert_eq!(offset_of!(ObjectVertex, facing), offset_of!(ObjectVertex, look) + 2);
    }
}
