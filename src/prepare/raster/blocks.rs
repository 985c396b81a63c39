//! Decoded pieces of raster files, kept within a limit: whatever the sources' size, memory stays bounded.

use crate::prepare::PrepareError;
use std::collections::VecDeque;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering::Relaxed};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError, RwLock};

/// Heights of one block in row order; voids are [`VOID_I16`] or NaN.
#[derive(Debug)]
pub enum Block {
    I16(Vec<i16>),
    F32(Vec<f32>),
}

/// Marks a post without data.
pub const VOID_I16: i16 = i16::MIN;

impl Block {
    pub fn get(&self, index: usize) -> Option<f32> {
        match self {
            Self::I16(posts) => posts.get(index).filter(|&&h| h != VOID_I16).map(|&h| f32::from(h)),
            Self::F32(posts) => posts.get(index).copied().filter(|h| !h.is_nan()),
        }
    }

    pub fn len(&self) -> usize {
        match self {
            Self::I16(posts) => posts.len(),
            Self::F32(posts) => posts.len(),
        }
    }

    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    fn bytes(&self) -> u64 {
        let each = match self {
            Self::I16(_) => size_of::<i16>(),
            Self::F32(_) => size_of::<f32>(),
        };
        (self.len() * each + SLOT_BYTES) as u64
    }
}

/// What a held block costs beside its posts.
const SLOT_BYTES: usize = 96;

/// How a file is cut into blocks, posts.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct BlockLayout {
    pub rows: u32,
    pub cols: u32,
    pub block_rows: u32,
    pub block_cols: u32,
}

impl BlockLayout {
    pub fn blocks_across(&self) -> u32 {
        self.cols.div_ceil(self.block_cols)
    }

    pub fn blocks(&self) -> u32 {
        self.rows.div_ceil(self.block_rows) * self.blocks_across()
    }

    /// First row, first column, rows and columns of a block; those at the right and lower edge are cut.
    pub fn extent(&self, block: u32) -> BlockExtent {
        let (row, col) =
            (block / self.blocks_across() * self.block_rows, block % self.blocks_across() * self.block_cols);
        BlockExtent { row, col, rows: self.block_rows.min(self.rows - row), cols: self.block_cols.min(self.cols - col) }
    }
}

/// Where a block lies in its file, posts.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct BlockExtent {
    pub row: u32,
    pub col: u32,
    pub rows: u32,
    pub cols: u32,
}

/// Decodes blocks of one file.
pub trait BlockReader: Send + Sync {
    fn layout(&self) -> BlockLayout;

    /// Posts of a block (as many as its extent has), voids marked.
    fn read(&self, block: u32) -> Result<Block, PrepareError>;
}

struct Slot {
    held: RwLock<Option<Arc<Block>>>,
    recent: AtomicBool,
    reader: u32,
    block: u32,
}

/// All blocks of all files: decoded on demand, dropped by second chance when over the limit.
pub struct BlockCache {
    readers: Vec<Box<dyn BlockReader>>,
    slots: Vec<Slot>,
    /// Slots that hold a block, in the order in which they are asked to go.
    ring: Mutex<VecDeque<u32>>,
    used_bytes: AtomicU64,
    limit_bytes: u64,
    failure: Mutex<Option<PrepareError>>,
}

impl BlockCache {
    pub fn new(limit_bytes: u64) -> Self {
        Self {
            readers: Vec::new(),
            slots: Vec::new(),
            ring: Mutex::new(VecDeque::new()),
            used_bytes: AtomicU64::new(0),
            limit_bytes,
            failure: Mutex::new(None),
        }
    }

    /// Adds a file; its block `b` is slot `returned + b`.
    pub fn add(&mut self, reader: Box<dyn BlockReader>) -> u32 {
        let (first, index) = (self.slots.len() as u32, self.readers.len() as u32);
        self.slots.extend((0..reader.layout().blocks()).map(|block| Slot {
            held: RwLock::new(None),
            recent: AtomicBool::new(false),
            reader: index,
            block,
        }));
        self.readers.push(reader);
        first
    }

