//! The drawn surface and its cuts.

use super::*;
use crate::content::TerrainVertex;
use crate::content::rtin::Triangle;
use crate::forest::{Quadrant, Zone};
use crate::geodesy::Geodetic;
use proptest::prelude::*;

/// A page whose network is finer where `interest` says, over hills of a size that suits the cell.
fn hilly(cell: CellId, interest: impl Fn(f64, f64) -> bool) -> TerrainPage {
    let diagonal = Diagonal::of(cell);
    let exceeds = |triangle: Triangle| {
        triangle.depth() < 5
            || triangle.vertices(diagonal).iter().any(|&(x, y)| interest(f64::from(x) / 64.0, f64::from(y) / 64.0))
    };
    let active = border_posts(cell, cell.sides_m().height_m / 4096.0).refine(diagonal, &exceeds);
    page_over(cell, &active)
}

fn page_over(cell: CellId, active: &Active) -> TerrainPage {
    let bounds = cell.bounds();
    let tall_m = cell.sides_m().height_m / 500.0;
    let posts = active.posts().map(|(column, row)| {
        let at = bounds.at(f64::from(column) / 64.0, f64::from(row) / 64.0, 0.0);
        // A row at a pole is one place and has one height.
        let across = at.lon_rad * at.lat_rad.cos().max(0.0) / bounds.height_rad();
        let height_m = tall_m * ((across * 9.0).sin() + (at.lat_rad / bounds.height_rad() * 7.0).cos());
        TerrainPost {
            column,
            row,
            height_m: height_m as f32,
            parent_height_m: (height_m * 0.5) as f32,
            slope: [(column as i8) - 32, 32 - (row as i8)],
        }
    });
    TerrainPage::from_posts(cell, (tall_m / 100.0) as f32, posts.collect()).expect("a closed set")
}

fn places() -> Vec<CellId> {
    let at = |lat: f64, lon: f64, level| CellId::containing(lat.to_radians(), lon.to_radians(), level);
    let mut cells: Vec<_> = [0, 3, 8, 13, 17]
        .iter()
        .flat_map(|&level| [at(37.8, -122.4, level), at(60.2, 24.9, level), at(1.0, 1.0, level)])
        .collect();
    cells.extend([
        at(89.99, 10.0, 0),
        at(89.99, 10.0, 4),
        at(-89.99, -100.0, 2),
        at(75.6, 10.0, 2),
        at(89.9999, 10.0, 12),
    ]);
    cells
}

fn position(mesh: &TerrainMesh, vertex: &TerrainVertex, own: f64) -> DVec3 {
    let own_place = mesh.origin.xyz() + DVec3::from(vertex.position_m.map(f64::from));
    own_place + Geodetic::from_ecef(Point::new(own_place)).up() * ((1.0 - own) * f64::from(vertex.morph_m))
}

fn area_m2(mesh: &TerrainMesh) -> f64 {
    let corner = |index: u32| DVec3::from(mesh.vertices[index as usize].position_m.map(f64::from));
    mesh.indices[..mesh.surface_len as usize]
        .chunks_exact(3)
        .map(|t| (corner(t[1]) - corner(t[0])).cross(corner(t[2]) - corner(t[0])).length() / 2.0)
        .sum()
}

#[test]
fn a_cut_lies_on_the_surface() {
    for cell in places() {
        let page = hilly(cell, |u, v| (u - 0.3).abs() < 0.2 && (v - 0.6).abs() < 0.3);
        let size_m = cell.sides_m().height_m;
        let below = cell.children().flat_map(CellId::children).chain([cell]).chain(cell.children());
        for piece in below {
            let mesh = page.cut(piece);
            assert!(mesh.surface_len > 0, "{cell} {piece}");
            let bounds = cell.bounds();
            for own in [0.0, 0.3, 1.0] {
                let surface = page.surface(own);
                for t in mesh.indices[..mesh.surface_len as usize].chunks_exact(3) {
                    let corners = [t[0], t[1], t[2]].map(|i| position(&mesh, &mesh.vertices[i as usize], own));
                    let middle = Geodetic::from_ecef(Point::new((corners[0] + corners[1] + corners[2]) / 3.0));
                    if !bounds.contains(middle.lat_rad, middle.lon_rad) {
                        continue;
                    }
                    let drawn = surface.height_m(middle.lat_rad, middle.lon_rad).unwrap();
                    let one = page.surface_height_m(middle.lat_rad, middle.lon_rad, own).unwrap();
                    assert!((one - drawn).abs() < 1e-6);
                    // Positions are f32 from the piece's centre; morphing moves corners along their own normals.
                    let allowed = 1e-3 + size_m * 1e-6;
                    assert!(
                        (drawn - middle.height_m).abs() < allowed,
                        "{cell} {piece} own {own}: {drawn} {}",
                        middle.height_m
                    );
                }
            }
        }
    }
}

