//! One picture after the other: arenas, passes and targets together.

use super::culling::{SEAM, Sight};
use super::device::{Gpu, RenderError};
use super::eye::eye_relative;
use super::frame::{Frame, FrameGroup};
use super::ids::{DrawnIds, IdOf};
use super::imagery::{ImageryArena, ImageryPlace, PictureArray, world_image_bytes};
use super::meshes::MeshArena;
use super::objects::{Fading, ObjectsItem, ObjectsPass, gpu_bytes};
use super::options::{DrawOptions, FrameStats, GpuLimits};
use super::read_back::ReadBack;
#[cfg(feature = "window")]
use super::screen::Screen;
use super::sky::SkyPass;
use super::targets::Targets;
use super::terrain::{Piece, TerrainItem, TerrainPass, texture_window};
use super::timing::GpuTimer;
use crate::camera::View;
use crate::content::{AtlasFormat, ImageryPage, Page, PageId, PageKind};
use crate::forest::CellId;
use crate::select::{DrawObjects, DrawPiece, Selection};

/// A normal outcome: the caller drops something and tries again, or draws without.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{needed_bytes} bytes do not fit into an arena of {limit_bytes} bytes: drop a page or raise the footprint")]
pub struct ArenaFull {
    pub needed_bytes: u64,
    pub limit_bytes: u64,
}

/// A picture's width and height, and its sRGB RGBA, rows from the top.
pub type SizedPixels = ([u32; 2], Vec<u8>);

/// The largest mesh: all posts of a page with skirts must fit into the arena.
const LEAST_MESH_BYTES: u64 = 256 << 10;

#[derive(Debug)]
pub struct Renderer {
    pub(super) gpu: Gpu,
    frame: FrameGroup,
    imagery: ImageryArena,
    meshes: MeshArena,
    terrain: TerrainPass,
    objects: ObjectsPass,
    sky: SkyPass,
    pub(super) targets: Option<Targets>,
    drawn: DrawnIds,
    timer: GpuTimer,
    /// The picture that was asked for and is on its way.
    picture: Option<ReadBack>,
    /// The window that is drawn into, if there is one.
    #[cfg(feature = "window")]
    pub(super) screen: Option<Screen>,
}

impl Renderer {
    /// A renderer without a window, on the best adapter there is. Mesh arenas below 256 KiB count as 256 KiB.
    pub fn new(limits: GpuLimits) -> Result<Self, RenderError> {
        Self::over(Gpu::headless()?, limits)
    }

    /// A renderer on a device.
    pub(super) fn over(gpu: Gpu, limits: GpuLimits) -> Result<Self, RenderError> {
        let frame = FrameGroup::new(&gpu);
        let imagery = ImageryArena::new(&gpu, limits.imagery_bytes);
        let renderer = Self {
            terrain: TerrainPass::new(&gpu, &frame.layout, &imagery.layout),
            objects: ObjectsPass::new(&gpu, &frame.layout, limits.objects_bytes),
            sky: SkyPass::new(&gpu, &frame.layout),
            meshes: MeshArena::new(limits.mesh_bytes.max(LEAST_MESH_BYTES)),
            targets: None,
            drawn: DrawnIds::default(),
            timer: GpuTimer::new(&gpu),
            picture: None,
            #[cfg(feature = "window")]
            screen: None,
            imagery,
            frame,
            gpu,
        };
        renderer.gpu.check()?;
        Ok(renderer)
    }

    /// Name of the adapter and its interface, for reports.
    pub fn adapter_name(&self) -> &str {
        &self.gpu.adapter_name
    }

    /// The layout that atlases of pages should have before they are uploaded.
    pub fn atlas_format(&self) -> AtlasFormat {
        self.gpu.atlas_format()
    }

    /// Whether atlases of a layout can be drawn; else their pages are drawn in plain colours.
    pub fn can_read(&self, format: AtlasFormat) -> bool {
        self.gpu.can_read(format)
    }

    /// Bytes that [`Renderer::upload`] will take for a page.
    pub fn gpu_bytes(page: &Page) -> u64 {
        gpu_bytes(page)
    }

    /// Whether the device is gone: nothing can be drawn any more, and a new renderer has to take over.
    pub fn is_lost(&self) -> bool {
        self.gpu.is_lost()
    }

