//! The objects pass and its arena of pages.

use super::atlases::{Atlases, Textures};
use super::device::{FrameStorage, Gpu};
use super::eye::eye_relative;
use super::ids::id_of_object;
use super::layout::OBJECTS_WGSL;
use super::meshes::packed_indices;
use super::pass::{Entries, PassShape, Pipelines, storage_layout};
use super::renderer::ArenaFull;
use super::runs::RunCalls;
use crate::camera::View;
use crate::content::{Object, ObjectMesh, ObjectPage, ObjectVertex, Page, PageId};
use crate::geodesy::{Ecef, Point};
use crate::select::DrawObjects;
use bytemuck::{Pod, Zeroable};
use std::collections::HashMap;
use std::ops::Range;

/// Mirrors `ObjectRecord` in objects.wgsl.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
pub(super) struct ObjectRecord {
    pub place_m: [f32; 3],
    pub id: u32,
    pub wall_color: u32,
    pub roof_color: u32,
    pub lift: u32,
    pub has_foundation: u32,
}

/// Mirrors `ObjectsPlace` in objects.wgsl.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
pub(super) struct ObjectsPlace {
    pub offset: [f32; 3],
    pub fade: f32,
}

/// Mirrors `ObjectVertex` in objects.wgsl: look and facing are one word there.
pub(super) const ATTRIBUTES: [wgpu::VertexAttribute; 2] = wgpu::vertex_attr_array![0 => Float32x3, 1 => Uint32];
pub(super) const VERTICES: wgpu::VertexBufferLayout<'static> = wgpu::VertexBufferLayout {
    array_stride: size_of::<ObjectVertex>() as u64,
    step_mode: wgpu::VertexStepMode::Vertex,
    attributes: &ATTRIBUTES,
};

/// A page on the GPU.
#[derive(Debug)]
struct ResidentPage {
    vertices: wgpu::Buffer,
    indices: wgpu::Buffer,
    format: wgpu::IndexFormat,
    lifts: wgpu::Buffer,
    textures: Option<Textures>,
    group: wgpu::BindGroup,
    origin: Point<Ecef>,
    objects: usize,
    bytes: u64,
}

/// What is to be drawn of a page in this frame.
#[derive(Debug)]
pub(super) struct ObjectsItem {
    page: PageId,
    /// Of its indices.
    runs: Vec<Range<u32>>,
    place: ObjectsPlace,
    is_fading: bool,
}

/// Objects that come in the place of others, or go.
#[derive(Clone, Debug)]
pub struct Fading {
    pub draw: DrawObjects,
    /// How far the fade has come, 0 to 1; what comes and what goes for it have the same.
    pub share: f32,
    pub comes: bool,
}

impl Fading {
    /// As the shader has it: never 0 for what goes.
    fn signed(&self) -> f32 {
        if self.comes { self.share } else { -self.share.max(f32::MIN_POSITIVE) }
    }
}

/// Counts of what was prepared for drawing.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct ObjectsCount {
    pub triangles: u64,
    pub missing: u32,
}

#[derive(Debug)]
pub(super) struct ObjectsPass {
    pipelines: Pipelines,
    atlases: Atlases,
    places: FrameStorage,
    calls: RunCalls,
    page_layout: wgpu::BindGroupLayout,
    limit_bytes: u64,
    bytes: u64,
    pages: HashMap<PageId, ResidentPage>,
}

impl ObjectsPass {
    pub fn new(gpu: &Gpu, frame: &wgpu::BindGroupLayout, limit_bytes: u64) -> Self {
        let (place_layout, page_layout) = (storage_layout(gpu, "places", 1), storage_layout(gpu, "page", 2));
        let shape = PassShape {
            label: "objects",
            source: OBJECTS_WGSL,
            vertices: vec![Some(VERTICES)],
            entries: Entries::default(),
            backdrop: false,
        };
        Self {
            pipelines: Pipelines::new(gpu, shape, &[frame, &place_layout, &page_layout]),
            atlases: Atlases::new(gpu, [frame, &place_layout, &page_layout]),
            places: FrameStorage::new(gpu, "places", &place_layout),
            calls: RunCalls::new(gpu),
            page_layout,
            limit_bytes,
            bytes: 0,
            pages: HashMap::new(),
        }
    }

    pub fn bytes(&self) -> u64 {
        self.bytes
    }

    /// For uploads from now on; what is there stays.
    pub fn set_limit(&mut self, limit_bytes: u64) {
        self.limit_bytes = limit_bytes;
    }