#[test]
fn pieces_cover_the_page_once() {
    for cell in places() {
        let page = hilly(cell, |u, v| u + v < 0.7);
        let whole = area_m2(&page.cut(cell));
        let mut pieces: Vec<_> = vec![cell];
        for _ in 0..3 {
            pieces = pieces.into_iter().flat_map(CellId::children).collect();
            let sum: f64 = pieces.iter().map(|&piece| area_m2(&page.cut(piece))).sum();
            assert!((sum / whole - 1.0).abs() < 1e-5, "{cell}: {sum} {whole}");
        }
    }
}

/// The corners on one meridian of a piece, in space.
fn rim(mesh: &TerrainMesh, u: u16) -> Vec<DVec3> {
    let surface: std::collections::BTreeSet<u32> = mesh.indices[..mesh.surface_len as usize].iter().copied().collect();
    let on_it = surface.into_iter().map(|i| &mesh.vertices[i as usize]).filter(|vertex| vertex.uv[0] == u);
    let mut corners: Vec<_> = on_it.map(|vertex| position(mesh, vertex, 1.0)).collect();
    corners.sort_by(|a, b| a.z.total_cmp(&b.z));
    corners
}

#[test]
fn neighbouring_pieces_share_the_corners_of_their_seam() {
    for cell in places() {
        let page = hilly(cell, |u, v| (u - v).abs() < 0.1);
        let quadrants = [Quadrant::SouthWest, Quadrant::SouthEast];
        let [Some(west), Some(east)] = quadrants.map(|quadrant| cell.child(quadrant)) else { continue };
        let (a, b) = (rim(&page.cut(west), 65535), rim(&page.cut(east), 0));
        assert!(a.len() >= 2 && a.len() == b.len(), "{cell}: {} {}", a.len(), b.len());
        let size_m = cell.sides_m().height_m;
        for (p, q) in a.iter().zip(&b) {
            assert!(p.distance(*q) < 1e-3 + size_m * 2e-7, "{cell}");
        }
    }
}

#[test]
fn a_piece_far_below_is_a_few_triangles_and_ends_at_its_own_borders() {
    let page = page_over(CellId::containing(0.66, -2.13, 4), &Active::corners());
    let piece = CellId::containing(0.66, -2.13, 16);
    let mesh = page.cut(piece);
    assert!((2..=6).contains(&(mesh.surface_len / 3)), "{}", mesh.surface_len);
    let bounds = piece.bounds();
    for vertex in &mesh.vertices {
        let at = Geodetic::from_ecef(Point::new(position(&mesh, vertex, 1.0)));
        let (u, v) = bounds.fractions(at.lat_rad, at.lon_rad);
        assert!((u - f64::from(vertex.uv[0]) / 65535.0).abs() < 1e-3);
        // The chords of so large a triangle leave the parallels by far more than a piece; only the west and the
        // east end at their own lines.
        let _ = v;
    }
    assert_eq!(page.cut(Zone::all().next().unwrap().root()).indices.len(), 0);
}