    /// Gives the device up, as if its driver had: for tests of what happens then.
    pub fn lose_device(&self) {
        self.gpu.device.destroy();
        // A destroyed device tells of its loss once nothing is under way any more.
        drop(self.gpu.wait());
    }

    /// New limits of the arenas. Lower ones only hinder uploads: what is there stays until it is removed, and terrain
    /// meshes until the next one is cut.
    pub fn set_limits(&mut self, limits: GpuLimits) {
        self.imagery.set_limit(limits.imagery_bytes);
        self.meshes.set_limit(limits.mesh_bytes.max(LEAST_MESH_BYTES));
        self.objects.set_limit(limits.objects_bytes);
    }

    /// Gives a chunk of the arena of pictures back where the others can hold what is in it; ask again for more.
    pub fn compact(&mut self) {
        self.imagery.compact(&self.gpu);
    }

    /// Time that the GPU took for the newest frame that is known to be finished, milliseconds; without the window's
    /// panels. `None` before the first one, and where the adapter cannot tell.
    pub fn gpu_ms(&mut self) -> Option<f32> {
        self.timer.newest_ms()
    }

    /// Bytes held in all arenas; never above the sum of the limits, unless these were lowered.
    pub fn allocated_bytes(&self) -> u64 {
        self.imagery.bytes() + self.meshes.bytes() + self.objects.bytes()
    }

    /// Bytes held by the cache of terrain meshes alone.
    pub fn mesh_bytes(&self) -> u64 {
        self.meshes.bytes()
    }

    /// Takes a page over; gives the bytes that it takes of its arena. Terrain takes none: meshes are cut when drawn.
    /// A page that is there already stays as it is.
    pub fn upload(&mut self, page: &Page) -> Result<u64, ArenaFull> {
        match page {
            Page::Terrain(_) | Page::Segment(_) => Ok(0),
            Page::Imagery(page) => self.imagery.upload(&self.gpu, page),
            Page::Objects(page, mesh) => self.objects.upload(&self.gpu, page, mesh),
        }
    }

    /// Takes a zone's picture into the world image, which is drawn where no other picture is there. It stays.
    pub fn add_to_world_image(&mut self, root: &ImageryPage) {
        self.imagery.add_to_world(&self.gpu, root);
    }

    /// Bytes of the world image, once there is one.
    pub fn world_image_bytes() -> u64 {
        world_image_bytes()
    }

    /// Drops a page; none that is not there.
    pub fn remove(&mut self, page: PageId) {
        match page.kind {
            PageKind::Terrain => self.meshes.remove(page.cell),
            PageKind::Imagery => self.imagery.remove(page.cell),
            PageKind::Objects { .. } => self.objects.remove(page),
            PageKind::Segment => {}
        }
    }

    /// How far the drawn ground lies above the base of each object of a page, metres, 0 or more; in the order of the
    /// page's objects. Without, all lifts are 0.
    pub fn set_lifts(&mut self, page: PageId, lifts_m: &[f32]) {
        self.objects.set_lifts(&self.gpu, page, lifts_m);
    }

    /// Draws a selection as the view sees it; the pictures stay until the next call. Submits without waiting.
    pub fn draw(
        &mut self,
        view: &View,
        selection: &Selection,
        options: &DrawOptions,
    ) -> Result<FrameStats, RenderError> {
        self.draw_fading(view, selection, &selection.objects, &[], options)
    }

