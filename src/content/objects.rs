//! Objects of one collection in a subtree of small cells: prisms over footprints, with walls and
//! flat roofs, or with details in place of those.

use super::atlas::{Atlas, AtlasFormat, NO_TEXTURE};
use super::detail::Looks;
use super::footprints::Footprints;
use super::prism::Prism;
use super::{PageId, PageKind};
use crate::forest::CellId;
use crate::geodesy::{Ecef, Point};
use bytemuck::{Pod, Zeroable};
use glam::DVec3;
use std::ops::Range;

/// What is known of a drawn object.
#[derive(Clone, Debug, PartialEq)]
pub struct Object {
    pub id: u32,
    pub cell: CellId,
    /// Middle of the footprint's box at the base.
    pub place: Point<Ecef>,
    pub lat_rad: f64,
    pub lon_rad: f64,
    pub base_m: f32,
    pub top_m: f32,
    /// Largest side of the bounding box, height included, metres.
    pub dimension_m: f32,
    /// Largest horizontal side of the box in the local east-north-up frame, metres.
    pub reach_m: f32,
    pub wall_color: [u8; 3],
    pub roof_color: [u8; 3],
    /// Its indices in the page's mesh.
    pub indices: Range<u32>,
}

/// A vertex as the GPU takes it: 16 bytes.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
pub struct ObjectVertex {
    /// From the mesh's origin, ECEF axes, metres.
    pub position_m: [f32; 3],
    /// Number of its look: the object's index in the page, or beyond the objects one of [`ObjectPage::looks`].
    pub look: u16,
    /// Outward normal in the east-north-up frame of the object's place, octahedral (Meyer et al. 2010): x in 127ths in
    /// the lowest 8 bits, y in 63rds in the next 7, both in two's complement; the highest bit is 0 for walls.
    pub facing: u16,
}

impl ObjectVertex {
    /// A face's normal, of any length above 0, and whether it takes the second colour of its look.
    pub fn facing(enu: DVec3, is_no_wall: bool) -> u16 {
        let n = enu / (enu.x.abs() + enu.y.abs() + enu.z.abs());
        let fold = |a: f64, b: f64| if n.z < 0.0 { (1.0 - b.abs()).copysign(a) } else { a };
        let x = (fold(n.x, n.y) * 127.0).round() as i16 & 0xff;
        let y = (fold(n.y, n.x) * 63.0).round() as i16 & 0x7f;
        x as u16 | (y as u16) << 8 | u16::from(is_no_wall) << 15
    }

    /// The unit normal in the east-north-up frame of the object's place, good to a degree and a half.
    pub fn normal(&self) -> DVec3 {
        let x = f64::from(self.facing as u8 as i8) / 127.0;
        let y = f64::from(((self.facing >> 7) as u8 & 0xfe) as i8 >> 1) / 63.0;
        let z = 1.0 - x.abs() - y.abs();
        let fold = (-z).max(0.0);
        DVec3::new(x - fold.copysign(x), y - fold.copysign(y), z).normalize()
    }

    pub fn is_wall(&self) -> bool {
        self.facing >> 15 == 0
    }
}

/// Colours that faces of an object have instead of its own.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Look {
    /// Index of the object in the page.
    pub object: u16,
    pub wall_color: [u8; 3],
    pub roof_color: [u8; 3],
}

#[derive(Clone, Debug, Default)]
pub struct ObjectMesh {
    pub vertices: Vec<ObjectVertex>,
    pub indices: Vec<u32>,
    /// Of each vertex in the atlas, in 65535ths of its sides, [`NO_TEXTURE`] where it has none; empty where none has.
    pub uvs: Vec<[u16; 2]>,
    pub atlas: Option<Atlas>,
}

impl ObjectMesh {
    pub fn byte_len(&self) -> usize {
        let atlas = self.atlas.as_ref().map_or(0, Atlas::byte_len);
        size_of_val(&*self.vertices) + size_of_val(&*self.indices) + size_of_val(&*self.uvs) + atlas
    }

    /// The atlas and where each vertex lies in it; `None` for a mesh that is drawn in plain colours.
    pub fn textures(&self) -> Option<(&Atlas, &[[u16; 2]])> {
        let atlas = self.atlas.as_ref()?;
        (!self.uvs.is_empty() && self.uvs.len() == self.vertices.len()).then_some((atlas, &*self.uvs))
    }

    /// Lays the atlas out for the GPU.
    pub fn compress_atlas(&mut self, format: AtlasFormat) {
        self.atlas = self.atlas.take().map(|atlas| atlas.compressed(format));
    }

