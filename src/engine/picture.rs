//! What can be read of a frame once it is drawn.

use crate::render::{IdOf, RenderError, Renderer};
use crate::store::Manifest;

/// The picture that was drawn last.
#[derive(Clone, Copy)]
pub struct LastPicture<'a> {
    renderer: &'a Renderer,
    manifest: &'a Manifest,
}

impl<'a> LastPicture<'a> {
    pub(super) fn new(renderer: &'a Renderer, manifest: &'a Manifest) -> Self {
        Self { renderer, manifest }
    }

    /// RGBA8, sRGB, rows from the top.
    pub fn read_color(&self) -> Result<Vec<u8>, RenderError> {
        self.renderer.read_color()
    }

    /// Ids, if the frame was asked for them; 0 is the sky.
    pub fn read_ids(&self) -> Result<Vec<u32>, RenderError> {
        self.renderer.read_ids()
    }

    /// Linear depth in metres, infinite for the sky, if the frame was asked for ids.
    pub fn read_depth(&self) -> Result<Vec<f32>, RenderError> {
        self.renderer.read_depth_m()
    }

    /// What an id stands for; `None` for the sky.
    pub fn resolve_id(&self, id: u32) -> Option<IdOf> {
        self.renderer.resolve_id(id)
    }

    /// What an id stands for, for the legend beside a picture.
    pub fn describe_id(&self, id: u32) -> serde_json::Value {
        match self.renderer.resolve_id(id) {
            None => serde_json::Value::Null,
            Some(IdOf::Cell(cell)) => serde_json::json!({ "cell": cell.to_string() }),
            Some(IdOf::Object { collection, id }) => {
                let name = self.manifest.collections.get(usize::from(collection)).map(|info| &info.name);
                serde_json::json!({ "collection": name, "object": id })
            }
        }
    }
}
