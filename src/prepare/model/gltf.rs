//! glTF 2.0 and GLB: triangles of the default scene with their nodes' transforms, and for each material a colour, and
//! the picture of its base colour where it is opaque.

use super::{COLORS_MAX, Colored, Model};
use crate::prepare::PrepareError;
use crate::prepare::textures::{Picture, REPEATS_MAX, Wrap};
use glam::{DMat4, DVec3};
use gltf::image::{Data, Format};
use gltf::material::AlphaMode;
use gltf::mesh::Mode;
use gltf::scene::Transform;
use gltf::texture::WrappingMode;
use image::RgbImage;
use std::collections::HashMap;
use std::path::Path;
use std::sync::Arc;

/// Nodes below one another that are followed.
const DEPTH_MAX: usize = 64;
/// Texture coordinates are no larger than this.
const UV_MAX: f32 = 1e4;

pub fn read(path: &Path, error_m: f64) -> Result<Model, PrepareError> {
    let (document, buffers, images) = gltf::import(path).map_err(|error| match error {
        gltf::Error::Io(source) => PrepareError::read(path, source),
        other => PrepareError::damaged(path.display(), "the whole", format!("{other}; it must be glTF 2.0 or GLB")),
    })?;
    let mut scene = Scene { buffers: &buffers, images: &images, mesh: Mesh::default(), pictures: Pictures::default() };
    let root = document.default_scene().or_else(|| document.scenes().next());
    for node in root.iter().flat_map(gltf::Scene::nodes) {
        scene.node(&node, DMat4::IDENTITY, 0);
    }
    let (mesh, pictures) = (scene.mesh, scene.pictures.all);
    if mesh.groups.is_empty() {
        return Err(PrepareError::value(path.display(), "its scene", "it holds no triangles", "export it with meshes"));
    }
    let groups = mesh.groups.into_iter().map(|group| match error_m > 0.0 {
        true => Colored { triangles: simplified(&mesh.corners, group.triangles, error_m), ..group },
        false => group,
    });
    let groups: Vec<_> = groups.collect();
    Ok(Model::new(mesh.corners, groups, pictures))
}

#[derive(Default)]
struct Mesh {
    /// With their places in the picture of their faces.
    corners: Vec<(DVec3, [f32; 2])>,
    by_place: HashMap<Place, u32>,
    groups: Vec<Colored>,
}

/// Where a corner lies, and where in which picture; bit by bit.
type Place = ([u32; 3], Option<(u32, [u32; 2])>);

impl Mesh {
    fn corner(&mut self, place: DVec3, texture: Option<(u32, [f32; 2])>) -> u32 {
        let in_picture = texture.map(|(picture, uv)| (picture, uv.map(f32::to_bits)));
        *self.by_place.entry((place.as_vec3().to_array().map(f32::to_bits), in_picture)).or_insert_with(|| {
            self.corners.push((place, texture.map_or([0.0; 2], |(_, uv)| uv)));
            self.corners.len() as u32 - 1
        })
    }

    fn group(&mut self, color: [u8; 3], texture: Option<u32>) -> usize {
        if let Some(at) = self.groups.iter().position(|group| group.color == color && group.texture == texture) {
            return at;
        }
        if self.groups.len() < COLORS_MAX {
            // The last one takes all that follow.
            let texture = texture.filter(|_| self.groups.len() + 1 < COLORS_MAX);
            self.groups.push(Colored { color, texture, triangles: Vec::new() });
        }
        self.groups.len() - 1
    }
}

struct Scene<'a> {
    buffers: &'a [gltf::buffer::Data],
    images: &'a [Data],
    mesh: Mesh,
    pictures: Pictures,
}

