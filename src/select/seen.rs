//! What of the needed shows: drawn into a picture of depths by the processor, and asked for in it.

use super::hidden::DepthMap;
use super::needed::{Needed, StoredPages};
use super::sight::Sight;
use super::solid::Part;
use crate::content::{Object, ObjectMesh, ObjectPage, PageId};
use crate::forest::index::Place;
use glam::DVec3;
use std::collections::BTreeMap;
use std::sync::Arc;

/// Gives meshes of stored pages of objects too.
pub trait StoredMeshes: StoredPages {
    fn mesh(&self, page: PageId, place: Place) -> Option<Arc<ObjectMesh>>;
}

/// Of what one view needs, what is not wholly behind something nearer: triangles of the ground one by one, objects as
/// wholes. What shows in no pixel, nor beside one, does not count.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Seen {
    pub pages: BTreeMap<PageId, Place>,
    pub terrain_triangles: u64,
    pub object_triangles: u64,
}

impl Seen {
    pub fn triangles(&self) -> u64 {
        self.terrain_triangles + self.object_triangles
    }

    fn take(&mut self, page: PageId, shows: bool, needed: &Needed) {
        self.pages.extend(needed.pages.get_key_value(&page).filter(|_| shows));
    }
}

/// What is needed, and of what it consists.
#[derive(Default)]
pub struct Scene {
    pub needed: Needed,
    /// Parts in view of each page of the ground.
    pub ground: Vec<(PageId, Vec<Part>)>,
    /// Of each picture, what of the ground it lies on.
    pub pictures: Vec<(PageId, Vec<Part>)>,
    /// Numbers of the objects in view of each page.
    pub objects: Vec<(PageId, Arc<ObjectPage>, Vec<usize>)>,
}

impl Scene {
    pub fn seen(&self, sight: &Sight<'_>, pages: &dyn StoredMeshes) -> Seen {
        let mut map = DepthMap::new(sight.view);
        let parts = self.ground.iter().flat_map(|(_, parts)| parts);
        parts.for_each(|part| map.draw(part.corners));
        let meshed: Vec<_> = self
            .objects
            .iter()
            .filter_map(|(id, page, objects)| Some((*id, page, objects, pages.mesh(*id, *self.needed.pages.get(id)?)?)))
            .collect();
        for (_, page, objects, mesh) in &meshed {
            let of_all = objects.iter().flat_map(|&object| triangles_of(page, &page.objects[object], mesh, sight));
            of_all.for_each(|triangle| map.draw(triangle));
        }
        let mut seen = Seen::default();
        for (id, parts) in &self.ground {
            let shown = parts.iter().filter(|part| map.shows(part.corners)).count() as u64;
            seen.terrain_triangles += shown;
            seen.take(*id, shown > 0, &self.needed);
        }
        for (id, parts) in &self.pictures {
            seen.take(*id, parts.iter().any(|part| map.shows(part.corners)), &self.needed);
        }
        for (id, page, objects, mesh) in &meshed {
            let shown = objects.iter().map(|&object| &page.objects[object]);
            let shown = shown.filter(|object| triangles_of(page, object, mesh, sight).any(|of| map.shows(of)));
            let shown = shown.map(triangle_count).sum::<u64>();
            seen.object_triangles += shown;
            seen.take(*id, shown > 0, &self.needed);
        }
        seen
    }
}

/// Of an object, from the eye.
fn triangles_of<'a>(
    page: &ObjectPage,
    object: &Object,
    mesh: &'a ObjectMesh,
    sight: &Sight<'_>,
) -> impl Iterator<Item = [DVec3; 3]> + use<'a> {
    let origin = (page.origin - sight.eye).xyz();
    let indices = mesh.indices.get(object.indices.start as usize..object.indices.end as usize).unwrap_or_default();
    let corner = move |at: u32| {
        let vertex = mesh.vertices.get(at as usize)?;
        Some(origin + DVec3::from(vertex.position_m.map(f64::from)))
    };
    indices.chunks_exact(3).filter_map(move |of| Some([corner(of[0])?, corner(of[1])?, corner(of[2])?]))
}

pub fn triangle_count(object: &Object) -> u64 {
    u64::from(object.indices.end - object.indices.start) / 3
}
