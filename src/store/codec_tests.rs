//! Pages survive their bytes; bytes that were harmed give an error.

use super::*;
use crate::content::rtin::{Active, Diagonal, Triangle};
use crate::content::{
    Detail, DetailCorner, FaceGroup, FaceKind, IMAGERY_STORED_PX, Look, ObjectVertex, Prism, TerrainPage, TerrainPost,
};
use crate::forest::{CellId, Zone};
use proptest::prelude::*;

fn terrain(cell: CellId, active: &Active, height: impl Fn(f64, f64) -> f64, error_m: f32) -> TerrainPage {
    let posts = active.posts().map(|(column, row)| {
        let height_m = height(f64::from(column), f64::from(row));
        TerrainPost {
            column,
            row,
            height_m: height_m as f32,
            parent_height_m: (height_m + f64::from(row % 3)) as f32,
            slope: [(column % 100) as i8 - 50, (row % 50) as i8],
        }
    });
    let mut page = TerrainPage::from_posts(cell, error_m, posts.collect()).unwrap();
    page.quantize(height_step_m(error_m));
    page
}

fn rough(cell: CellId) -> TerrainPage {
    let noise = |x: f64, y: f64| (x * 12.9898 + y * 78.233).sin() * 43758.5453 % 40.0;
    terrain(cell, &Active::full(), |x, y| 500.0 + 200.0 * (x / 9.0).sin() * (y / 7.0).cos() + noise(x, y), 4.0)
}

fn flat(cell: CellId) -> TerrainPage {
    let active = Active::corners();
    let posts = active.posts().map(|(column, row)| TerrainPost {
        column,
        row,
        height_m: 0.0,
        parent_height_m: 0.0,
        slope: [0; 2],
    });
    TerrainPage::from_posts(cell, 0.2, posts.collect()).unwrap()
}

fn cell() -> CellId {
    CellId::containing(0.66, -2.13, 13)
}

fn prisms(root: CellId) -> Vec<Prism> {
    let child = root.children().last().unwrap();
    let at = child.bounds().center();
    let side = root.bounds().height_rad() * 0.03;
    let corner = |x: f64, y: f64| [at.lon_rad + x * side, at.lat_rad + y * side];
    let prism = |id: u32, cell: CellId, shift: f64| Prism {
        id,
        cell,
        rings: vec![
            vec![corner(shift, 0.0), corner(shift + 1.0, 0.1), corner(shift + 1.0, 1.0), corner(shift, 1.0)],
            vec![corner(shift + 0.2, 0.2), corner(shift + 0.2, 0.4), corner(shift + 0.4, 0.4)],
        ],
        roof: vec![[0, 1, 4], [1, 2, 6], [2, 3, 5]],
        base_m: 12.34,
        top_m: 45.67,
        foundation_m: 1.5,
        wall_color: [200, 190, id as u8],
        roof_color: [90, 80, 70],
        detail: None,
    };
    vec![prism(7, child, 0.0), prism(3, root, 2.0), prism(900_000, child, 4.0)]
}

fn object_page() -> Vec<u8> {
    let page = PrismPage { root: cell(), collection: 2, rep: 0, error_m: 0.02, prisms: prisms(cell()), atlas: None };
    let texts = ["{\"a\":1}", "{}", "{\"name\":\"Å\"}"].map(String::from);
    encode_objects(&page, &texts).unwrap()
}

#[test]
fn terrain_survives_and_flat_sea_takes_tens_of_bytes() {
    for page in [rough(cell()), flat(cell()), rough(Zone::all().next().unwrap().root())] {
        let bytes = encode_terrain(&page, height_step_m(page.error_m)).unwrap();
        assert_eq!(decode_terrain(&bytes, page.cell), Ok(page.clone()));
        if page.posts.len() == 4 {
            assert!(bytes.len() < 64, "{}", bytes.len());
        }
    }
    let smooth = terrain(cell(), &Active::full(), |x, y| 100.0 * (x / 20.0).sin() * (y / 17.0).cos(), 4.0);
    let bytes = encode_terrain(&smooth, 0.5).unwrap();
    assert!(bytes.len() < 12_000, "{}", bytes.len());
}