#[test]
fn skirts_hang_from_every_border_edge_and_face_outwards() {
    let cell = CellId::containing(0.66, -2.13, 12);
    let page = hilly(cell, |u, _| u < 0.2);
    for piece in cell.children() {
        let mesh = page.cut(piece);
        let lower: Vec<_> = mesh.vertices.iter().filter(|vertex| vertex.slope_skirt[2] == 127).collect();
        let on_border = |uv: [u16; 2]| uv.iter().any(|&f| f == 0 || f == 65535);
        let border = mesh.vertices.len() - mesh.vertices.iter().filter(|vertex| !on_border(vertex.uv)).count();
        assert_eq!(lower.len() * 2, border);
        let center = mesh.origin.xyz();
        let up = Geodetic::from_ecef(mesh.origin).up();
        for t in mesh.indices[mesh.surface_len as usize..].chunks_exact(3) {
            let corner = |i: u32| {
                let vertex = &mesh.vertices[i as usize];
                position(&mesh, vertex, 1.0) - up * f64::from(vertex.slope_skirt[2])
            };
            let [a, b, c] = [corner(t[0]), corner(t[1]), corner(t[2])];
            assert!((b - a).cross(c - a).dot((a + b + c) / 3.0 - center) > 0.0);
        }
    }
}

#[test]
fn the_polar_surface_is_found_beyond_the_row_that_is_one_point() {
    let cell = CellId::containing(1.57, 0.1, 3);
    let page = page_over(cell, &Active::corners());
    let bounds = cell.bounds();
    for step in 1..20 {
        let lat_rad = bounds.north_rad - bounds.height_rad() * 0.05 * f64::from(step);
        let height_m = page.surface_height_m(lat_rad, bounds.west_rad + bounds.width_rad() * 0.3, 1.0).unwrap();
        assert!(height_m.abs() < 0.1 * cell.sides_m().height_m, "{height_m}");
    }
}

#[test]
fn borders_follow_their_parallel() {
    assert_eq!(border_posts(CellId::containing(0.001, 0.001, 14), 0.01), Active::corners());
    let cell = CellId::containing(1.2, 0.1, 4);
    let active = border_posts(cell, 50.0);
    assert!(active.len() > 6 && active.is_closed(Diagonal::of(cell)), "{}", active.len());
}

proptest! {
    #[test]
    fn children_that_keep_their_parents_posts_can_draw_its_surface(lat in -84.0..84.0f64, lon in -179.0..179.0f64, level in 4u8..12) {
        let parent_cell = CellId::containing(lat.to_radians(), lon.to_radians(), level);
        let parent = hilly(parent_cell, |u, v| (u * 3.0).fract() < 0.1 && v < 0.6);
        let children = parent_cell.children().filter(|c| c.quadrant().is_some_and(|q| !parent_cell.child_row_is_thinned(q.is_north())));
        for child in children {
            let (cx, cy) = (f64::from(child.xy().0 % 2) * 32.0, f64::from(child.xy().1 % 2) * 32.0);
            let mut active = Active::corners();
            for (column, row) in parent.active().posts() {
                let (x, y) = ((f64::from(column) - cx) * 2.0, (f64::from(row) - cy) * 2.0);
                if (0.0..=64.0).contains(&x) && (0.0..=64.0).contains(&y) {
                    active.insert((x as u8, y as u8));
                }
            }
            let diagonal = Diagonal::of(child);
            active.close(diagonal);
            let mut page = page_over(child, &active);
            let surface = parent.surface(1.0);
            let bounds = child.bounds();
            for post in &mut page.posts {
                let at = bounds.at(f64::from(post.column) / 64.0, f64::from(post.row) / 64.0, 0.0);
                post.parent_height_m = surface.height_m(at.lat_rad, at.lon_rad).unwrap() as f32;
            }
            for step in 0..50 {
                let at = bounds.at(f64::from(step) * 0.618 % 1.0, f64::from(step) / 50.0, 0.0);
                let a = page.surface_height_m(at.lat_rad, at.lon_rad, 0.0).unwrap();
                let b = surface.height_m(at.lat_rad, at.lon_rad).unwrap();
                prop_assert!((a - b).abs() < 2e-3 + 2e-6 * parent_cell.sides_m().height_m, "{child}: {a} {b}");
            }
        }
    }
}
