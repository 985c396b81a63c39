//! The pictures that a file's textures name, each once.

use super::document::{Appearance, Texture};
use crate::prepare::source::SourceFile;
use crate::prepare::textures::{Picture, Wrap};
use std::collections::HashMap;
use std::path::Path;
use std::sync::Arc;

pub struct Pictures {
    file: SourceFile,
    by_name: HashMap<(String, Wrap), Arc<Picture>>,
}

impl Pictures {
    /// Paths are taken from the folder of the file, on disk or in its .zip.
    pub fn beside(file: &SourceFile) -> Self {
        Self { file: file.clone(), by_name: HashMap::new() }
    }

    /// In the order of the textures. None is read here.
    pub fn of(&mut self, appearance: &Appearance) -> Vec<Arc<Picture>> {
        appearance.textures.iter().map(|texture| self.picture(texture)).collect()
    }

    fn picture(&mut self, texture: &Texture) -> Arc<Picture> {
        let wrap = match texture.wrap.as_deref() {
            Some("wrap") => Wrap::Repeat,
            Some("mirror") => Wrap::Mirror,
            _ => Wrap::Clamp,
        };
        let picture = self.by_name.entry((texture.image.clone(), wrap));
        let file = &self.file;
        picture.or_insert_with(|| Arc::new(Picture::of_file(beside(file, &texture.image), wrap))).clone()
    }
}

/// A file by its path from the folder of another.
fn beside(file: &SourceFile, name: &str) -> SourceFile {
    let name = name.replace('\\', "/");
    let from = |of: &Path| of.parent().unwrap_or(Path::new("")).join(&name);
    match &file.inside {
        Some(inside) => {
            let inside = from(Path::new(inside)).to_string_lossy().into_owned();
            SourceFile { path: file.path.clone(), inside: Some(inside) }
        }
        None => SourceFile { path: from(&file.path), inside: None },
    }
}