#[test]
fn imagery_survives_within_what_jpeg_keeps() {
    let side = IMAGERY_STORED_PX as usize;
    let rgb: Vec<u8> = (0..side * side).flat_map(|at| [(at % side / 2) as u8, (at / side / 2) as u8, 128]).collect();
    let bytes = encode_imagery(cell(), &rgb, JPEG_QUALITY).unwrap();
    let page = decode_imagery(&bytes, cell()).unwrap();
    let sides: Vec<_> = page.mips.iter().map(|mip| (mip.len() / 4).isqrt()).collect();
    assert_eq!(sides, [258, 129, 64, 32, 16, 8, 4, 2, 1]);
    for (texel, source) in page.mips[0].chunks_exact(4).zip(rgb.chunks_exact(3)) {
        assert!((0..3).all(|c| texel[c].abs_diff(source[c]) < 12) && texel[3] == 255);
    }
    assert!(matches!(encode_imagery(cell(), &rgb[3..], 85), Err(EncodeError::PictureSize { .. })));
    assert_eq!(decode_imagery(&bytes, cell().parent().unwrap()), Err(PageFault::WrongPage));
    assert_eq!(decode_terrain(&bytes, cell()), Err(PageFault::WrongPage));
}

#[test]
fn objects_survive_within_their_units() {
    let bytes = object_page();
    let page = decode_prisms(&bytes).unwrap();
    assert_eq!((page.root, page.collection, page.rep, page.error_m), (cell(), 2, 0, 0.02));
    // Ordered by cell; those of one cell as given.
    assert_eq!(page.prisms.iter().map(|prism| prism.id).collect::<Vec<_>>(), [3, 7, 900_000]);
    assert_eq!(decode_attributes(&bytes).unwrap(), ["{}", "{\"a\":1}", "{\"name\":\"Å\"}"]);
    let mut sources = prisms(cell());
    sources.sort_by_key(|prism| prism.cell);
    for (read, source) in page.prisms.iter().zip(&sources) {
        assert_eq!((&read.roof, read.cell, read.wall_color), (&source.roof, source.cell, source.wall_color));
        assert!((read.base_m - source.base_m).abs() < 0.006 && (read.top_m - source.top_m).abs() < 0.006);
        for (a, b) in read.rings.iter().flatten().zip(source.rings.iter().flatten()) {
            assert!((0..2).all(|axis| (a[axis] - b[axis]).abs() * 6.4e6 <= FOOTPRINT_UNIT_MAX_M / 2.0 * 1.6));
        }
    }
    let (drawn, mesh) = decode_objects(&bytes).unwrap();
    assert_eq!(drawn.cells.iter().map(|c| c.objects.clone()).collect::<Vec<_>>(), [0..1, 1..3]);
    assert_eq!(drawn.indices_of(0..3), 0..mesh.indices.len() as u32);
    // Seven walls and three triangles of roof each.
    assert_eq!(mesh.indices.len(), 3 * 3 * (7 * 2 + 3));
}

#[test]
fn walls_and_roofs_face_outwards() {
    let (page, mesh) = decode_objects(&object_page()).unwrap();
    for object in &page.objects {
        let enu = crate::geodesy::Geodetic::from_ecef(object.place).ecef_from_enu().inverse().rotation();
        for t in mesh.indices[object.indices.start as usize..object.indices.end as usize].chunks_exact(3) {
            let corner = |i: usize| glam::Vec3::from(mesh.vertices[t[i] as usize].position_m).as_dvec3();
            let normal = enu * (corner(1) - corner(0)).cross(corner(2) - corner(0)).normalize();
            let vertex = mesh.vertices[t[0] as usize];
            assert_eq!(vertex.is_wall(), normal.z.abs() < 0.99);
            if vertex.is_wall() || normal.z > 0.0 {
                assert!(normal.dot(vertex.normal()) > 0.999, "{normal} {}", vertex.normal());
            }
        }
    }
    let whole = page.objects.iter().find(|object| object.id == 7).unwrap();
    assert!((whole.dimension_m - 33.33).abs() < 0.1 || whole.dimension_m >= whole.reach_m);
}

