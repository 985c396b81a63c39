//! The atlas of a page.

use super::islands::{Island, islands};
use super::picture::Picture;
use super::shelves::{Layout, layout};
use crate::content::{ATLAS_ALIGN_PX, ATLAS_GUTTER_PX, ATLAS_SIDE_MAX, ATLAS_TEXELS_MAX, Detail, FaceGroup, Prism};
use crate::prepare::buildings::Reason;
use crate::store::{EncodeError, JPEG_QUALITY, encode_atlas};
use image::RgbImage;
use std::sync::Arc;

/// Atlases are scaled down to this many bytes of JPEG: with their shapes, pages stay within 128 KiB.
pub const ATLAS_BYTES_MAX: usize = 48 << 10;
/// A face may show its picture so many times along a side; those that repeat it more often are drawn in plain colour.
pub const REPEATS_MAX: f32 = 8.0;
/// Parts of an atlas; the smallest of more stay in plain colour.
const PARTS_MAX: usize = 1024;
/// How often the scale is lowered before the textures of a page are given up.
const ROUNDS_MAX: usize = 48;
/// Texels of a source that are looked at along each side of a texel of the atlas.
const SAMPLES_MAX: i64 = 16;
/// What lies within this of a texel's border does not reach over it.
const BORDER: f32 = 1e-3;

/// What came of a page's textures.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Baked {
    /// As JPEG; `None` where no face has a texture.
    pub atlas: Option<Vec<u8>>,
    /// Objects whose textures were scaled down.
    pub scaled: u64,
    /// Objects that lost textures for want of room.
    pub lost: u64,
}

/// A box of a picture, in texels: left, upper, right, lower end. What repeats may lie beyond the picture.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Part {
    picture: usize,
    ends: [i64; 4],
}

impl Part {
    fn size(&self) -> [i64; 2] {
        [self.ends[2] - self.ends[0], self.ends[3] - self.ends[1]]
    }

    fn area(&self) -> i64 {
        self.size()[0] * self.size()[1]
    }

    fn holds(&self, other: &Self) -> bool {
        let (own, other_ends) = (self.ends, other.ends);
        let is_in =
            own[0] <= other_ends[0] && own[1] <= other_ends[1] && own[2] >= other_ends[2] && own[3] >= other_ends[3];
        self.picture == other.picture && is_in
    }

    /// Sides in the atlas, without the gutter.
    fn scaled(&self, scale: f64) -> [u32; 2] {
        let most = f64::from(ATLAS_SIDE_MAX - 2 * ATLAS_GUTTER_PX);
        self.size().map(|side| (side as f64 * scale).round().clamp(1.0, most) as u32)
    }
}

/// Texels that an object shows of its pictures.
pub fn texels(prism: &Prism, pictures: &[Arc<Picture>]) -> u64 {
    let Some(detail) = &prism.detail else { return 0 };
    let parts = islands(detail).0.into_iter().filter_map(|island| {
        let picture = pictures.get(island.picture as usize)?;
        Some(part_of(&island, 0, picture.size_px().ok()?).area() as u64)
    });
    parts.sum()
}

fn part_of(island: &Island, picture: usize, size_px: [u32; 2]) -> Part {
    let texel = |end: usize| island.ends[end] * size_px[end % 2] as f32;
    let low = |end: usize| (texel(end) + BORDER).floor() as i64;
    let high = |end: usize| ((texel(end) - BORDER).ceil() as i64).max(low(end - 2) + 1);
    Part { picture, ends: [low(0), low(1), high(2), high(3)] }
}

/// One object's islands.
struct Member {
    of_corner: Vec<Option<usize>>,
    /// Of each island: its part, and its picture's size.
    parts: Vec<Option<(usize, [u32; 2])>>,
}

/// Makes the atlas of a page, and names places in it instead of places in the pictures given with each object. Faces
/// whose picture cannot be read, or which find no room, are left in plain colour.
pub fn bake(prisms: &mut [Prism], pictures: &[&[Arc<Picture>]]) -> Result<Baked, EncodeError> {
    let mut page = Page::default();
    let mut members: Vec<Option<Member>> = Vec::with_capacity(prisms.len());
    for (prism, own) in prisms.iter().zip(pictures) {
        members.push(prism.detail.as_ref().and_then(|detail| page.member(detail, own)));
    }
    if members.iter().all(Option::is_none) {
        return Ok(Baked::default());
    }
    page.choose(&mut members);
    let Some(made) = page.fit()? else {
        prisms.iter_mut().for_each(|prism| prism.detail.iter_mut().for_each(plain));
        return Ok(Baked { lost: members.iter().flatten().count() as u64, ..Baked::default() });
    };
    let mut baked = Baked { atlas: Some(made.jpeg.clone()), ..Baked::default() };
    for (prism, member) in prisms.iter_mut().zip(&members) {
        let (Some(detail), Some(member)) = (&mut prism.detail, member) else { continue };
        baked.scaled += u64::from(made.scale < 1.0);
        baked.lost += u64::from(member.parts.contains(&None));
        made.rename(detail, member, &page.parts);
    }
    Ok(baked)
}

