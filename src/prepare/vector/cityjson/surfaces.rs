//! The surfaces of a geometry: boundaries, semantics, materials and textures walked side by side.

use super::document::{Appearance, Geometry, MaterialValues, Templates, Tree};
use crate::prepare::textures::Picture;
use crate::prepare::vector::{Surface, SurfaceKind, SurfaceTexture};
use std::sync::Arc;

/// How many lists lie round a geometry's surfaces.
#[derive(Clone, Copy)]
enum Nest {
    Surfaces,
    /// Of a solid: its outer shell, then cavities, which nobody sees.
    Shells,
    Solids,
}

impl Nest {
    fn of(kind: &str) -> Option<Self> {
        match kind {
            "MultiSurface" | "CompositeSurface" => Some(Self::Surfaces),
            "Solid" => Some(Self::Shells),
            "MultiSolid" | "CompositeSolid" => Some(Self::Solids),
            _ => None,
        }
    }
}

/// What a document's geometries refer to.
pub struct Scene<'a> {
    pub appearance: &'a Appearance,
    pub templates: &'a Templates,
    /// Those of the appearance, in its order.
    pub pictures: &'a [Arc<Picture>],
    /// In the file's coordinate system.
    pub vertices: &'a [[f64; 3]],
    /// Longitude, latitude (degrees) and the file's height; no numbers where there is no such place.
    pub places: &'a [[f64; 3]],
    /// Takes a place from the file's system.
    pub place: &'a dyn Fn([f64; 3]) -> [f64; 3],
}

impl Scene<'_> {
    /// The level of detail of a geometry; an instance has its template's.
    pub fn lod(&self, geometry: &Geometry) -> Option<f64> {
        self.template_of(geometry).unwrap_or(geometry).lod()
    }

    fn template_of(&self, geometry: &Geometry) -> Option<&Geometry> {
        self.templates.templates.get(geometry.template.filter(|_| geometry.kind == "GeometryInstance")?)
    }

    /// All surfaces of a geometry; none of points and lines. Those that name a vertex that is not there have no rings.
    pub fn surfaces(&self, geometry: &Geometry) -> Vec<Surface> {
        if geometry.kind != "GeometryInstance" {
            return self.collect(geometry, &|at| self.places.get(at).copied());
        }
        let Some(template) = self.template_of(geometry) else { return Vec::new() };
        let anchor = geometry.boundaries.at(0).index().and_then(|at| self.vertices.get(at));
        let (Some(&anchor), Some(matrix)) = (anchor, geometry.matrix.as_deref().filter(|matrix| matrix.len() == 16))
        else {
            return Vec::new();
        };
        self.collect(template, &|at| Some((self.place)(moved(matrix, *self.templates.vertices.get(at)?, anchor))))
    }

    fn collect(&self, geometry: &Geometry, point: &dyn Fn(usize) -> Option<[f64; 3]>) -> Vec<Surface> {
        let themes = &geometry.material;
        let theme = self.appearance.default_theme.as_ref().and_then(|name| themes.get(name));
        let materials = theme.or_else(|| themes.values().next());
        let pictures = &geometry.texture;
        let theme = self.appearance.default_texture_theme.as_ref().and_then(|name| pictures.get(name));
        let textures = theme.or_else(|| pictures.values().next());
        let mut walk = Walk { scene: self, geometry, materials, point, surfaces: Vec::new() };
        if let Some(nest) = Nest::of(&geometry.kind) {
            let semantics = geometry.semantics.as_ref().map_or(&Tree::Nothing, |semantics| &semantics.values);
            let materials = materials.map_or(&Tree::Nothing, |materials| &materials.values);
            let textures = textures.map_or(&Tree::Nothing, |textures| &textures.values);
            walk.descend(nest, &geometry.boundaries, Beside { semantics, materials, textures });
        }
        walk.surfaces
    }
}

struct Walk<'a> {
    scene: &'a Scene<'a>,
    geometry: &'a Geometry,
    materials: Option<&'a MaterialValues>,
    point: &'a dyn Fn(usize) -> Option<[f64; 3]>,
    surfaces: Vec<Surface>,
}