/// Every way to harm a page gives an error and neither a panic nor another page.
fn harm(bytes: &[u8], decode: &dyn Fn(&[u8]) -> Result<(), PageFault>) {
    assert_eq!(decode(bytes), Ok(()));
    for at in 0..bytes.len() {
        for flip in [1, 0x80, 0xff] {
            let mut harmed = bytes.to_vec();
            harmed[at] ^= flip;
            assert!(decode(&harmed).is_err(), "byte {at} ^ {flip}");
        }
        assert!(decode(&bytes[..at]).is_err(), "{at} bytes");
    }
    let mut longer = bytes.to_vec();
    longer.push(0);
    assert!(decode(&longer).is_err());
}

#[test]
fn a_harmed_page_is_an_error() {
    let small = encode_terrain(&flat(cell()), 0.025).unwrap();
    harm(&small, &|bytes| decode_terrain(bytes, cell()).map(drop));
    harm(&object_page(), &|bytes| decode_objects(bytes).map(drop));
    let grey = vec![99; (IMAGERY_STORED_PX * IMAGERY_STORED_PX * 3) as usize];
    harm(&encode_imagery(cell(), &grey, 50).unwrap(), &|bytes| decode_imagery(bytes, cell()).map(drop));
    let mut future = small.clone();
    future[4] = 2;
    assert_eq!(decode_terrain(&future, cell()), Err(PageFault::FutureVersion(2)));
}

/// A page with a right checksum over any body.
fn forged(kind: PageKind, body: &[u8], unpacked: usize) -> Vec<u8> {
    frame::frame(PageId { cell: cell(), kind }, body, unpacked).unwrap()
}

#[test]
fn hostile_lengths_allocate_nothing() {
    let objects = PageKind::Objects { collection: 0, rep: 0 };
    let huge = frame::pack(&vec![0; 1 << 20]).into_owned();
    for kind in [PageKind::Terrain, PageKind::Imagery, objects] {
        for unpacked in [0, 5, 1 << 20, 64 << 20] {
            let id = PageId { cell: cell(), kind };
            assert!(decode_page(id, &forged(kind, &huge, unpacked)).is_err());
        }
    }
    assert!(frame::frame(PageId { cell: cell(), kind: objects }, &[], (64 << 20) + 1).is_err());
    let mut shapes = bytes::Writer::default();
    shapes.f32(0.0);
    shapes.varint(1 << 40);
    shapes.bytes(&[0; 40]);
    let mut body = bytes::Writer::default();
    for len in [shapes.0.len(), shapes.0.len(), 0] {
        body.varint(len as u64);
    }
    body.bytes(&shapes.0);
    assert!(matches!(decode_prisms(&forged(objects, &body.0, body.0.len())), Err(PageFault::Malformed(_))));
}

/// A gabled roof over each of the prisms, with colours of its own, and a window.
fn with_details(mut prisms: Vec<Prism>) -> Vec<Prism> {
    for prism in prisms.iter_mut().filter(|prism| prism.id != 3) {
        let ring = prism.rings[0].clone();
        let corner = |at: [f64; 2], height_m: f32| DetailCorner { lon_rad: at[0], lat_rad: at[1], height_m };
        let middle = |a: [f64; 2], b: [f64; 2]| [(a[0] + b[0]) / 2.0, (a[1] + b[1]) / 2.0];
        let mut corners: Vec<_> = ring.iter().map(|&at| corner(at, 12.34)).collect();
        corners.extend(ring.iter().map(|&at| corner(at, 30.0)));
        corners.extend([corner(middle(ring[0], ring[3]), 45.67), corner(middle(ring[1], ring[2]), 45.67)]);
        let walls = [
            [0, 1, 5],
            [0, 5, 4],
            [1, 2, 6],
            [1, 6, 5],
            [2, 3, 7],
            [2, 7, 6],
            [3, 0, 4],
            [3, 4, 7],
            [4, 8, 7],
            [5, 6, 9],
        ];
        let roofs = [[4, 5, 9], [4, 9, 8], [6, 7, 8], [6, 8, 9]];
        prism.detail = Some(Detail {
            corners,
            uvs: Vec::new(),
            groups: vec![
                FaceGroup { kind: FaceKind::Wall, color: None, texture: None, triangles: walls.to_vec() },
                FaceGroup {
                    kind: FaceKind::Roof,
                    color: Some([200, 30, 20]),
                    texture: None,
                    triangles: roofs.to_vec(),
                },
                FaceGroup { kind: FaceKind::Other, color: None, texture: None, triangles: vec![[0, 1, 5]] },
            ],
        });
    }
    prisms
}

