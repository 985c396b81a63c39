//! The last column of a page of objects: details. Pages without any end before it, as all did once.
//!
//! Per object: corners (varint, 0 without a detail); then per corner steps east, north and up in the page's units; groups
//! (varint), and per group its kind (u8, 8 added where three bytes of colour follow, 16 where it has a texture),
//! triangles (varint) and per triangle its corners as steps back from the first that was not named yet (0: that one).
//! Then, where a group has a texture, for each corner of such groups by number steps right and down in the atlas, in
//! 65535ths of its sides. After the last object of a page with textures the atlas follows.

use super::bytes::{Reader, Writer};
use super::error::PageFault;
use super::objects::{Units, height_units, metres};
use crate::content::{Detail, DetailCorner, FaceGroup, FaceKind, Prism};

/// Groups of one object; more colours nobody tells apart.
pub const DETAIL_GROUPS_MAX: usize = 256;
const KINDS: [FaceKind; 3] = [FaceKind::Wall, FaceKind::Roof, FaceKind::Other];
const COLORED: u8 = 8;
const TEXTURED: u8 = 16;
const UV_UNITS: f32 = 65535.0;

/// Writes the column; textures only where the page has an atlas. Says whether it wrote any.
pub(super) fn write<'a>(
    out: &mut Writer,
    units: &Units,
    prisms: impl Iterator<Item = &'a Prism> + Clone,
    has_atlas: bool,
) -> bool {
    if prisms.clone().all(|prism| prism.detail.is_none()) {
        return false;
    }
    let mut any = false;
    for prism in prisms {
        match &prism.detail {
            Some(detail) => any |= write_detail(out, units, prism, detail, has_atlas),
            None => out.varint(0),
        }
    }
    any
}

fn write_detail(out: &mut Writer, units: &Units, prism: &Prism, detail: &Detail, has_atlas: bool) -> bool {
    let (order, number) = by_first_use(detail);
    out.varint(order.len() as u64);
    let mut last = start(units, prism);
    for corner in order.iter().map(|&at| &detail.corners[at as usize]) {
        let [east, north] = units.pack([corner.lon_rad, corner.lat_rad]);
        let at = [east, north, height_units(corner.height_m)];
        (0..3).for_each(|axis| out.signed(at[axis].wrapping_sub(last[axis])));
        last = at;
    }
    if order.is_empty() {
        return false;
    }
    let has_uvs = has_atlas && detail.uvs.len() == detail.corners.len();
    let is_textured = |group: &FaceGroup| has_uvs && group.texture.is_some();
    let mut textured = vec![false; order.len()];
    let groups = &detail.groups[..detail.groups.len().min(DETAIL_GROUPS_MAX)];
    out.varint(groups.len() as u64);
    let mut next = 0;
    for group in groups {
        let kind = KINDS.iter().position(|kind| *kind == group.kind).unwrap_or(0) as u8;
        let colored = if group.color.is_some() { COLORED } else { 0 };
        out.u8(kind + colored + if is_textured(group) { TEXTURED } else { 0 });
        group.color.iter().for_each(|color| out.bytes(color));
        let whole = || group.triangles.iter().filter(|triangle| is_whole(detail, triangle));
        out.varint(whole().count() as u64);
        for at in whole().flatten().map(|&corner| number[corner as usize]) {
            out.varint(u64::from(next - at));
            next = next.max(at + 1);
            textured[at as usize] |= is_textured(group);
        }
    }
    let of_textured = order.iter().zip(&textured).filter(|(_, textured)| **textured);
    write_uvs(out, of_textured.map(|(&at, _)| detail.uvs[at as usize]));
    groups.iter().any(is_textured)
}

fn write_uvs(out: &mut Writer, uvs: impl Iterator<Item = [f32; 2]>) {
    let mut last = [0i64; 2];
    for uv in uvs {
        let at = uv.map(|part| (part.clamp(0.0, 1.0) * UV_UNITS).round() as i64);
        (0..2).for_each(|axis| out.signed(at[axis] - last[axis]));
        last = at;
    }
}

fn is_whole(detail: &Detail, triangle: &[u32; 3]) -> bool {
    triangle.iter().all(|&corner| (corner as usize) < detail.corners.len())
}

