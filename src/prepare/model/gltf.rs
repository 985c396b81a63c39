//! glTF 2.0 and GLB: triangles of the default scene with their nodes' transforms, and a colour for each material.

use super::{COLORS_MAX, Colored, Model};
use crate::prepare::PrepareError;
use glam::{DMat4, DVec3};
use gltf::image::{Data, Format};
use gltf::mesh::Mode;
use gltf::scene::Transform;
use std::collections::HashMap;
use std::path::Path;

/// Nodes below one another that are followed.
const DEPTH_MAX: usize = 64;

pub fn read(path: &Path, error_m: f64) -> Result<Model, PrepareError> {
    let (document, buffers, images) = gltf::import(path).map_err(|error| match error {
        gltf::Error::Io(source) => PrepareError::read(path, source),
        other => PrepareError::damaged(path.display(), "the whole", format!("{other}; it must be glTF 2.0 or GLB")),
    })?;
    let mut scene = Scene { buffers: &buffers, images: &images, mesh: Mesh::default() };
    let root = document.default_scene().or_else(|| document.scenes().next());
    for node in root.iter().flat_map(gltf::Scene::nodes) {
        scene.node(&node, DMat4::IDENTITY, 0);
    }
    let mesh = scene.mesh;
    if mesh.groups.is_empty() {
        return Err(PrepareError::value(path.display(), "its scene", "it holds no triangles", "export it with meshes"));
    }
    let groups = mesh.groups.into_iter().map(|(color, triangles)| {
        (color, if error_m > 0.0 { simplified(&mesh.corners, triangles, error_m) } else { triangles })
    });
    let groups: Vec<_> = groups.collect();
    Ok(Model::new(mesh.corners, groups))
}

#[derive(Default)]
struct Mesh {
    corners: Vec<DVec3>,
    by_place: HashMap<[u32; 3], u32>,
    groups: Vec<Colored>,
}

impl Mesh {
    fn corner(&mut self, place: DVec3) -> u32 {
        *self.by_place.entry(place.as_vec3().to_array().map(f32::to_bits)).or_insert_with(|| {
            self.corners.push(place);
            self.corners.len() as u32 - 1
        })
    }

    fn group(&mut self, color: [u8; 3]) -> usize {
        if let Some(at) = self.groups.iter().position(|group| group.0 == color) {
            return at;
        }
        if self.groups.len() < COLORS_MAX {
            self.groups.push((color, Vec::new()));
        }
        self.groups.len() - 1
    }
}

struct Scene<'a> {
    buffers: &'a [gltf::buffer::Data],
    images: &'a [Data],
    mesh: Mesh,
}

impl Scene<'_> {
    fn node(&mut self, node: &gltf::Node, parent: DMat4, depth: usize) {
        let transform = parent * matrix(&node.transform());
        for primitive in node.mesh().iter().flat_map(gltf::Mesh::primitives) {
            if primitive.mode() == Mode::Triangles {
                self.primitive(&primitive, transform);
            }
        }
        if depth < DEPTH_MAX {
            node.children().for_each(|child| self.node(&child, transform, depth + 1));
        }
    }

    fn primitive(&mut self, primitive: &gltf::Primitive, transform: DMat4) {
        let reader = primitive.reader(|buffer| self.buffers.get(buffer.index()).map(|data| &data.0[..]));
        let Some(positions) = reader.read_positions() else { return };
        let corners: Vec<Option<u32>> = positions
            .map(|place| {
                let place = transform.transform_point3(DVec3::from(place.map(f64::from)));
                // y is up and -z north.
                let place = DVec3::new(place.x, -place.z, place.y);
                place.is_finite().then(|| self.mesh.corner(place))
            })
            .collect();
        let indices: Vec<u32> = match reader.read_indices() {
            Some(indices) => indices.into_u32().collect(),
            None => (0..corners.len() as u32).collect(),
        };
        let group = self.mesh.group(self.color(&primitive.material()));
        // A mirror turns faces round.
        let mirrored = transform.determinant() < 0.0;
        for triangle in indices.chunks_exact(3) {
            let [a, b, c] = [0, 1, 2].map(|at| corners.get(triangle[at] as usize).copied().flatten());
            let (Some(a), Some(b), Some(c)) = (a, b, c) else { continue };
            if a != b && b != c && c != a {
                self.mesh.groups[group].1.push(if mirrored { [a, c, b] } else { [a, b, c] });
            }
        }
    }

    /// The factor by the mean of the texture, sRGB.
    fn color(&self, material: &gltf::Material) -> [u8; 3] {
        let base = material.pbr_metallic_roughness();
        let [r, g, b, _] = base.base_color_factor();
        let image = base.base_color_texture().map(|info| info.texture().source().index());
        let mean = image.and_then(|at| self.images.get(at)).and_then(mean_of).unwrap_or([1.0; 3]);
        let factor = [r, g, b].map(|linear| srgb_of(f64::from(linear)));
        std::array::from_fn(|c| (factor[c] * mean[c] * 255.0).round() as u8)
    }
}

fn matrix(transform: &Transform) -> DMat4 {
    DMat4::from_cols_array_2d(&transform.clone().matrix().map(|column| column.map(f64::from)))
}

/// Mean of a picture's visible pixels, of 1; `None` for formats that no colour textures have.
fn mean_of(image: &Data) -> Option<[f64; 3]> {
    let channels = match image.format {
        Format::R8G8B8 => 3,
        Format::R8G8B8A8 => 4,
        _ => return None,
    };
    let (mut sum, mut count) = ([0.0; 3], 0.0);
    for pixel in image.pixels.chunks_exact(channels).filter(|pixel| pixel.get(3).is_none_or(|alpha| *alpha >= 128)) {
        (0..3).for_each(|c| sum[c] += f64::from(pixel[c]) / 255.0);
        count += 1.0;
    }
    (count > 0.0).then(|| sum.map(|sum| sum / count))
}

fn srgb_of(linear: f64) -> f64 {
    let linear = linear.clamp(0.0, 1.0);
    if linear <= 0.003_130_8 { 12.92 * linear } else { 1.055 * linear.powf(1.0 / 2.4) - 0.055 }
}

/// Fewer triangles, off by no more than `error_m`, with the borders of the group where they were, so that groups still
/// meet.
fn simplified(corners: &[DVec3], triangles: Vec<[u32; 3]>, error_m: f64) -> Vec<[u32; 3]> {
    let places: Vec<[f32; 3]> = corners.iter().map(|corner| corner.as_vec3().to_array()).collect();
    let Ok(vertices) = meshopt::VertexDataAdapter::new(bytemuck::cast_slice(&places), size_of::<[f32; 3]>(), 0) else {
        return triangles;
    };
    let options = meshopt::SimplifyOptions::LockBorder | meshopt::SimplifyOptions::ErrorAbsolute;
    let flat = triangles.concat();
    let fewer = meshopt::simplify(&flat, &vertices, 0, error_m as f32, options, None);
    fewer.chunks_exact(3).map(|triangle| [triangle[0], triangle[1], triangle[2]]).collect()
}