fn detailed_page() -> Vec<u8> {
    let prisms = with_details(prisms(cell()));
    encode_objects(&PrismPage { root: cell(), collection: 0, rep: 0, error_m: 0.02, prisms, atlas: None }, &[]).unwrap()
}

type Faces = (FaceKind, Option<[u8; 3]>, Vec<[DetailCorner; 3]>);

/// Positions of a detail's triangles, group by group.
fn faces(detail: &Detail) -> Vec<Faces> {
    let corner = |at: u32| detail.corners[at as usize];
    let group = |group: &FaceGroup| (group.kind, group.color, group.triangles.iter().map(|t| t.map(corner)).collect());
    detail.groups.iter().map(group).collect()
}

#[test]
fn details_survive_within_their_units() {
    let bytes = detailed_page();
    let page = decode_prisms(&bytes).unwrap();
    let mut sources = with_details(prisms(cell()));
    sources.sort_by_key(|prism| prism.cell);
    assert_eq!(page.prisms.iter().map(|prism| prism.detail.is_some()).collect::<Vec<_>>(), [false, true, true]);
    for (read, source) in page.prisms.iter().zip(&sources) {
        let (Some(read), Some(source)) = (&read.detail, &source.detail) else { continue };
        for ((kind, color, read), (source_kind, source_color, source)) in faces(read).iter().zip(&faces(source)) {
            assert_eq!((kind, color, read.len()), (source_kind, source_color, source.len()));
            for (a, b) in read.iter().flatten().zip(source.iter().flatten()) {
                let off = [a.lon_rad - b.lon_rad, a.lat_rad - b.lat_rad].map(|rad| rad.abs() * 6.4e6);
                assert!(
                    off.iter().all(|&m| m <= FOOTPRINT_UNIT_MAX_M / 2.0 * 1.6)
                        && (a.height_m - b.height_m).abs() < 0.006
                );
            }
        }
    }
    // A page without details is the same as ever, and those that have one draw it, over their foundations.
    assert!(decode_prisms(&object_page()).unwrap().prisms.iter().all(|prism| prism.detail.is_none()));
    let (drawn, mesh) = decode_objects(&bytes).unwrap();
    assert_eq!(drawn.objects[1].indices.len(), 3 * (7 * 2 + 15));
    // Two looks each: the roof's colour, and the walls' for what is neither.
    assert_eq!(drawn.looks.len(), 4);
    assert_eq!(drawn.looks[0], Look { object: 1, wall_color: sources[1].wall_color, roof_color: [200, 30, 20] });
    assert_eq!(drawn.looks[1].roof_color, sources[1].wall_color);
    let last = mesh.vertices.iter().map(|vertex| usize::from(vertex.look)).max();
    assert_eq!(last, Some(drawn.objects.len() + drawn.looks.len() - 1));
}

/// A page with right lengths and checksum over any shapes.
fn forged_shapes(shapes: &[u8]) -> Vec<u8> {
    let mut body = bytes::Writer::default();
    for len in [shapes.len(), shapes.len(), 0] {
        body.varint(len as u64);
    }
    body.bytes(shapes);
    forged(PageKind::Objects { collection: 0, rep: 0 }, &body.0, body.0.len())
}

/// The shapes of a page, unpacked.
fn shapes_of(page: &[u8]) -> Vec<u8> {
    let framed = frame::open(page).unwrap();
    let mut reader = bytes::Reader::new(framed.body);
    let [unpacked, packed, _] = [0; 3].map(|_| reader.varint().unwrap() as usize);
    frame::unpack(reader.take(packed).unwrap(), unpacked).unwrap().into_owned()
}