/// Takes the textures off a detail.
fn plain(detail: &mut Detail) {
    detail.uvs.clear();
    detail.groups.iter_mut().for_each(|group| group.texture = None);
}

/// What is to go into an atlas.
#[derive(Default)]
struct Page {
    pictures: Vec<Arc<Picture>>,
    parts: Vec<Part>,
}

/// An atlas, and where its parts lie.
struct Made {
    jpeg: Vec<u8>,
    scale: f64,
    layout: Layout,
}

impl Page {
    /// The islands of a detail, each a part of its own at first.
    fn member(&mut self, detail: &Detail, own: &[Arc<Picture>]) -> Option<Member> {
        let (found, of_corner) = islands(detail);
        if found.is_empty() {
            return None;
        }
        let parts = found.iter().map(|island| {
            let picture = own.get(island.picture as usize)?;
            let size_px = picture.size_px().ok()?;
            let number = self.number(picture);
            self.parts.push(part_of(island, number, size_px));
            Some((self.parts.len() - 1, size_px))
        });
        let parts = parts.collect();
        Some(Member { of_corner, parts })
    }

    fn number(&mut self, picture: &Arc<Picture>) -> usize {
        let known = self.pictures.iter().position(|known| Arc::ptr_eq(known, picture));
        known.unwrap_or_else(|| {
            self.pictures.push(picture.clone());
            self.pictures.len() - 1
        })
    }

    /// Keeps parts that lie in no other, the largest first, as many as an atlas may have.
    fn choose(&mut self, members: &mut [Option<Member>]) {
        let mut order: Vec<usize> = (0..self.parts.len()).collect();
        order.sort_by_key(|&at| (std::cmp::Reverse(self.parts[at].area()), at));
        let mut kept: Vec<Part> = Vec::new();
        let mut becomes = vec![None; self.parts.len()];
        for at in order {
            let part = self.parts[at];
            let holder = kept.iter().position(|other| other.holds(&part));
            becomes[at] = holder.or_else(|| {
                (kept.len() < PARTS_MAX).then(|| {
                    kept.push(part);
                    kept.len() - 1
                })
            });
        }
        self.parts = kept;
        for part in members.iter_mut().flatten().flat_map(|member| &mut member.parts) {
            *part = part.and_then(|(at, size_px)| Some((becomes[at]?, size_px)));
        }
    }

    /// The atlas at the largest scale at which it is in its bounds; `None` where there is none.
    fn fit(&self) -> Result<Option<Made>, EncodeError> {
        let area: i64 = self.parts.iter().map(Part::area).sum();
        let mut scale = (f64::from(ATLAS_TEXELS_MAX) / (area as f64).max(1.0)).sqrt().min(1.0);
        let mut crops: Option<Vec<RgbImage>> = None;
        for _ in 0..ROUNDS_MAX {
            let Some(layout) = layout(&self.cells(scale)) else {
                scale *= 0.93;
                continue;
            };
            // Sources are read once; smaller ones are made of what was taken of them first.
            let first = match crops.take() {
                Some(first) => first,
                None => match self.crops(scale) {
                    Ok(first) => first,
                    Err(_) => return Ok(None),
                },
            };
            let parts: Vec<RgbImage> =
                self.parts.iter().zip(&first).map(|(part, crop)| shrunk(crop, part.scaled(scale))).collect();
            crops = Some(first);
            let [width, height] = layout.size_px;
            let rgb = composed(&layout, &parts);
            let jpeg = encode_atlas(width, height, &rgb, JPEG_QUALITY)?;
            if jpeg.len() <= ATLAS_BYTES_MAX {
                return Ok(Some(Made { jpeg, scale, layout }));
            }
            scale *= (ATLAS_BYTES_MAX as f64 / jpeg.len() as f64).sqrt().clamp(0.5, 0.97);
        }
        Ok(None)
    }

    /// Sides of the parts with their gutters.
    fn cells(&self, scale: f64) -> Vec<[u32; 2]> {
        let cell = |side: u32| (side + 2 * ATLAS_GUTTER_PX).next_multiple_of(ATLAS_ALIGN_PX);
        self.parts.iter().map(|part| part.scaled(scale).map(cell)).collect()
    }