    /// The same while some objects give way to others: `steady` are those of the selection that are drawn whole. Nothing
    /// fades in frames with ids.
    pub fn draw_fading(
        &mut self,
        view: &View,
        selection: &Selection,
        steady: &[DrawObjects],
        fading: &[Fading],
        options: &DrawOptions,
    ) -> Result<FrameStats, RenderError> {
        let (steady, fading) = if options.aov { (&*selection.objects, &[][..]) } else { (steady, fading) };
        self.gpu.check()?;
        self.fit_targets(view.size_px, options.aov)?;
        self.frame.write(&self.gpu, &Frame::new(view, selection.press, options));
        self.meshes.begin_frame();
        self.drawn.clear();
        self.timer.begin();
        let sight = Sight::new(view, selection.press, options.lowest_m);
        let pieces = near_to_far(view, selection.pieces.iter().filter(|piece| sight.sees(piece)));
        let drawn = pieces.len() as u32;
        let culled = selection.pieces.len() as u32 - drawn;
        let mut stats = FrameStats { pieces: drawn, pieces_culled: culled, ..Default::default() };
        let mut clear = true;
        let mut items = Vec::with_capacity(pieces.len());
        for piece in pieces {
            let item = match self.terrain_item(view, piece, &mut stats) {
                Ok(item) => item,
                Err(_) => {
                    // What is drawn so far makes room for the rest: slow, but without a hole.
                    self.submit(&mut stats, &items, None, clear)?;
                    self.gpu.wait()?;
                    self.meshes.clear();
                    items.clear();
                    clear = false;
                    stats.mesh_flushes += 1;
                    match self.terrain_item(view, piece, &mut stats) {
                        Ok(item) => item,
                        Err(full) => return Err(RenderError::Device(full.to_string())),
                    }
                }
            };
            items.push(item);
        }
        let (objects, count) = self.objects.prepare(&self.gpu, view, steady, fading);
        stats.object_triangles = count.triangles;
        stats.objects_missing = count.missing;
        stats.triangles = stats.terrain_triangles + stats.object_triangles;
        self.submit(&mut stats, &items, Some(&objects), clear)?;
        self.gpu.check()?;
        Ok(stats)
    }

    /// Waits until all that was drawn is done: what a frame really costs.
    pub fn finish(&self) -> Result<(), RenderError> {
        self.gpu.wait()
    }

    /// Hands all uploads to the device and waits, so that the driver lets go of its copies. A lost device shows when the
    /// next frame is drawn.
    pub fn flush_uploads(&self) {
        self.gpu.queue.submit([]);
        drop(self.gpu.wait());
    }

    /// The last picture: sRGB RGBA, rows from the top.
    pub fn read_color(&self) -> Result<Vec<u8>, RenderError> {
        self.targets()?.read_color(&self.gpu)
    }

    /// Asks for a copy of the last picture, which [`Renderer::poll_picture`] gives when it is there: nothing waits. While
    /// one is on its way no second one is begun.
    pub fn request_picture(&mut self) -> Result<(), RenderError> {
        self.gpu.check()?;
        if self.picture.is_none() {
            self.picture = Some(self.targets()?.begin_read_color(&self.gpu));
        }
        self.gpu.check()
    }

    /// The picture that was asked for, once: its size and sRGB RGBA, rows from the top. `None` while it is on its way,
    /// and where none was asked for.
    pub fn poll_picture(&mut self) -> Option<Result<SizedPixels, RenderError>> {
        let size_px = self.picture.as_ref()?.size_px;
        let pixels = match self.gpu.collect() {
            Ok(()) => self.picture.as_ref()?.take()?,
            Err(error) => Err(error),
        };
        self.picture = None;
        Some(pixels.map(|pixels| (size_px, pixels)))
    }

    /// Whether a picture that was asked for is on its way.
    pub fn has_picture_pending(&self) -> bool {
        self.picture.is_some()
    }

    /// The ids of the last picture, rows from the top; 0 is the sky.
    pub fn read_ids(&self) -> Result<Vec<u32>, RenderError> {
        self.targets()?.read_ids(&self.gpu)
    }

    /// Distances along the view axis in the last picture, metres, rows from the top; infinite for the sky.
    pub fn read_depth_m(&self) -> Result<Vec<f32>, RenderError> {
        self.targets()?.read_depth_m(&self.gpu)
    }

    /// What an id of the last picture stands for; `None` for the sky and for cells that were not drawn.
    pub fn resolve_id(&self, id: u32) -> Option<IdOf> {
        self.drawn.resolve(id)
    }

    fn targets(&self) -> Result<&Targets, RenderError> {
        self.targets.as_ref().ok_or(RenderError::NotDrawn { what: "a picture" })
    }

    fn fit_targets(&mut self, size_px: [u32; 2], aov: bool) -> Result<(), RenderError> {
        let fits = self.targets.as_ref().is_some_and(|targets| targets.size_px == size_px && targets.has_aov() == aov);
        if !fits {
            self.targets = None;
            self.targets = Some(Targets::new(&self.gpu, size_px, aov)?);
        }
        Ok(())
    }