    pub fn slots(&self) -> u32 {
        self.slots.len() as u32
    }

    /// The block of a slot.
    pub fn load(&self, slot: u32) -> Result<Arc<Block>, PrepareError> {
        let entry = &self.slots[slot as usize];
        entry.recent.store(true, Relaxed);
        if let Some(block) = &*entry.held.read().unwrap_or_else(PoisonError::into_inner) {
            return Ok(block.clone());
        }
        let block = {
            // Held while decoding, so that a block that many threads want is decoded once.
            let mut held = entry.held.write().unwrap_or_else(PoisonError::into_inner);
            if let Some(block) = &*held {
                return Ok(block.clone());
            }
            let block = Arc::new(self.readers[entry.reader as usize].read(entry.block)?);
            *held = Some(block.clone());
            block
        };
        self.used_bytes.fetch_add(block.bytes(), Relaxed);
        self.make_room(slot);
        Ok(block)
    }

    /// The block of a slot; where it cannot be read any more, none, and the first cause is kept.
    pub fn get(&self, slot: u32) -> Option<Arc<Block>> {
        self.load(slot).map_err(|error| lock(&self.failure).get_or_insert(error).to_string()).ok()
    }

    /// The first failure of [`BlockCache::get`], once.
    pub fn take_failure(&self) -> Option<PrepareError> {
        lock(&self.failure).take()
    }

    fn make_room(&self, newest: u32) {
        let mut ring = lock(&self.ring);
        ring.push_back(newest);
        // Each slot gets one second chance; what other threads hold a lock on stays.
        for _ in 0..2 * ring.len() {
            if self.used_bytes.load(Relaxed) <= self.limit_bytes {
                return;
            }
            let Some(slot) = ring.pop_front() else { return };
            let entry = &self.slots[slot as usize];
            if slot == newest || entry.recent.swap(false, Relaxed) || !self.drop_block(entry) {
                ring.push_back(slot);
            }
        }
    }

    fn drop_block(&self, entry: &Slot) -> bool {
        let Ok(mut held) = entry.held.try_write() else { return false };
        if let Some(block) = held.take() {
            self.used_bytes.fetch_sub(block.bytes(), Relaxed);
        }
        true
    }
}

fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::atomic::AtomicU32;

    struct Counting(Arc<AtomicU32>);

    impl BlockReader for Counting {
        fn layout(&self) -> BlockLayout {
            BlockLayout { rows: 10, cols: 10, block_rows: 4, block_cols: 4 }
        }

        fn read(&self, block: u32) -> Result<Block, PrepareError> {
            self.0.fetch_add(1, Relaxed);
            let extent = self.layout().extent(block);
            Ok(Block::I16(vec![block as i16; (extent.rows * extent.cols) as usize]))
        }
    }

    #[test]
    fn blocks_are_decoded_once_within_the_limit_and_again_beyond_it() {
        let each = (16 * 2 + SLOT_BYTES) as u64;
        for (limit, decoded) in [(100 * each, 9), (3 * each, 18)] {
            let reads = Arc::new(AtomicU32::new(0));
            let mut cache = BlockCache::new(limit);
            assert_eq!(cache.add(Box::new(Counting(reads.clone()))), 0);
            for slot in (0..9).chain(0..9) {
                let block = cache.load(slot).expect("readable");
                assert_eq!(block.get(0), Some(slot as f32));
                assert!(cache.used_bytes.load(Relaxed) <= limit);
            }
            assert_eq!(reads.load(Relaxed), decoded);
        }
    }

    #[test]
    fn edge_blocks_are_cut() {
        let layout = BlockLayout { rows: 10, cols: 7, block_rows: 4, block_cols: 4 };
        assert_eq!(layout.blocks(), 6);
        assert_eq!(layout.extent(5), BlockExtent { row: 8, col: 4, rows: 2, cols: 3 });
    }
}