/// The corners that triangles use, in the order of their first use; and the place of each in it.
fn by_first_use(detail: &Detail) -> (Vec<u32>, Vec<u32>) {
    let mut number = vec![u32::MAX; detail.corners.len()];
    let mut order = Vec::new();
    let groups = detail.groups.iter().take(DETAIL_GROUPS_MAX);
    for &corner in groups.flat_map(|group| &group.triangles).filter(|t| is_whole(detail, t)).flatten() {
        let place = &mut number[corner as usize];
        if *place == u32::MAX {
            *place = order.len() as u32;
            order.push(corner);
        }
    }
    (order, number)
}

/// What an object's first corner is told from: the first of its outline, at the base.
fn start(units: &Units, prism: &Prism) -> [i64; 3] {
    let [east, north] = units.pack(prism.rings.iter().flatten().next().copied().unwrap_or_default());
    [east, north, height_units(prism.base_m)]
}

/// Reads the column; says whether it has textures, so that an atlas follows.
pub(super) fn read(reader: &mut Reader, units: &Units, prisms: &mut [Prism]) -> Result<bool, PageFault> {
    if reader.remaining() == 0 {
        return Ok(false);
    }
    for prism in prisms.iter_mut() {
        let corners = reader.count(3)?;
        if corners > 0 {
            prism.detail = Some(read_detail(reader, units, prism, corners)?);
        }
    }
    let groups = prisms.iter().filter_map(|prism| prism.detail.as_ref()).flat_map(|detail| &detail.groups);
    Ok(groups.into_iter().any(|group| group.texture.is_some()))
}

fn read_detail(reader: &mut Reader, units: &Units, prism: &Prism, corners: usize) -> Result<Detail, PageFault> {
    let mut detail = Detail { corners: Vec::with_capacity(corners), ..Detail::default() };
    let mut last = start(units, prism);
    for _ in 0..corners {
        for axis in &mut last {
            *axis = axis.wrapping_add(reader.signed()?);
        }
        let [lon_rad, lat_rad] = units.unpack([last[0], last[1]]);
        if lon_rad.abs() > 10.0 || lat_rad.abs() > 10.0 {
            return Err(PageFault::Malformed("a corner out of range"));
        }
        detail.corners.push(DetailCorner { lon_rad, lat_rad, height_m: metres(last[2])? });
    }
    let groups = reader.count(2)?;
    if groups > DETAIL_GROUPS_MAX {
        return Err(PageFault::Malformed("too many groups of faces"));
    }
    let mut next = 0;
    for _ in 0..groups {
        detail.groups.push(read_group(reader, corners as u64, &mut next)?);
    }
    read_uvs(reader, &mut detail)?;
    Ok(detail)
}

fn read_uvs(reader: &mut Reader, detail: &mut Detail) -> Result<(), PageFault> {
    let mut textured = vec![false; detail.corners.len()];
    let groups = detail.groups.iter().filter(|group| group.texture.is_some());
    groups.flat_map(|group| &group.triangles).flatten().for_each(|&at| textured[at as usize] = true);
    if detail.groups.iter().any(|group| group.texture.is_some()) {
        detail.uvs = vec![[0.0; 2]; detail.corners.len()];
    }
    let mut last = [0i64; 2];
    for (uv, _) in detail.uvs.iter_mut().zip(&textured).filter(|(_, textured)| **textured) {
        for (axis, part) in uv.iter_mut().enumerate() {
            last[axis] = last[axis].wrapping_add(reader.signed()?);
            let units = u16::try_from(last[axis]).map_err(|_| PageFault::Malformed("a texture beyond its atlas"))?;
            *part = f32::from(units) / UV_UNITS;
        }
    }
    Ok(())
}

fn read_group(reader: &mut Reader, corners: u64, next: &mut u64) -> Result<FaceGroup, PageFault> {
    let head = reader.u8()?;
    let kind =
        KINDS.get(usize::from(head & !(COLORED | TEXTURED))).ok_or(PageFault::Malformed("a face of no known kind"))?;
    let color = match head & COLORED {
        0 => None,
        _ => Some([reader.u8()?, reader.u8()?, reader.u8()?]),
    };
    let count = reader.count(3)?;
    let mut triangles = Vec::with_capacity(count);
    for _ in 0..count {
        let mut triangle = [0; 3];
        for corner in &mut triangle {
            let at = next.checked_sub(reader.varint()?).filter(|at| *at < corners);
            let at = at.ok_or(PageFault::Malformed("a face beyond its corners"))?;
            *next = (*next).max(at + 1);
            *corner = at as u32;
        }
        triangles.push(triangle);
    }
    let texture = (head & TEXTURED != 0).then_some(0);
    Ok(FaceGroup { kind: *kind, color, texture, triangles })
}
