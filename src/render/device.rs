//! The adapter, the device and its errors.

use crate::content::AtlasFormat;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::{Arc, Mutex, OnceLock, PoisonError};

#[derive(Debug, thiserror::Error)]
pub enum RenderError {
    #[error(
        "no graphics adapter was found ({0}): install a Vulkan driver; without a graphics card the software driver \
         of the Debian package mesa-vulkan-drivers will do"
    )]
    NoAdapter(String),
    #[error(
        "the graphics adapter {name} gives no device: {cause}; its driver is too old or broken: update it, or install \
         the software driver of the Debian package mesa-vulkan-drivers"
    )]
    NoDevice { name: String, cause: String },
    #[error("the window gives no surface to draw into: {0}; check that its display still runs")]
    NoSurface(String),
    #[error("the adapter {name} cannot show pictures in this window: {cause}; update its driver")]
    Surface { name: String, cause: String },
    #[error("the graphics device was lost ({0}): a new one must be opened; if that goes on, update its driver")]
    Lost(String),
    #[error("the graphics device failed: {0}; update its driver or choose a smaller picture or footprint")]
    Device(String),
    #[error("{what} was not drawn: ask for it in the options of the frame before reading it")]
    NotDrawn { what: &'static str },
    #[error("a picture of {0} x {1} pixels cannot be drawn: both sides must be 1 to {2}")]
    Size(u32, u32, u32),
}

/// What is drawn indirectly is written by this module alone: no pass needs to look at it again in each frame.
pub(super) fn instance_flags() -> wgpu::InstanceFlags {
    wgpu::InstanceFlags::default() - wgpu::InstanceFlags::VALIDATION_INDIRECT_CALL
}

/// Device and queue, and the first error that was not tied to a call.
#[derive(Clone, Debug)]
pub(super) struct Gpu {
    pub device: wgpu::Device,
    pub queue: wgpu::Queue,
    pub adapter_name: String,
    /// Whether the processor draws.
    pub is_software: bool,
    /// Whether what is drawn indirectly can number its instances.
    pub numbers_indirectly: bool,
    /// Of the colour pictures: sRGB, 8 bits a channel.
    pub color_format: wgpu::TextureFormat,
    failure: Arc<Mutex<Option<String>>>,
    lost: Arc<OnceLock<String>>,
}

/// What is used where it is there: times on the GPU, runs of many objects in one call, textures in blocks.
const FEATURES: wgpu::Features = wgpu::Features::TIMESTAMP_QUERY
    .union(wgpu::Features::INDIRECT_FIRST_INSTANCE)
    .union(wgpu::Features::TEXTURE_COMPRESSION_BC)
    .union(wgpu::Features::TEXTURE_COMPRESSION_ETC2);

impl Gpu {
    pub fn headless() -> Result<Self, RenderError> {
        let instance = wgpu::Instance::new(wgpu::InstanceDescriptor {
            flags: instance_flags(),
            ..wgpu::InstanceDescriptor::new_without_display_handle()
        });
        let options = wgpu::RequestAdapterOptions {
            power_preference: wgpu::PowerPreference::HighPerformance,
            ..Default::default()
        };
        let adapter = pollster::block_on(instance.request_adapter(&options))
            .map_err(|cause| RenderError::NoAdapter(cause.to_string()))?;
        Self::from_adapter(&adapter, wgpu::TextureFormat::Rgba8UnormSrgb)
    }

    /// A device whose colour pictures have a format, which must be sRGB with 8 bits a channel.
    pub fn from_adapter(adapter: &wgpu::Adapter, color_format: wgpu::TextureFormat) -> Result<Self, RenderError> {
        let info = adapter.get_info();
        let descriptor = wgpu::DeviceDescriptor {
            label: Some("stoop"),
            required_features: adapter.features() & FEATURES,
            required_limits: wgpu::Limits { max_texture_array_layers: 256, ..Default::default() },
            // Small blocks: what is allocated should not outgrow what the arenas account for.
            memory_hints: wgpu::MemoryHints::MemoryUsage,
            ..Default::default()
        };
        let (device, queue) = pollster::block_on(adapter.request_device(&descriptor))
            .map_err(|cause| RenderError::NoDevice { name: info.name.clone(), cause: cause.to_string() })?;
        let failure = Arc::new(Mutex::new(None));
        let sink = Arc::clone(&failure);
        device.on_uncaptured_error(Arc::new(move |error: wgpu::Error| {
            sink.lock().unwrap_or_else(PoisonError::into_inner).get_or_insert_with(|| error.to_string());
        }));
        let lost = Arc::new(OnceLock::new());
        let sink = Arc::clone(&lost);
        device.set_device_lost_callback(move |reason, message| {
            // Only the first loss counts.
            let _ = sink.set(if message.is_empty() { format!("{reason:?}") } else { message });
        });
        let adapter_name = format!("{} ({:?})", info.name, info.backend);
        let is_software = info.device_type == wgpu::DeviceType::Cpu;
        // Direct3D tells shaders such numbers by the pass alone that `instance_flags` leaves out.
        let numbers_indirectly =
            info.backend != wgpu::Backend::Dx12 && device.features().contains(wgpu::Features::INDIRECT_FIRST_INSTANCE);
        Ok(Self { device, queue, adapter_name, is_software, numbers_indirectly, color_format, failure, lost })
    }