    /// Gives the last vertex its place in the atlas.
    pub(super) fn texture_last(&mut self, uv: [f32; 2]) {
        self.uvs.resize(self.vertices.len(), NO_TEXTURE);
        let units = |part: f32| (part.clamp(0.0, 1.0) * f32::from(u16::MAX)).round() as u16;
        if let Some(last) = self.uvs.last_mut() {
            *last = uv.map(|part| units(part).min(u16::MAX - 1));
        }
    }
}

/// A decoded page of objects, less its mesh.
#[derive(Clone, Debug)]
pub struct ObjectPage {
    /// The cell whose subtree it holds.
    pub root: CellId,
    pub collection: u8,
    /// 0 is the finest.
    pub rep: u8,
    /// Bounds the distance between what is drawn and the source's shape, metres.
    pub error_m: f32,
    pub origin: Point<Ecef>,
    /// Ordered by cell, so that each cell's objects and triangles are contiguous.
    pub objects: Vec<Object>,
    /// The directory: for each cell with objects, their range and their lowest and highest point (metres).
    pub cells: Vec<CellObjects>,
    /// What collisions and picking ask.
    pub footprints: Footprints,
    /// Looks beyond the objects' own, which have the first numbers.
    pub looks: Vec<Look>,
}

/// The objects of one cell in a page.
#[derive(Clone, Debug, PartialEq)]
pub struct CellObjects {
    pub cell: CellId,
    pub objects: Range<u32>,
    pub height_range_m: (f32, f32),
    /// Largest bounding dimension, metres.
    pub dimension_m: f32,
}

impl ObjectPage {
    /// Objects in a page; more have no number for the GPU.
    pub const OBJECTS_MAX: usize = 1 << 16;

    /// Draws prisms up into a page and its mesh; prisms are put in order of their cells (those of one cell stay in the
    /// order given). Those beyond [`ObjectPage::OBJECTS_MAX`] are left out, and so are roof triangles without vertices.
    pub fn from_prisms(
        root: CellId,
        collection: u8,
        rep: u8,
        error_m: f32,
        mut prisms: Vec<Prism>,
    ) -> (Self, ObjectMesh) {
        prisms.sort_by_key(|prism| prism.cell);
        prisms.truncate(Self::OBJECTS_MAX);
        let base_m = prisms.iter().map(|prism| f64::from(prism.base_m)).sum::<f64>() / prisms.len().max(1) as f64;
        let origin = root.bounds().center().at_height(base_m).to_ecef();
        let mut mesh = ObjectMesh::default();
        let mut looks = Looks::new(prisms.len());
        let draw = |(at, prism): (usize, &Prism)| prism.draw(origin, at as u16, &mut mesh, &mut looks);
        let objects: Vec<Object> = prisms.iter().enumerate().map(draw).collect();
        if !mesh.uvs.is_empty() {
            mesh.uvs.resize(mesh.vertices.len(), NO_TEXTURE);
        }
        let cells = directory(&objects, &prisms);
        let footprints = Footprints::new(&prisms, &objects, cells.iter().map(|cell| &cell.objects), origin);
        (Self { root, collection, rep, error_m, origin, objects, cells, footprints, looks: looks.finish() }, mesh)
    }

    pub fn id(&self) -> PageId {
        PageId { cell: self.root, kind: PageKind::Objects { collection: self.collection, rep: self.rep } }
    }

    pub fn byte_len(&self) -> usize {
        size_of::<Self>()
            + size_of_val(&*self.objects)
            + size_of_val(&*self.cells)
            + size_of_val(&*self.looks)
            + self.footprints.byte_len()
    }

    /// The indices that draw a range of objects; none where the range leaves the page.
    pub fn indices_of(&self, objects: Range<u32>) -> Range<u32> {
        let run = self.objects.get(objects.start as usize..objects.end as usize).unwrap_or_default();
        match (run.first(), run.last()) {
            (Some(first), Some(last)) => first.indices.start..last.indices.end,
            _ => 0..0,
        }
    }
}

/// Runs of objects of one cell.
fn directory(objects: &[Object], prisms: &[Prism]) -> Vec<CellObjects> {
    let mut start = 0;
    objects
        .chunk_by(|a, b| a.cell == b.cell)
        .map(|run| {
            let range = start..start + run.len();
            start = range.end;
            let low_m = |prism: &Prism| prism.base_m - prism.foundation_m;
            CellObjects {
                cell: run[0].cell,
                height_range_m: prisms[range.clone()]
                    .iter()
                    .fold((f32::INFINITY, f32::NEG_INFINITY), |(low, high), prism| {
                        (low.min(low_m(prism)), high.max(prism.top_m))
                    }),
                objects: range.start as u32..range.end as u32,
                dimension_m: run.iter().map(|object| object.dimension_m).fold(0.0, f32::max),
            }
        })
        .collect()
}