/// What is told of some boundaries, nested like them.
#[derive(Clone, Copy)]
struct Beside<'a> {
    semantics: &'a Tree,
    materials: &'a Tree,
    textures: &'a Tree,
}

impl Beside<'_> {
    fn at(&self, at: usize) -> Self {
        let [semantics, materials, textures] = [self.semantics, self.materials, self.textures].map(|tree| tree.at(at));
        Self { semantics, materials, textures }
    }
}

impl Walk<'_> {
    fn descend(&mut self, nest: Nest, boundary: &Tree, beside: Beside) {
        match nest {
            Nest::Surfaces => {
                for (at, surface) in boundary.list().iter().enumerate() {
                    self.surface(surface, beside.at(at));
                }
            }
            Nest::Shells => self.descend(Nest::Surfaces, boundary.at(0), beside.at(0)),
            Nest::Solids => {
                for (at, solid) in boundary.list().iter().enumerate() {
                    self.descend(Nest::Shells, solid, beside.at(at));
                }
            }
        }
    }

    fn surface(&mut self, boundary: &Tree, beside: Beside) {
        let named = self.geometry.semantics.as_ref().zip(beside.semantics.index());
        let named = named.and_then(|(semantics, at)| semantics.surfaces.get(at));
        let kind = named.and_then(|surface| SurfaceKind::of_semantics(&surface.kind));
        if kind == Some(SurfaceKind::Unseen) {
            return;
        }
        let ring = |ring: &Tree| ring.list().iter().map(|at| (self.point)(at.index()?)).collect::<Option<Vec<_>>>();
        let rings = boundary.list().iter().map(ring).collect::<Option<Vec<_>>>().unwrap_or_default();
        let material = beside.materials.index().or_else(|| self.materials?.value);
        let material = material.and_then(|at| self.scene.appearance.materials.get(at));
        let color = material.and_then(|material| material.diffuse).map(|rgb| rgb.map(|c| (c * 255.0).round() as u8));
        let texture = self.texture(beside.textures);
        self.surfaces.push(Surface { rings, kind, color, texture });
    }

    /// The picture of a surface's rings; none where they name none, or no one for all.
    fn texture(&self, rings: &Tree) -> Option<SurfaceTexture> {
        let number = rings.at(0).at(0).index()?;
        let uv = |at: &Tree| {
            let &[u, v] = self.scene.appearance.texture_vertices.get(at.index()?)?;
            Some([u as f32, (1.0 - v) as f32])
        };
        let ring = |ring: &Tree| {
            let (first, rest) = ring.list().split_first()?;
            (first.index() == Some(number)).then(|| rest.iter().map(uv).collect::<Option<Vec<_>>>())?
        };
        let uvs = rings.list().iter().map(ring).collect::<Option<Vec<_>>>()?;
        Some(SurfaceTexture { picture: self.scene.pictures.get(number)?.clone(), uvs })
    }
}

impl SurfaceKind {
    fn of_semantics(name: &str) -> Option<Self> {
        match name {
            "RoofSurface" => Some(Self::Roof),
            "WallSurface" => Some(Self::Wall),
            "GroundSurface" => Some(Self::Ground),
            "OuterCeilingSurface" | "OuterFloorSurface" | "Window" | "Door" => Some(Self::Other),
            "ClosureSurface" | "InteriorWallSurface" | "CeilingSurface" | "FloorSurface" => Some(Self::Unseen),
            _ => None,
        }
    }
}

/// A template's vertex by a matrix in rows, set down at an anchor (CityJSON 2.0, §3.4).
fn moved(matrix: &[f64], vertex: [f64; 3], anchor: [f64; 3]) -> [f64; 3] {
    let row = |at: usize| (0..3).map(|axis| matrix[4 * at + axis] * vertex[axis]).sum::<f64>() + matrix[4 * at + 3];
    std::array::from_fn(|axis| row(axis) / if row(3) == 0.0 { 1.0 } else { row(3) } + anchor[axis])
}