    /// Whether textures of a format can be drawn from.
    pub fn can_read(&self, format: AtlasFormat) -> bool {
        let features = self.device.features();
        match format {
            AtlasFormat::Rgba8 => true,
            AtlasFormat::Bc7 => features.contains(wgpu::Features::TEXTURE_COMPRESSION_BC),
            AtlasFormat::Etc2 => features.contains(wgpu::Features::TEXTURE_COMPRESSION_ETC2),
        }
    }

    /// The format that atlases should have: blocks where the GPU reads them. A processor that draws would unpack a block for
    /// each texel.
    pub fn atlas_format(&self) -> AtlasFormat {
        let of_blocks = [AtlasFormat::Bc7, AtlasFormat::Etc2].into_iter().find(|&format| self.can_read(format));
        of_blocks.filter(|_| !self.is_software).unwrap_or_default()
    }

    pub fn is_lost(&self) -> bool {
        self.lost.get().is_some()
    }

    /// The loss of the device, or else the first failure since the last call.
    pub fn check(&self) -> Result<(), RenderError> {
        if let Some(message) = self.lost.get() {
            return Err(RenderError::Lost(message.clone()));
        }
        match self.failure.lock().unwrap_or_else(PoisonError::into_inner).take() {
            Some(message) => Err(RenderError::Device(message)),
            None => Ok(()),
        }
    }

    /// Waits until all that was submitted is done.
    pub fn wait(&self) -> Result<(), RenderError> {
        self.poll(wgpu::PollType::wait_indefinitely())
    }

    /// Takes note of what is done by now, without waiting.
    pub fn collect(&self) -> Result<(), RenderError> {
        self.poll(wgpu::PollType::Poll)
    }

    fn poll(&self, how: wgpu::PollType) -> Result<(), RenderError> {
        self.check()?;
        // wgpu panics where it learns of a loss in the middle of a poll; here that is an error like any other.
        let polled = catch_unwind(AssertUnwindSafe(|| self.device.poll(how)));
        self.check()?;
        match polled {
            Ok(Ok(_)) => Ok(()),
            Ok(Err(cause)) => Err(RenderError::Device(cause.to_string())),
            Err(_) => Err(RenderError::Device("waiting for it was broken off".into())),
        }
    }

    pub fn buffer(&self, label: &str, usage: wgpu::BufferUsages, size: u64) -> wgpu::Buffer {
        self.device.create_buffer(&wgpu::BufferDescriptor {
            label: Some(label),
            size,
            usage: usage | wgpu::BufferUsages::COPY_DST,
            mapped_at_creation: false,
        })
    }

    /// A new buffer with these bytes, whose number must be a multiple of 4 and above 0.
    pub fn filled_buffer(&self, label: &str, usage: wgpu::BufferUsages, bytes: &[u8]) -> wgpu::Buffer {
        let buffer = self.buffer(label, usage, bytes.len() as u64);
        self.queue.write_buffer(&buffer, 0, bytes);
        buffer
    }
}

/// A storage buffer of the frame that grows as needed, with its bind group.
#[derive(Debug)]
pub(super) struct FrameStorage {
    label: &'static str,
    layout: wgpu::BindGroupLayout,
    buffer: wgpu::Buffer,
    group: wgpu::BindGroup,
}

impl FrameStorage {
    pub fn new(gpu: &Gpu, label: &'static str, layout: &wgpu::BindGroupLayout) -> Self {
        let (buffer, group) = Self::allocate(gpu, label, layout, 4096);
        Self { label, layout: layout.clone(), buffer, group }
    }

    fn allocate(gpu: &Gpu, label: &str, layout: &wgpu::BindGroupLayout, size: u64) -> (wgpu::Buffer, wgpu::BindGroup) {
        let buffer = gpu.buffer(label, wgpu::BufferUsages::STORAGE, size);
        let entries = [wgpu::BindGroupEntry { binding: 0, resource: buffer.as_entire_binding() }];
        let group =
            gpu.device.create_bind_group(&wgpu::BindGroupDescriptor { label: Some(label), layout, entries: &entries });
        (buffer, group)
    }

    pub fn write(&mut self, gpu: &Gpu, bytes: &[u8]) {
        let size = bytes.len() as u64;
        if size > self.buffer.size() {
            (self.buffer, self.group) = Self::allocate(gpu, self.label, &self.layout, size.next_power_of_two());
        }
        gpu.queue.write_buffer(&self.buffer, 0, bytes);
    }

    pub fn group(&self) -> &wgpu::BindGroup {
        &self.group
    }
}