    /// The parts out of their pictures; one picture is in memory at a time.
    fn crops(&self, scale: f64) -> Result<Vec<RgbImage>, Reason> {
        let mut crops = vec![RgbImage::new(0, 0); self.parts.len()];
        for (number, picture) in self.pictures.iter().enumerate() {
            let mut of_it = self.parts.iter().zip(&mut crops).filter(|(part, _)| part.picture == number).peekable();
            if of_it.peek().is_none() {
                continue;
            }
            let texels = picture.read()?;
            let sides = [texels.width(), texels.height()].map(i64::from);
            for (part, crop) in of_it {
                let texel = |x: i64, y: i64| {
                    let at = [picture.wrap.texel(x, sides[0]), picture.wrap.texel(y, sides[1])];
                    texels.get_pixel(at[0] as u32, at[1] as u32).0
                };
                *crop = boxed(part.ends, part.scaled(scale), &texel);
            }
        }
        Ok(crops)
    }
}

fn shrunk(crop: &RgbImage, size: [u32; 2]) -> RgbImage {
    let [width, height] = [crop.width(), crop.height()];
    if [width, height] == size {
        return crop.clone();
    }
    let ends = [0, 0, i64::from(width), i64::from(height)];
    boxed(ends, size, &|x, y| crop.get_pixel(x.min(ends[2] - 1) as u32, y.min(ends[3] - 1) as u32).0)
}

/// A box of texels in fewer of them: each the mean of those that it covers.
fn boxed(ends: [i64; 4], size: [u32; 2], texel: &dyn Fn(i64, i64) -> [u8; 3]) -> RgbImage {
    let span = |axis: usize, at: u32| {
        let (low, side) = (ends[axis], (ends[axis + 2] - ends[axis]) as f64 / f64::from(size[axis]));
        let from = low + (f64::from(at) * side).floor() as i64;
        let to = (low + (f64::from(at + 1) * side).ceil() as i64).min(ends[axis + 2]).max(from + 1);
        (from..to).step_by((to - from).div_euclid(SAMPLES_MAX).max(1) as usize)
    };
    RgbImage::from_fn(size[0], size[1], |x, y| {
        let (mut sum, mut count) = ([0u32; 3], 0);
        for (row, column) in span(1, y).flat_map(|row| span(0, x).map(move |column| (row, column))) {
            let seen = texel(column, row);
            (0..3).for_each(|channel| sum[channel] += u32::from(seen[channel]));
            count += 1;
        }
        image::Rgb(sum.map(|sum| ((sum + count / 2) / count.max(1)) as u8))
    })
}

/// The parts at their places; what is left of their cells repeats their borders.
fn composed(layout: &Layout, parts: &[RgbImage]) -> Vec<u8> {
    let [width, height] = layout.size_px;
    let mut atlas = RgbImage::new(width, height);
    for (&[left, upper], part) in layout.places.iter().zip(parts) {
        let cell = |side: u32| (side + 2 * ATLAS_GUTTER_PX).next_multiple_of(ATLAS_ALIGN_PX);
        for (y, x) in (0..cell(part.height())).flat_map(|y| (0..cell(part.width())).map(move |x| (y, x))) {
            let within = |at: u32, side: u32| at.saturating_sub(ATLAS_GUTTER_PX).min(side - 1);
            let seen = *part.get_pixel(within(x, part.width()), within(y, part.height()));
            atlas.put_pixel(left + x, upper + y, seen);
        }
    }
    atlas.into_raw()
}

impl Made {
    /// Names places in the atlas; faces without a part lose their texture.
    fn rename(&self, detail: &mut Detail, member: &Member, parts: &[Part]) {
        let part_of = |corner: u32| member.of_corner[corner as usize].and_then(|island| member.parts[island]);
        let groups = std::mem::take(&mut detail.groups);
        for group in groups {
            if group.texture.is_none() {
                detail.groups.push(group);
                continue;
            }
            let (kept, lost): (Vec<_>, Vec<_>) = group.triangles.iter().partition(|t| part_of(t[0]).is_some());
            let with = |texture, triangles: Vec<[u32; 3]>| FaceGroup { texture, triangles, ..group.clone() };
            let made = [with(Some(0), kept), with(None, lost)];
            detail.groups.extend(made.into_iter().filter(|group| !group.triangles.is_empty()));
        }
        for (corner, uv) in (0..).zip(&mut detail.uvs) {
            let Some((part, size_px)) = part_of(corner) else { continue };
            let size = parts[part].scaled(self.scale);
            let place = |axis: usize| {
                let texel = uv[axis] * size_px[axis] as f32 - parts[part].ends[axis] as f32;
                let across = texel / parts[part].size()[axis] as f32 * size[axis] as f32;
                let start = self.layout.places[part][axis] + ATLAS_GUTTER_PX;
                (start as f32 + across) / self.layout.size_px[axis] as f32
            };
            *uv = [place(0), place(1)];
        }
    }
}
