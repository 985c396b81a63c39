//! Pages with their atlases laid out for the GPU, on the threads that decode.

use super::reader::Source;
use crate::content::{AtlasFormat, Page, PageId};
use crate::forest::index::Place;
use crate::paging::{PageReader, PageRun, RangeRead, ReadError};
use std::sync::Arc;

impl Source {
    /// The same with atlases as a renderer wants them.
    pub(super) fn with_atlases(self, format: AtlasFormat) -> Self {
        match format {
            AtlasFormat::Rgba8 => self,
            format => Self { reader: Arc::new(AtlasReader { inner: self.reader, format }), ..self },
        }
    }
}

struct AtlasReader {
    inner: Arc<dyn PageReader>,
    format: AtlasFormat,
}

impl AtlasReader {
    fn run(&self, inner: Option<Arc<dyn PageRun>>) -> Option<Arc<dyn PageRun>> {
        inner.map(|inner| -> Arc<dyn PageRun> { Arc::new(AtlasRun { inner, format: self.format }) })
    }
}

impl PageReader for AtlasReader {
    fn load(&self, page: PageId, place: Place) -> Result<Page, ReadError> {
        Ok(laid_out(self.inner.load(page, place)?, self.format))
    }

    fn read_run(&self, run: &RangeRead) -> Result<Option<Arc<dyn PageRun>>, ReadError> {
        Ok(self.run(self.inner.read_run(run)?))
    }

    fn read_runs(&self, runs: &[RangeRead]) -> Vec<Result<Option<Arc<dyn PageRun>>, ReadError>> {
        self.inner.read_runs(runs).into_iter().map(|read| Ok(self.run(read?))).collect()
    }

    fn is_remote(&self) -> bool {
        self.inner.is_remote()
    }
}

struct AtlasRun {
    inner: Arc<dyn PageRun>,
    format: AtlasFormat,
}

impl PageRun for AtlasRun {
    fn page(&self, page: PageId, place: Place) -> Result<Page, ReadError> {
        Ok(laid_out(self.inner.page(page, place)?, self.format))
    }
}

fn laid_out(mut page: Page, format: AtlasFormat) -> Page {
    if let Page::Objects(_, mesh) = &mut page
        && mesh.atlas.is_some()
    {
        Arc::make_mut(mesh).compress_atlas(format);
    }
    page
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::content::{Atlas, ObjectMesh, ObjectPage, PageFile};
    use crate::forest::{CellId, Zone};

    /// One page with an atlas, alone and in a run.
    struct Textured;

    impl Textured {
        fn page() -> Page {
            let root: CellId = Zone::new(3).unwrap().root();
            let (page, mut mesh): (ObjectPage, ObjectMesh) = ObjectPage::from_prisms(root, 0, 0, 0.0, Vec::new());
            mesh.atlas = Atlas::new(8, 8, &[90; 192]);
            Page::Objects(Arc::new(page), Arc::new(mesh))
        }
    }

    impl PageReader for Textured {
        fn load(&self, _: PageId, _: Place) -> Result<Page, ReadError> {
            Ok(Self::page())
        }

        fn read_run(&self, _: &RangeRead) -> Result<Option<Arc<dyn PageRun>>, ReadError> {
            Ok(Some(Arc::new(Self)))
        }
    }

    impl PageRun for Textured {
        fn page(&self, _: PageId, _: Place) -> Result<Page, ReadError> {
            Ok(Self::page())
        }
    }

    #[test]
    fn atlases_are_laid_out_alone_and_in_runs() {
        let reader = AtlasReader { inner: Arc::new(Textured), format: AtlasFormat::Bc7 };
        let place = Place { offset: 0, len: 1 };
        let id = Textured::page().id();
        let format = |page: Page| match page {
            Page::Objects(_, mesh) => mesh.atlas.as_ref().map(Atlas::format),
            _ => None,
        };
        assert_eq!(format(reader.load(id, place).unwrap()), Some(AtlasFormat::Bc7));
        let (zone, file) = (id.cell.zone(), PageFile::Pack);
        let run = RangeRead { id: 0, zone, file, offset: 0, len: 1, pages: vec![(id, place)] };
        let read = reader.read_runs(&[run]).remove(0).unwrap().unwrap();
        assert_eq!(format(read.page(id, place).unwrap()), Some(AtlasFormat::Bc7));
    }
}