    pub fn upload(&mut self, gpu: &Gpu, page: &ObjectPage, mesh: &ObjectMesh) -> Result<u64, ArenaFull> {
        let id = page_id(page);
        if let Some(resident) = self.pages.get(&id) {
            return Ok(resident.bytes);
        }
        if mesh.indices.is_empty() || page.objects.is_empty() {
            return Ok(0);
        }
        let bytes = page_bytes(page, mesh);
        if self.bytes + bytes > self.limit_bytes {
            return Err(ArenaFull { needed_bytes: bytes, limit_bytes: self.limit_bytes });
        }
        self.pages.insert(id, self.resident(gpu, page, mesh, bytes));
        self.bytes += bytes;
        Ok(bytes)
    }

    fn resident(&self, gpu: &Gpu, page: &ObjectPage, mesh: &ObjectMesh, bytes: u64) -> ResidentPage {
        let (indices, format) = packed_indices(&mesh.indices, mesh.vertices.len());
        let storage = wgpu::BufferUsages::STORAGE;
        let records = gpu.filled_buffer("object records", storage, bytemuck::cast_slice(&records(page)));
        let lifts = gpu.buffer("object lifts", storage, 4 * page.objects.len() as u64);
        let group = gpu.device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: Some("object page"),
            layout: &self.page_layout,
            entries: &[
                wgpu::BindGroupEntry { binding: 0, resource: records.as_entire_binding() },
                wgpu::BindGroupEntry { binding: 1, resource: lifts.as_entire_binding() },
            ],
        });
        let vertices = bytemuck::cast_slice(&mesh.vertices);
        let textures = mesh.textures().filter(|(atlas, _)| gpu.can_read(atlas.format()));
        ResidentPage {
            vertices: gpu.filled_buffer("object vertices", wgpu::BufferUsages::VERTEX, vertices),
            indices: gpu.filled_buffer("object indices", wgpu::BufferUsages::INDEX, &indices),
            format,
            lifts,
            textures: textures.map(|(atlas, uvs)| self.atlases.upload(gpu, atlas, uvs)),
            group,
            origin: page.origin,
            objects: page.objects.len(),
            bytes,
        }
    }

    pub fn remove(&mut self, page: PageId) {
        if let Some(resident) = self.pages.remove(&page) {
            self.bytes -= resident.bytes;
        }
    }

    /// How far the drawn ground lies above the base of each object of a page, metres, from the first; the objects
    /// beyond the slice keep theirs.
    pub fn set_lifts(&mut self, gpu: &Gpu, page: PageId, lifts_m: &[f32]) {
        let Some(resident) = self.pages.get(&page) else { return };
        let lifts_m = &lifts_m[..lifts_m.len().min(resident.objects)];
        if !lifts_m.is_empty() {
            gpu.queue.write_buffer(&resident.lifts, 0, bytemuck::cast_slice(lifts_m));
        }
    }

    /// Puts the pages in order from near to far and writes what the shader needs of them.
    pub fn prepare(
        &mut self,
        gpu: &Gpu,
        view: &View,
        steady: &[DrawObjects],
        fading: &[Fading],
    ) -> (Vec<ObjectsItem>, ObjectsCount) {
        let mut count = ObjectsCount::default();
        let mut items = Vec::with_capacity(steady.len() + fading.len());
        let fading = fading.iter().map(|fading| (&fading.draw, fading.signed(), true));
        for (objects, fade, is_fading) in steady.iter().map(|draw| (draw, 0.0, false)).chain(fading) {
            let runs = index_runs(objects);
            if runs.is_empty() {
                continue;
            }
            let page = page_id(&objects.page);
            let Some(resident) = self.pages.get(&page) else {
                count.missing += 1;
                continue;
            };
            count.triangles += runs.iter().map(|run| u64::from(run.end - run.start) / 3).sum::<u64>();
            let offset = eye_relative(resident.origin, view);
            let place = ObjectsPlace { offset: offset.to_array(), fade };
            items.push((offset.length_squared(), ObjectsItem { page, runs, place, is_fading }));
        }
        // What fades has a pipeline of its own, behind that of all else.
        items.sort_by(|(a, of_a), (b, of_b)| of_a.is_fading.cmp(&of_b.is_fading).then(a.total_cmp(b)));
        let items: Vec<_> = items.into_iter().map(|(_, item)| item).collect();
        let places: Vec<_> = items.iter().map(|item| item.place).collect();
        self.places.write(gpu, bytemuck::cast_slice(&places));
        self.calls.write(gpu, items.iter().map(|item| item.runs.as_slice()));
        (items, count)
    }

    /// Draws what was prepared; gives the number of draw calls.
    pub fn draw(&self, gpu: &Gpu, pass: &mut wgpu::RenderPass, aov: bool, items: &[ObjectsItem]) -> u32 {
        pass.set_pipeline(self.pipelines.get(gpu, aov));
        pass.set_bind_group(1, self.places.group(), &[]);
        let (mut calls, mut set) = (0, (false, false));
        let mut runs = 0;
        for (instance, item) in (0..).zip(items) {
            let before = runs;
            runs += item.runs.len();
            let Some(resident) = self.pages.get(&item.page) else { continue };
            let wanted = (resident.textures.is_some(), item.is_fading && !aov);
            if wanted != set {
                let pipelines = if wanted.0 { self.atlases.pipelines(gpu) } else { &self.pipelines };
                pass.set_pipeline(if wanted.1 { pipelines.fading(gpu) } else { pipelines.get(gpu, aov) });
                set = wanted;
            }
            if let Some(textures) = &resident.textures {
                pass.set_bind_group(3, &textures.group, &[]);
                pass.set_vertex_buffer(1, textures.uvs.slice(..));
            }
            pass.set_bind_group(2, &resident.group, &[]);
            pass.set_vertex_buffer(0, resident.vertices.slice(..));
            pass.set_index_buffer(resident.indices.slice(..), resident.format);
            calls += self.calls.draw(pass, &item.runs, instance, before);
        }
        calls
    }
}