    fn terrain_item(
        &mut self,
        view: &View,
        draw: &DrawPiece,
        stats: &mut FrameStats,
    ) -> Result<TerrainItem, ArenaFull> {
        let (mesh, is_new) = self.meshes.ensure(&self.gpu, &draw.terrain, draw.cell)?;
        let triangles = u64::from(mesh.index_count / 3);
        let offset = eye_relative(mesh.origin, view);
        let picture = self.picture_of(draw);
        stats.terrain_triangles += triangles;
        stats.pieces_built += u32::from(is_new);
        stats.pieces_without_picture += u32::from(is_without_picture(draw, picture));
        let (uv_scale, uv_offset) = picture.map_or(([0.0; 2], [0.0; 2]), |(cell, _)| texture_window(draw.cell, cell));
        let piece = Piece {
            offset: offset.to_array(),
            own: draw.own,
            uv_scale,
            uv_offset,
            // Pieces that agree exactly may still part by the rounding of their positions.
            skirt_m: draw.skirt_m.max(offset.length() * SEAM),
            layer: picture.map_or(0, |(_, place)| place.layer),
            id: self.drawn.add(draw.cell),
            textured: u32::from(picture.is_some()),
        };
        Ok(TerrainItem { mesh: (draw.terrain.cell, draw.cell), picture: picture.map(|(_, place)| place), piece })
    }

    /// The wanted picture, the nearest one above it that is there, or the world image.
    fn picture_of(&self, draw: &DrawPiece) -> Option<(CellId, ImageryPlace)> {
        let mut above = draw.imagery.into_iter().flat_map(CellId::ancestors);
        let paged = above.find_map(|cell| self.imagery.place(cell).map(|place| (cell, place)));
        paged.or_else(|| self.imagery.world_place(draw.cell))
    }

    /// Draws a batch of terrain, and after the last one the objects and the sky.
    fn submit(
        &mut self,
        stats: &mut FrameStats,
        items: &[TerrainItem],
        last: Option<&[ObjectsItem]>,
        clear: bool,
    ) -> Result<(), RenderError> {
        self.terrain.write(&self.gpu, items);
        let targets = self.targets.as_ref().ok_or(RenderError::NotDrawn { what: "a picture" })?;
        let aov = targets.has_aov();
        let mut encoder = self.gpu.device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
        // A frame's first pass clears, its last one draws the objects.
        let mut pass = targets.begin_pass(&mut encoder, clear, self.timer.writes(clear, last.is_some()));
        pass.set_bind_group(0, &self.frame.group, &[]);
        stats.draw_calls += self.terrain.draw(&self.gpu, &mut pass, aov, items, &self.meshes, &self.imagery);
        if let Some(objects) = last {
            stats.draw_calls += self.objects.draw(&self.gpu, &mut pass, aov, objects) + 1;
            self.sky.draw(&self.gpu, &mut pass, aov);
        }
        drop(pass);
        if last.is_some() {
            self.timer.resolve(&mut encoder);
        }
        self.gpu.queue.submit([encoder.finish()]);
        if last.is_some() {
            self.timer.end();
        }
        Ok(())
    }
}

/// Whether a piece is drawn without the picture that it was selected with.
fn is_without_picture(draw: &DrawPiece, picture: Option<(CellId, ImageryPlace)>) -> bool {
    let is_wanted =
        |wanted| picture.is_some_and(|(cell, place)| cell == wanted && place.array != PictureArray::WorldImage);
    draw.imagery.is_some_and(|wanted| !is_wanted(wanted))
}

/// Near pieces first: what they hide is not shaded.
fn near_to_far<'a>(view: &View, pieces: impl Iterator<Item = &'a DrawPiece>) -> Vec<&'a DrawPiece> {
    let mut order: Vec<_> =
        pieces.map(|piece| (piece.cell.bounds().center().to_ecef().distance_m(view.eye()), piece)).collect();
    order.sort_by(|a, b| a.0.total_cmp(&b.0));
    order.into_iter().map(|(_, piece)| piece).collect()
}
