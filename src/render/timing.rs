//! How long the GPU takes for a frame: timestamps at the ends of its passes, read when they are there.

use super::device::Gpu;
use super::read_back::map_for_reading;
use std::sync::{Arc, OnceLock};

/// Frames under way whose times are waited for; more go untimed.
const RING: usize = 4;
/// Two timestamps.
const PAIR_BYTES: u64 = 16;

#[derive(Debug)]
struct Slot {
    /// Timestamps as the GPU writes them, and a copy that can be read.
    resolved: wgpu::Buffer,
    copied: wgpu::Buffer,
    /// There while the slot is in use.
    mapped: Option<Arc<OnceLock<Result<(), String>>>>,
    frame: u64,
}

/// Nothing at all where the adapter has no timestamps.
#[derive(Debug)]
pub(super) struct GpuTimer(Option<Timer>);

#[derive(Debug)]
struct Timer {
    queries: wgpu::QuerySet,
    period_ns: f32,
    slots: [Slot; RING],
    /// The slot of the frame that is being recorded.
    current: Option<usize>,
    frame: u64,
    newest: Option<(u64, f32)>,
}

impl GpuTimer {
    pub fn new(gpu: &Gpu) -> Self {
        let can = gpu.device.features().contains(wgpu::Features::TIMESTAMP_QUERY);
        Self(can.then(|| Timer::new(gpu)))
    }

    /// Begins a frame.
    pub fn begin(&mut self) {
        if let Some(timer) = &mut self.0 {
            timer.collect();
            timer.frame += 1;
            timer.current = timer.slots.iter().position(|slot| slot.mapped.is_none());
        }
    }

    /// What a pass of the frame has to write.
    pub fn writes(&self, is_first: bool, is_last: bool) -> Option<wgpu::RenderPassTimestampWrites<'_>> {
        let timer = self.0.as_ref()?;
        let first = 2 * timer.current? as u32;
        (is_first || is_last).then_some(wgpu::RenderPassTimestampWrites {
            query_set: &timer.queries,
            beginning_of_pass_write_index: is_first.then_some(first),
            end_of_pass_write_index: is_last.then_some(first + 1),
        })
    }

    /// After the last pass, before its submission.
    pub fn resolve(&self, encoder: &mut wgpu::CommandEncoder) {
        let Some(timer) = &self.0 else { return };
        let Some(at) = timer.current else { return };
        let (slot, first) = (&timer.slots[at], 2 * at as u32);
        encoder.resolve_query_set(&timer.queries, first..first + 2, &slot.resolved, 0);
        encoder.copy_buffer_to_buffer(&slot.resolved, 0, &slot.copied, 0, PAIR_BYTES);
    }

    /// After the submission of the last pass.
    pub fn end(&mut self) {
        let Some(timer) = &mut self.0 else { return };
        if let Some(slot) = timer.current.take().map(|at| &mut timer.slots[at]) {
            slot.frame = timer.frame;
            slot.mapped = Some(map_for_reading(&slot.copied));
        }
    }

    /// Of the newest frame that is known to be finished, milliseconds.
    pub fn newest_ms(&mut self) -> Option<f32> {
        let timer = self.0.as_mut()?;
        timer.collect();
        timer.newest.map(|(_, ms)| ms)
    }
}

impl Timer {
    fn new(gpu: &Gpu) -> Self {
        let queries = gpu.device.create_query_set(&wgpu::QuerySetDescriptor {
            label: Some("frame times"),
            ty: wgpu::QueryType::Timestamp,
            count: 2 * RING as u32,
        });
        let slot = |_| Slot {
            resolved: gpu.buffer(
                "timestamps",
                wgpu::BufferUsages::QUERY_RESOLVE | wgpu::BufferUsages::COPY_SRC,
                PAIR_BYTES,
            ),
            copied: gpu.buffer("timestamps read", wgpu::BufferUsages::MAP_READ, PAIR_BYTES),
            mapped: None,
            frame: 0,
        };
        Self {
            queries,
            period_ns: gpu.queue.get_timestamp_period(),
            slots: [0; RING].map(slot),
            current: None,
            frame: 0,
            newest: None,
        }
    }

    /// Reads the times that have arrived and frees their slots.
    fn collect(&mut self) {
        for slot in &mut self.slots {
            let Some(Some(answer)) = slot.mapped.as_ref().map(|mapped| mapped.get().cloned()) else { continue };
            slot.mapped = None;
            if answer.is_err() {
                continue;
            }
            let ticks = slot.ticks();
            slot.copied.unmap();
            if let Some(ticks) = ticks.filter(|_| self.newest.is_none_or(|(frame, _)| frame < slot.frame)) {
                self.newest = Some((slot.frame, (ticks as f64 * f64::from(self.period_ns) * 1e-6) as f32));
            }
        }
    }
}

impl Slot {
    /// Ticks between the two timestamps; `None` where the clock was set back between them.
    fn ticks(&self) -> Option<u64> {
        let mapped = self.copied.get_mapped_range(..).ok()?;
        let (words, _) = mapped.as_chunks::<8>();
        let [begin, end] = [words.first()?, words.get(1)?].map(|word| u64::from_le_bytes(*word));
        end.checked_sub(begin)
    }
}
