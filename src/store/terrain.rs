//! Terrain pages: which posts are active, their heights as residuals of the network's coarser ones, the parent's
//! heights and the slopes as residuals of those; zstd over all.
//!
//! Unpacked: `error_m` and `step_m` (f32), length of the bits (varint), the bits, then per active post, corners first
//! and then coarse to fine, in four runs: own heights, parent's heights less own (zigzag varints, in steps), slopes
//! east, slopes north (i8). A bit stands only where both posts that its post needs are active.

use super::bytes::{BitReader, BitWriter, Reader, Writer};
use super::error::{EncodeError, PageFault};
use super::frame::{self, Framed};
use crate::content::rtin::{Active, CORNERS, Diagonal, Post, splits};
use crate::content::{PageId, PageKind, TerrainPage, TerrainPost};
use crate::forest::CellId;
use std::collections::HashMap;

/// No finer step is written, metres: f32 heights below 16 km hold it.
pub const HEIGHT_STEP_MIN_M: f32 = 1e-3;
/// Heights and parents' heights beyond this are cut off, metres.
const HEIGHT_MAX_M: f64 = 100_000.0;

/// The step of a page whose error is to be `error_m`: an eighth of it, at least 1 mm.
pub fn height_step_m(error_m: f32) -> f32 {
    (error_m / 8.0).max(HEIGHT_STEP_MIN_M)
}

/// The ends of the hypotenuse of each post, corners first: what a height is predicted from.
fn order(diagonal: Diagonal) -> impl Iterator<Item = (Post, Option<[Post; 2]>)> {
    let splits = splits(diagonal).iter().map(|split| (split.post, Some(split.ends)));
    CORNERS.into_iter().map(|post| (post, None)).chain(splits)
}

/// Predictions from posts that came before: the mean of the ends, or the last corner.
#[derive(Default)]
struct Predictor {
    known: HashMap<Post, i64>,
    last: i64,
}

impl Predictor {
    fn predict(&self, ends: Option<[Post; 2]>) -> i64 {
        let known = |post: Post| self.known.get(&post).copied().unwrap_or(0);
        ends.map_or(self.last, |[a, b]| (known(a) + known(b)) >> 1)
    }

    fn learn(&mut self, post: Post, value: i64) {
        self.known.insert(post, value);
        self.last = value;
    }
}

/// Heights become multiples of `step_m` (raised to 1 mm), the same as [`TerrainPage::quantize`] makes.
pub fn encode_terrain(page: &TerrainPage, step_m: f32) -> Result<Vec<u8>, EncodeError> {
    let step_m = step_m.max(HEIGHT_STEP_MIN_M);
    let active = page.active();
    if active.len() != page.posts.len() || !active.is_closed(page.diagonal) {
        return Err(EncodeError::Open);
    }
    let steps =
        |height_m: f32| (f64::from(height_m).clamp(-HEIGHT_MAX_M, HEIGHT_MAX_M) / f64::from(step_m)).round() as i64;
    let mut plain = Writer::default();
    plain.f32(page.error_m);
    plain.f32(step_m);
    let bits = active_bits(&active, page.diagonal);
    plain.varint(bits.len() as u64);
    plain.bytes(&bits);
    let (mut own, mut parent, mut slopes) =
        (Writer::default(), Writer::default(), [Writer::default(), Writer::default()]);
    let mut heights = Predictor::default();
    let mut slope = [Predictor::default(), Predictor::default()];
    for (at, ends) in order(page.diagonal) {
        let Some(post) = page.index_of(at).map(|index| &page.posts[index]) else { continue };
        let height = steps(post.height_m);
        own.signed(height - heights.predict(ends));
        heights.learn(at, height);
        parent.signed(steps(post.parent_height_m) - height);
        for axis in 0..2 {
            let value = i64::from(post.slope[axis]);
            slopes[axis].u8((value - slope[axis].predict(ends)) as u8);
            slope[axis].learn(at, value);
        }
    }
    plain.bytes(&own.0);
    plain.bytes(&parent.0);
    plain.bytes(&slopes[0].0);
    plain.bytes(&slopes[1].0);
    let body = frame::pack(&plain.0);
    frame::frame(PageId { cell: page.cell, kind: PageKind::Terrain }, &body, plain.0.len())
}

fn active_bits(active: &Active, diagonal: Diagonal) -> Vec<u8> {
    let mut bits = BitWriter::default();
    for split in splits(diagonal) {
        if split.needs.iter().all(|&need| active.contains(need)) {
            bits.push(active.contains(split.post));
        }
    }
    bits.finish()
}

fn active_of(bits: &[u8], diagonal: Diagonal) -> Active {
    let mut bits = BitReader::new(bits);
    let mut active = Active::corners();
    for split in splits(diagonal) {
        if split.needs.iter().all(|&need| active.contains(need)) && bits.next() {
            active.insert(split.post);
        }
    }
    active
}

pub fn decode_terrain(page: &[u8], cell: CellId) -> Result<TerrainPage, PageFault> {
    let framed = frame::open(page)?;
    if framed.id != (PageId { cell, kind: PageKind::Terrain }) {
        return Err(PageFault::WrongPage);
    }
    decode_framed(&framed)
}

pub(super) fn decode_framed(framed: &Framed) -> Result<TerrainPage, PageFault> {
    let plain = frame::unpack(framed.body, framed.unpacked)?;
    let mut reader = Reader::new(&plain);
    let error_m = reader.f32()?;
    let step = f64::from(reader.f32()?);
    if error_m < 0.0 || !(1e-6..HEIGHT_MAX_M).contains(&step) {
        return Err(PageFault::Malformed("an error or a step out of range"));
    }
    let bits_len = reader.count(1)?;
    let diagonal = Diagonal::of(framed.id.cell);
    let active = active_of(reader.take(bits_len)?, diagonal);
    let posts = decode_posts(&mut reader, &active, diagonal, step)?;
    reader.finish()?;
    TerrainPage::from_posts(framed.id.cell, error_m, posts).ok_or(PageFault::Malformed("a network that is not closed"))
}

fn decode_posts(
    reader: &mut Reader,
    active: &Active,
    diagonal: Diagonal,
    step: f64,
) -> Result<Vec<TerrainPost>, PageFault> {
    let used: Vec<_> = order(diagonal).filter(|&(post, _)| active.contains(post)).collect();
    let metres = |steps: i64| {
        let height_m = steps as f64 * step;
        let fits = height_m.abs() <= HEIGHT_MAX_M + step;
        if fits { Ok(height_m as f32) } else { Err(PageFault::Malformed("a height out of range")) }
    };
    let mut posts = Vec::with_capacity(used.len());
    let mut steps = Vec::with_capacity(used.len());
    let mut heights = Predictor::default();
    for &(post, ends) in &used {
        let height = heights.predict(ends).wrapping_add(reader.signed()?);
        let height_m = metres(height)?;
        heights.learn(post, height);
        steps.push(height);
        let (column, row) = post;
        posts.push(TerrainPost { column, row, height_m, parent_height_m: height_m, slope: [0; 2] });
    }
    for (post, height) in posts.iter_mut().zip(steps) {
        post.parent_height_m = metres(height.wrapping_add(reader.signed()?))?;
    }
    for axis in 0..2 {
        let mut slopes = Predictor::default();
        for (post, &(at, ends)) in posts.iter_mut().zip(&used) {
            let value = (slopes.predict(ends) as u8).wrapping_add(reader.u8()?) as i8;
            post.slope[axis] = value;
            slopes.learn(at, i64::from(value));
        }
    }
    Ok(posts)
}
