//! Pages of objects: prisms by columns, footprints in units of the root cell's sides, zstd; the attributes apart, so
//! that only those who ask unpack them.
//!
//! Body: unpacked and packed length of the shapes and unpacked length of the attributes (varints), the shapes, the
//! attributes. Shapes, unpacked: `error_m` (f32), objects (varint), bits of the units east and north (u8 each), then
//! columns: cells (steps in ordinals), ids, rings and their lengths, coordinates, roofs, heights in centimetres,
//! colours, and details where there are any, with the length of their atlas (varint) and its JPEG where they have
//! textures. Attributes, unpacked: per object its length and its text.

use super::atlas::decode_atlas;
use super::bytes::{Reader, Writer};
use super::details;
use super::error::{EncodeError, PageFault};
use super::frame::{self, Framed};
use crate::content::{ObjectMesh, ObjectPage, PageId, PageKind, Prism};
use crate::forest::CellId;

/// Units of footprints may be this part of the page's error, where that is more than [`FOOTPRINT_UNIT_MAX_M`].
pub const FOOTPRINT_UNIT_PER_ERROR: f64 = 1.0 / 64.0;
/// Footprints of the finest rep are stored in units no larger than this, metres.
pub const FOOTPRINT_UNIT_MAX_M: f64 = 0.01;
/// Heights are stored in units of this, metres.
pub const OBJECT_HEIGHT_UNIT_M: f64 = 0.01;
const HEIGHT_MAX_M: f64 = 1_000_000.0;

/// A page's prisms as stored, ordered by cell.
#[derive(Clone, Debug, PartialEq)]
pub struct PrismPage {
    pub root: CellId,
    pub collection: u8,
    pub rep: u8,
    /// Bounds the distance between what is drawn and the source's shape, metres.
    pub error_m: f32,
    pub prisms: Vec<Prism>,
    /// The pictures on their details, as JPEG; without it these are stored in plain colours.
    pub atlas: Option<Vec<u8>>,
}

impl PrismPage {
    pub fn id(&self) -> PageId {
        PageId { cell: self.root, kind: PageKind::Objects { collection: self.collection, rep: self.rep } }
    }
}

/// The root cell's sides in powers of two.
#[derive(Clone, Copy)]
pub(super) struct Units {
    origin: [f64; 2],
    unit_rad: [f64; 2],
    bits: [u8; 2],
}

const BITS_MAX: u8 = 40;

impl Units {
    fn of(root: CellId, error_m: f32) -> Self {
        let sides = root.sides_m();
        let unit_m = FOOTPRINT_UNIT_MAX_M.max(f64::from(error_m) * FOOTPRINT_UNIT_PER_ERROR);
        let bits = [sides.south_m.max(sides.north_m), sides.height_m]
            .map(|side_m| (side_m / unit_m).log2().ceil().clamp(0.0, f64::from(BITS_MAX)) as u8);
        Self::with_bits(root, bits)
    }

    fn with_bits(root: CellId, bits: [u8; 2]) -> Self {
        let bounds = root.bounds();
        let unit = |extent_rad: f64, bits: u8| extent_rad / (1u64 << bits) as f64;
        Self {
            origin: [bounds.west_rad, bounds.south_rad],
            unit_rad: [unit(bounds.width_rad(), bits[0]), unit(bounds.height_rad(), bits[1])],
            bits,
        }
    }

    pub fn pack(&self, corner: [f64; 2]) -> [i64; 2] {
        std::array::from_fn(|axis| ((corner[axis] - self.origin[axis]) / self.unit_rad[axis]).round() as i64)
    }

    pub fn unpack(&self, units: [i64; 2]) -> [f64; 2] {
        std::array::from_fn(|axis| self.origin[axis] + units[axis] as f64 * self.unit_rad[axis])
    }
}