fn page_id(page: &ObjectPage) -> PageId {
    PageId { cell: page.root, kind: crate::content::PageKind::Objects { collection: page.collection, rep: page.rep } }
}

/// Bytes that a page takes on the GPU.
pub(super) fn page_bytes(page: &ObjectPage, mesh: &ObjectMesh) -> u64 {
    let index_size = if mesh.vertices.len() > usize::from(u16::MAX) { 4 } else { 2 };
    let indices = (mesh.indices.len() * index_size).next_multiple_of(4);
    let records = (page.objects.len() + page.looks.len()) * size_of::<ObjectRecord>();
    let textures = mesh.textures().map_or(0, |(atlas, uvs)| atlas.byte_len() + size_of_val(uvs));
    (size_of_val(&*mesh.vertices) + indices + records + page.objects.len() * size_of::<f32>() + textures) as u64
}

/// One for each object, then one for each further look.
fn records(page: &ObjectPage) -> Vec<ObjectRecord> {
    let own =
        page.objects.iter().zip(0..).map(|(object, at)| record(page, object, at, object.wall_color, object.roof_color));
    let more = page.looks.iter().filter_map(|look| {
        let object = page.objects.get(usize::from(look.object))?;
        Some(record(page, object, u32::from(look.object), look.wall_color, look.roof_color))
    });
    own.chain(more).collect()
}

fn record(page: &ObjectPage, object: &Object, at: u32, wall_color: [u8; 3], roof_color: [u8; 3]) -> ObjectRecord {
    let packed = |[r, g, b]: [u8; 3]| u32::from_le_bytes([r, g, b, 255]);
    ObjectRecord {
        place_m: (object.place - page.origin).xyz().as_vec3().to_array(),
        id: id_of_object(page.collection, object.id),
        wall_color: packed(wall_color),
        roof_color: packed(roof_color),
        lift: at,
        has_foundation: u32::from(page.foundation_m(at as usize) > 0.0),
    }
}

/// The indices to draw, with runs that touch made one.
fn index_runs(draw: &DrawObjects) -> Vec<Range<u32>> {
    let mut runs: Vec<Range<u32>> = Vec::new();
    for objects in &draw.objects {
        let next = draw.page.indices_of(objects.clone());
        match runs.last_mut() {
            _ if next.is_empty() => {}
            Some(last) if last.end == next.start => last.end = next.end,
            _ => runs.push(next),
        }
    }
    runs
}

/// Bytes that a page takes on the GPU, whatever its kind; terrain takes none until it is drawn.
pub(super) fn gpu_bytes(page: &Page) -> u64 {
    match page {
        Page::Terrain(_) | Page::Segment(_) => 0,
        Page::Imagery(_) => super::imagery::layer_bytes(),
        Page::Objects(page, mesh) => page_bytes(page, mesh),
    }
}