/// The pictures of materials, each once for an image, its wrap and the factor on it.
#[derive(Default)]
struct Pictures {
    all: Vec<Arc<Picture>>,
    known: HashMap<(usize, Wrap, [u8; 3]), u32>,
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
        let places: Vec<Option<DVec3>> = positions
            .map(|place| {
                let place = transform.transform_point3(DVec3::from(place.map(f64::from)));
                // y is up and -z north.
                let place = DVec3::new(place.x, -place.z, place.y);
                place.is_finite().then_some(place)
            })
            .collect();
        let indices: Vec<u32> = match reader.read_indices() {
            Some(indices) => indices.into_u32().collect(),
            None => (0..places.len() as u32).collect(),
        };
        let (color, picture) = (self.color(&primitive.material()), self.picture(&primitive.material()));
        let uvs: Vec<[f32; 2]> =
            picture.and_then(|(_, set)| reader.read_tex_coords(set)).map_or(Vec::new(), |uvs| uvs.into_f32().collect());
        // A mirror turns faces round.
        let mirrored = transform.determinant() < 0.0;
        for triangle in indices.chunks_exact(3) {
            let [a, b, c] = [0, 1, 2].map(|at| places.get(triangle[at] as usize).copied().flatten());
            let (Some(a), Some(b), Some(c)) = (a, b, c) else { continue };
            let texture = picture.and_then(|(picture, _)| self.place(picture, triangle, &uvs));
            let group = self.mesh.group(color, texture.map(|(picture, _)| picture));
            // Where groups are used up the last one takes all; it may have another picture.
            let texture = texture.filter(|(picture, _)| self.mesh.groups[group].texture == Some(*picture));
            let at = |mesh: &mut Mesh, place, corner: usize| {
                mesh.corner(place, texture.map(|(picture, uvs)| (picture, uvs[corner])))
            };
            let [a, b, c] = [at(&mut self.mesh, a, 0), at(&mut self.mesh, b, 1), at(&mut self.mesh, c, 2)];
            if a != b && b != c && c != a {
                self.mesh.groups[group].triangles.push(if mirrored { [a, c, b] } else { [a, b, c] });
            }
        }
    }

    /// Where a triangle lies in its picture, brought into the first of those that repeat; `None` where nothing says or
    /// it repeats the picture too often.
    fn place(&self, picture: u32, triangle: &[u32], uvs: &[[f32; 2]]) -> Option<(u32, [[f32; 2]; 3])> {
        let [a, b, c] = [0, 1, 2].map(|at| uvs.get(triangle[at] as usize).copied());
        let mut own = [a?, b?, c?];
        let wrap = self.pictures.all.get(picture as usize)?.wrap;
        for axis in 0..2 {
            let low = own.iter().map(|uv| uv[axis]).fold(f32::INFINITY, f32::min);
            let high = own.iter().map(|uv| uv[axis]).fold(f32::NEG_INFINITY, f32::max);
            if !(high - low <= REPEATS_MAX && low.abs() < UV_MAX) {
                return None;
            }
            let shift = wrap.period().map_or(0.0, |period| (low / period).floor() * period);
            own.iter_mut().for_each(|uv| uv[axis] -= shift);
        }
        Some((picture, own))
    }

    /// The base colour's picture by its factor, and its set of texture coordinates. What is cut out of a picture by its
    /// alpha is drawn in its mean colour, without the picture.
    fn picture(&mut self, material: &gltf::Material) -> Option<(u32, u32)> {
        let base = material.pbr_metallic_roughness();
        let info = base.base_color_texture().filter(|_| material.alpha_mode() == AlphaMode::Opaque)?;
        let (texture, [r, g, b, _]) = (info.texture(), base.base_color_factor());
        let factor = [r, g, b].map(|linear| (srgb_of(f64::from(linear)) * 255.0).round() as u8);
        let wrap = match texture.sampler().wrap_s() {
            WrappingMode::Repeat => Wrap::Repeat,
            WrappingMode::MirroredRepeat => Wrap::Mirror,
            WrappingMode::ClampToEdge => Wrap::Clamp,
        };
        let key = (texture.source().index(), wrap, factor);
        if let Some(&known) = self.pictures.known.get(&key) {
            return Some((known, info.tex_coord()));
        }
        let texels = texels_of(self.images.get(key.0)?, factor)?;
        let number = self.pictures.all.len() as u32;
        self.pictures.all.push(Arc::new(Picture::of_texels(texels, wrap)));
        self.pictures.known.insert(key, number);
        Some((number, info.tex_coord()))
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

/// A picture by a factor (of 255); `None` for formats that no colour textures have.
fn texels_of(image: &Data, factor: [u8; 3]) -> Option<RgbImage> {
    let channels = channels_of(image)?;
    let texel = |texel: &[u8]| [0, 1, 2].map(|c| (u16::from(texel[c]) * u16::from(factor[c]) / 255) as u8);
    RgbImage::from_raw(image.width, image.height, image.pixels.chunks_exact(channels).flat_map(texel).collect())
}

fn channels_of(image: &Data) -> Option<usize> {
    match image.format {
        Format::R8G8B8 => Some(3),
        Format::R8G8B8A8 => Some(4),
        _ => None,
    }
}

/// Mean of a picture's visible pixels, of 1; `None` for formats that no colour textures have.
fn mean_of(image: &Data) -> Option<[f64; 3]> {
    let channels = channels_of(image)?;
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
fn simplified(corners: &[(DVec3, [f32; 2])], triangles: Vec<[u32; 3]>, error_m: f64) -> Vec<[u32; 3]> {
    let places: Vec<[f32; 3]> = corners.iter().map(|(corner, _)| corner.as_vec3().to_array()).collect();
    let Ok(vertices) = meshopt::VertexDataAdapter::new(bytemuck::cast_slice(&places), size_of::<[f32; 3]>(), 0) else {
        return triangles;
    };
    let options = meshopt::SimplifyOptions::LockBorder | meshopt::SimplifyOptions::ErrorAbsolute;
    let flat = triangles.concat();
    let fewer = meshopt::simplify(&flat, &vertices, 0, error_m as f32, options, None);
    fewer.chunks_exact(3).map(|triangle| [triangle[0], triangle[1], triangle[2]]).collect()
}