#[test]
fn harmed_details_under_a_right_checksum_do_no_harm() {
    let shapes = shapes_of(&detailed_page());
    let plain = shapes_of(
        &encode_objects(
            &PrismPage { root: cell(), collection: 0, rep: 0, error_m: 0.02, prisms: prisms(cell()), atlas: None },
            &[],
        )
        .unwrap(),
    );
    assert!(decode_objects(&forged_shapes(&shapes)).is_ok());
    // The column may be absent, but not be cut.
    for len in plain.len()..shapes.len() {
        assert_eq!(decode_objects(&forged_shapes(&shapes[..len])).is_ok(), len == plain.len(), "{len} bytes");
    }
    for at in plain.len()..shapes.len() {
        for flip in [1, 2, 4, 8, 0x40, 0x80, 0xff] {
            let mut harmed = shapes.clone();
            harmed[at] ^= flip;
            let _ = decode_objects(&forged_shapes(&harmed));
        }
    }
    // Counts far beyond the bytes: corners, groups, triangles.
    let huge = [0xff, 0xff, 0xff, 0xff, 0x0f];
    let heads: [&[u8]; 3] = [&[0], &[0, 1, 0, 0, 0], &[0, 1, 0, 0, 0, 1, 0]];
    for head in heads {
        let forged = forged_shapes(&[&plain, head, &huge, &[0; 64]].concat());
        assert!(matches!(decode_objects(&forged), Err(PageFault::Malformed(_))), "{head:?}");
    }
}

#[test]
fn a_harmed_page_of_details_is_an_error() {
    harm(&detailed_page(), &|bytes| decode_objects(bytes).map(drop));
}

proptest! {
    #[test]
    fn any_details_give_an_error_or_a_page(tail in proptest::collection::vec(0u8..12, 0..300)) {
        let plain = shapes_of(&object_page());
        let _ = decode_objects(&forged_shapes(&[plain, tail].concat()));
    }

    #[test]
    fn normals_are_good_to_a_degree_and_a_half(x in -1.0..1.0f64, y in -1.0..1.0f64, z in -1.0..1.0f64, wall: bool) {
        let normal = glam::DVec3::new(x, y, z);
        prop_assume!(normal.length() > 0.01);
        let vertex = ObjectVertex { position_m: [0.0; 3], look: 0, facing: ObjectVertex::facing(normal, !wall) };
        prop_assert!(vertex.normal().dot(normal.normalize()) > 1.5f64.to_radians().cos(), "{normal} {}", vertex.normal());
        prop_assert_eq!(vertex.is_wall(), wall);
    }

    #[test]
    fn any_bytes_under_a_right_checksum_give_an_error_or_a_page(body in proptest::collection::vec(any::<u8>(), 0..300), kind in 0..3) {
        let kind = [PageKind::Terrain, PageKind::Imagery, PageKind::Objects { collection: 0, rep: 0 }][kind as usize];
        let _ = decode_page(PageId { cell: cell(), kind }, &forged(kind, &body, body.len()));
    }

    #[test]
    fn any_shapes_give_an_error_or_a_page(tail in proptest::collection::vec(0u8..12, 0..200)) {
        let mut shapes = vec![0, 0, 0, 0];
        shapes.extend(&tail);
        let mut body = bytes::Writer::default();
        for len in [shapes.len(), shapes.len(), 0] {
            body.varint(len as u64);
        }
        body.bytes(&shapes);
        let _ = decode_objects(&forged(PageKind::Objects { collection: 0, rep: 0 }, &body.0, body.0.len()));
    }

    #[test]
    fn any_network_survives(seed in proptest::collection::vec(any::<u16>(), 0..30), error_m in 0.0..100.0f32, level in 0u8..=22) {
        let cell = CellId::containing(-0.3, 2.0, level);
        let diagonal = Diagonal::of(cell);
        let mut split = vec![false; crate::content::rtin::TRIANGLE_COUNT];
        seed.iter().filter_map(|&s| Triangle::new(usize::from(s) % crate::content::rtin::TRIANGLE_COUNT)).for_each(|t| split[t.index()] = true);
        let active = Active::from_split(diagonal, &split);
        let page = terrain(cell, &active, |x, y| x * 31.7 - y * 91.3, error_m);
        let bytes = encode_terrain(&page, height_step_m(error_m)).unwrap();
        prop_assert_eq!(decode_terrain(&bytes, cell), Ok(page));
    }
}