/// Writes prisms, put in order of their cells (those of one cell stay as given), with a JSON text for each or none at
/// all.
pub fn encode_objects(page: &PrismPage, attributes: &[String]) -> Result<Vec<u8>, EncodeError> {
    let count = page.prisms.len();
    if count > ObjectPage::OBJECTS_MAX {
        return Err(EncodeError::TooManyObjects(count));
    }
    if !attributes.is_empty() && attributes.len() != count {
        return Err(EncodeError::Attributes { objects: count, attributes: attributes.len() });
    }
    if let Some(prism) = page.prisms.iter().find(|prism| !page.root.contains(prism.cell)) {
        return Err(EncodeError::Outside(prism.cell));
    }
    let mut order: Vec<usize> = (0..count).collect();
    order.sort_by_key(|&at| page.prisms[at].cell);
    let shapes = shapes(page, &order);
    let mut texts = Writer::default();
    for text in order.iter().filter_map(|&at| attributes.get(at)) {
        texts.varint(text.len() as u64);
        texts.bytes(text.as_bytes());
    }
    let packed = frame::pack(&shapes);
    let mut body = Writer::default();
    body.varint(shapes.len() as u64);
    body.varint(packed.len() as u64);
    body.varint(texts.0.len() as u64);
    body.bytes(&packed);
    body.bytes(&frame::pack(&texts.0));
    frame::frame(page.id(), &body.0, body.0.len())
}

fn shapes(page: &PrismPage, order: &[usize]) -> Vec<u8> {
    let prisms = || order.iter().map(|&at| &page.prisms[at]);
    let units = Units::of(page.root, page.error_m);
    let mut out = Writer::default();
    out.f32(page.error_m);
    out.varint(order.len() as u64);
    out.bytes(&units.bits);
    let mut last = page.root.to_u64();
    for prism in prisms() {
        out.varint(prism.cell.to_u64() - last);
        last = prism.cell.to_u64();
    }
    let mut last = 0;
    for prism in prisms() {
        out.signed(i64::from(prism.id) - last);
        last = i64::from(prism.id);
    }
    for prism in prisms() {
        out.varint(prism.rings.len() as u64);
        prism.rings.iter().for_each(|ring| out.varint(ring.len() as u64));
    }
    let mut last = [0; 2];
    for &corner in prisms().flat_map(|prism| &prism.rings).flatten() {
        let at = units.pack(corner);
        out.signed(at[0].wrapping_sub(last[0]));
        out.signed(at[1].wrapping_sub(last[1]));
        last = at;
    }
    for prism in prisms() {
        out.varint(prism.roof.len() as u64);
        prism.roof.iter().flatten().for_each(|&corner| out.varint(u64::from(corner)));
    }
    let mut last = 0;
    for prism in prisms() {
        let base = height_units(prism.base_m);
        out.signed(base.wrapping_sub(last));
        out.signed(height_units(prism.top_m).wrapping_sub(base));
        out.signed(height_units(prism.foundation_m));
        last = base;
    }
    for prism in prisms() {
        out.bytes(&prism.wall_color);
        out.bytes(&prism.roof_color);
    }
    if details::write(&mut out, &units, prisms(), page.atlas.is_some())
        && let Some(atlas) = &page.atlas
    {
        out.varint(atlas.len() as u64);
        out.bytes(atlas);
    }
    out.0
}

pub(super) fn height_units(height_m: f32) -> i64 {
    (f64::from(height_m) / OBJECT_HEIGHT_UNIT_M).round() as i64
}

pub(super) fn metres(units: i64) -> Result<f32, PageFault> {
    let metres = units as f64 * OBJECT_HEIGHT_UNIT_M;
    if metres.abs() <= HEIGHT_MAX_M { Ok(metres as f32) } else { Err(PageFault::Malformed("a height out of range")) }
}

/// The sections of a body.
struct Sections<'a> {
    shapes: &'a [u8],
    shapes_len: usize,
    texts: &'a [u8],
    texts_len: usize,
}