/// The detailed page with a texture on the roofs.
fn textured_page() -> Vec<u8> {
    let mut prisms = with_details(prisms(cell()));
    for detail in prisms.iter_mut().filter_map(|prism| prism.detail.as_mut()) {
        detail.uvs = (0..detail.corners.len()).map(|at| [at as f32 / 20.0, 1.0 - at as f32 / 30.0]).collect();
        detail.groups[1].texture = Some(0);
    }
    let rgb: Vec<u8> = (0..32 * 16 * 3).map(|at| (at * 7 % 251) as u8).collect();
    let atlas = Some(encode_atlas(32, 16, &rgb, 85).unwrap());
    encode_objects(&PrismPage { root: cell(), collection: 0, rep: 0, error_m: 0.02, prisms, atlas }, &[]).unwrap()
}

#[test]
fn textures_survive_and_without_an_atlas_there_are_none() {
    let bytes = textured_page();
    let page = decode_prisms(&bytes).unwrap();
    let detail = page.prisms[1].detail.as_ref().unwrap();
    assert_eq!(detail.groups.iter().map(|group| group.texture).collect::<Vec<_>>(), [None, Some(0), None]);
    // Corners keep their order of first use: those of the roofs are 4 to 9 of the source.
    let mut roofs: Vec<[f32; 2]> =
        detail.groups[1].triangles.iter().flatten().map(|&at| detail.uvs[at as usize]).collect();
    roofs.sort_by(|a, b| a[0].total_cmp(&b[0]));
    roofs.dedup();
    for (at, uv) in (4..10).zip(&roofs) {
        let expected = [at as f32 / 20.0, 1.0 - at as f32 / 30.0];
        assert!((0..2).all(|axis| (uv[axis] - expected[axis]).abs() < 1e-5), "{uv:?} {expected:?}");
    }
    assert_eq!(roofs.len(), 6);
    let (_, mesh) = decode_objects(&bytes).unwrap();
    let (atlas, uvs) = mesh.textures().unwrap();
    assert_eq!((atlas.size_px(), uvs.len()), ([32, 16], mesh.vertices.len()));
    let faces = mesh.indices.chunks_exact(3);
    let textured = faces.filter(|t| t.iter().all(|&at| uvs[at as usize] != crate::content::NO_TEXTURE)).count();
    assert_eq!(textured, 2 * 4, "the roofs of two");
    let plain = PrismPage { atlas: None, ..page };
    let plain = decode_prisms(&encode_objects(&plain, &[]).unwrap()).unwrap();
    let groups = plain.prisms.iter().filter_map(|prism| prism.detail.as_ref()).flat_map(|detail| &detail.groups);
    assert!(plain.atlas.is_none() && groups.into_iter().all(|group| group.texture.is_none()));
    assert!(decode_objects(&detailed_page()).unwrap().1.textures().is_none());
}

#[test]
fn harmed_textures_under_a_right_checksum_do_no_harm() {
    let shapes = shapes_of(&textured_page());
    let plain = shapes_of(&object_page()).len();
    for at in plain..shapes.len() {
        for flip in [1, 0x10, 0x80, 0xff] {
            let mut harmed = shapes.clone();
            harmed[at] ^= flip;
            let _ = decode_objects(&forged_shapes(&harmed));
        }
        assert!(decode_objects(&forged_shapes(&shapes[..at])).is_err() || at == plain, "{at} bytes");
    }
    // A picture of another size, whatever it holds, is refused before it is unpacked.
    let page = decode_prisms(&textured_page()).unwrap();
    for (width, height) in [(30, 16), (2048, 8), (1024, 1024)] {
        let mut jpeg = Vec::new();
        let rgb = vec![9; (width * height * 3) as usize];
        let encoder = image::codecs::jpeg::JpegEncoder::new_with_quality(&mut jpeg, 50);
        let mut encoder = encoder;
        encoder.encode(&rgb, width, height, image::ExtendedColorType::Rgb8).unwrap();
        let forged = PrismPage { atlas: Some(jpeg), ..page.clone() };
        let forged = decode_objects(&encode_objects(&forged, &[]).unwrap());
        assert_eq!(forged.err(), Some(PageFault::Malformed("an atlas of a size that none has")), "{width} × {height}");
    }
    harm_some(&textured_page());
}

/// Flips of single bytes of a page, checksum and all.
fn harm_some(bytes: &[u8]) {
    for at in (0..bytes.len()).step_by(3) {
        let mut harmed = bytes.to_vec();
        harmed[at] ^= 0x41;
        assert!(decode_objects(&harmed).is_err(), "byte {at}");
    }
}