fn sections<'a>(framed: &Framed<'a>) -> Result<Sections<'a>, PageFault> {
    if framed.unpacked != framed.body.len() {
        return Err(PageFault::Malformed("a length that does not match"));
    }
    let mut reader = Reader::new(framed.body);
    let shapes_len = reader.varint()? as usize;
    let packed = reader.varint()? as usize;
    let texts_len = reader.varint()? as usize;
    let shapes = reader.take(packed)?;
    let texts = reader.take(reader.remaining())?;
    Ok(Sections { shapes, shapes_len, texts, texts_len })
}

fn open_objects(page: &[u8]) -> Result<Framed<'_>, PageFault> {
    let framed = frame::open(page)?;
    match framed.id.kind {
        PageKind::Objects { .. } => Ok(framed),
        _ => Err(PageFault::WrongPage),
    }
}

/// The prisms of a page of objects.
pub fn decode_prisms(page: &[u8]) -> Result<PrismPage, PageFault> {
    decode_framed(&open_objects(page)?)
}

/// The page as it is drawn.
pub fn decode_objects(page: &[u8]) -> Result<(ObjectPage, ObjectMesh), PageFault> {
    drawn_up(decode_prisms(page)?)
}

/// A page of prisms as it is drawn.
pub(super) fn drawn_up(page: PrismPage) -> Result<(ObjectPage, ObjectMesh), PageFault> {
    let (drawn, mut mesh) = ObjectPage::from_prisms(page.root, page.collection, page.rep, page.error_m, page.prisms);
    mesh.atlas = page.atlas.as_deref().map(decode_atlas).transpose()?;
    Ok((drawn, mesh))
}

/// The JSON texts of a page's objects, in the order of the decoded page; none where none were stored.
pub fn decode_attributes(page: &[u8]) -> Result<Vec<String>, PageFault> {
    let framed = open_objects(page)?;
    let sections = sections(&framed)?;
    let plain = frame::unpack(sections.texts, sections.texts_len)?;
    let mut reader = Reader::new(&plain);
    let mut texts = Vec::new();
    while reader.remaining() > 0 {
        let len = reader.count(1)?;
        let text =
            std::str::from_utf8(reader.take(len)?).map_err(|_| PageFault::Malformed("a text that is not UTF-8"))?;
        texts.push(text.to_owned());
    }
    Ok(texts)
}

pub(super) fn decode_framed(framed: &Framed) -> Result<PrismPage, PageFault> {
    let PageKind::Objects { collection, rep } = framed.id.kind else {
        return Err(PageFault::WrongPage);
    };
    let sections = sections(framed)?;
    let plain = frame::unpack(sections.shapes, sections.shapes_len)?;
    let mut reader = Reader::new(&plain);
    let error_m = reader.f32()?;
    let (prisms, has_textures) = decode_shapes(&mut reader, framed.id.cell)?;
    let atlas = if has_textures { Some(atlas_of(&mut reader)?) } else { None };
    reader.finish()?;
    Ok(PrismPage { root: framed.id.cell, collection, rep, error_m, prisms, atlas })
}

/// What an object takes at least: a byte each for cell, id, rings, roof and three heights, and six for colours.
const OBJECT_BYTES_MIN: usize = 13;

fn atlas_of(reader: &mut Reader) -> Result<Vec<u8>, PageFault> {
    let len = reader.count(1)?;
    Ok(reader.take(len)?.to_vec())
}

/// The prisms, and whether textures lie on them.
fn decode_shapes(reader: &mut Reader, root: CellId) -> Result<(Vec<Prism>, bool), PageFault> {
    let count = reader.count(OBJECT_BYTES_MIN)?;
    if count > ObjectPage::OBJECTS_MAX {
        return Err(PageFault::Malformed("too many objects"));
    }
    let bits = [reader.u8()?, reader.u8()?];
    if bits.iter().any(|&bits| bits > BITS_MAX) {
        return Err(PageFault::Malformed("units too small"));
    }
    let units = Units::with_bits(root, bits);
    let mut prisms = Vec::with_capacity(count);
    let mut last = root.to_u64();
    for _ in 0..count {
        last = last.checked_add(reader.varint()?).ok_or(PageFault::Malformed("a cell out of range"))?;
        let cell = CellId::from_u64(last).filter(|&cell| root.contains(cell));
        prisms.push(blank(cell.ok_or(PageFault::Malformed("a cell outside of the page's"))?));
    }
    let mut last = 0i64;
    for prism in &mut prisms {
        last = last.wrapping_add(reader.signed()?);
        prism.id = u32::try_from(last).map_err(|_| PageFault::Malformed("an object's number out of range"))?;
    }
    let mut budget = reader.remaining() / 2;
    for prism in &mut prisms {
        decode_ring_lengths(reader, prism, &mut budget)?;
    }
    decode_corners(reader, &units, &mut prisms)?;
    for prism in &mut prisms {
        decode_roof(reader, prism)?;
    }
    decode_heights(reader, &mut prisms)?;
    for prism in &mut prisms {
        let colors = reader.take(6)?;
        prism.wall_color.copy_from_slice(&colors[..3]);
        prism.roof_color.copy_from_slice(&colors[3..]);
    }
    let has_textures = details::read(reader, &units, &mut prisms)?;
    Ok((prisms, has_textures))
}

fn blank(cell: CellId) -> Prism {
    Prism {
        id: 0,
        cell,
        rings: Vec::new(),
        roof: Vec::new(),
        base_m: 0.0,
        top_m: 0.0,
        foundation_m: 0.0,
        wall_color: [0; 3],
        roof_color: [0; 3],
        detail: None,
    }
}

/// Makes room for the rings; `budget` is how many corners the bytes further on can hold, at two bytes each.
fn decode_ring_lengths(reader: &mut Reader, prism: &mut Prism, budget: &mut usize) -> Result<(), PageFault> {
    for _ in 0..reader.count(1)? {
        let len = reader.count(2)?;
        *budget = budget.checked_sub(len).ok_or(PageFault::Malformed("more corners than bytes"))?;
        prism.rings.push(vec![[0.0; 2]; len]);
    }
    Ok(())
}

fn decode_corners(reader: &mut Reader, units: &Units, prisms: &mut [Prism]) -> Result<(), PageFault> {
    let mut last = [0i64; 2];
    for corner in prisms.iter_mut().flat_map(|prism| &mut prism.rings).flatten() {
        for axis in &mut last {
            *axis = axis.wrapping_add(reader.signed()?);
        }
        *corner = units.unpack(last);
        // Nothing that lives in a cell reaches further than round the Earth.
        if corner.iter().any(|radians| radians.abs() > 10.0) {
            return Err(PageFault::Malformed("a corner out of range"));
        }
    }
    Ok(())
}

fn decode_roof(reader: &mut Reader, prism: &mut Prism) -> Result<(), PageFault> {
    let corners: usize = prism.rings.iter().map(Vec::len).sum();
    let triangles = reader.count(3)?;
    prism.roof = Vec::with_capacity(triangles);
    for _ in 0..triangles {
        let mut triangle = [0u16; 3];
        for corner in &mut triangle {
            let at = reader.varint()?;
            if at >= corners as u64 {
                return Err(PageFault::Malformed("a roof beyond its corners"));
            }
            *corner = u16::try_from(at).map_err(|_| PageFault::Malformed("a roof of too many corners"))?;
        }
        prism.roof.push(triangle);
    }
    Ok(())
}

fn decode_heights(reader: &mut Reader, prisms: &mut [Prism]) -> Result<(), PageFault> {
    let mut base = 0i64;
    for prism in prisms {
        base = base.wrapping_add(reader.signed()?);
        prism.base_m = metres(base)?;
        prism.top_m = metres(base.wrapping_add(reader.signed()?))?;
        prism.foundation_m = metres(reader.signed()?)?;
    }
    Ok(())
}
