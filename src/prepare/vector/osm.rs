//! OpenStreetMap extracts (PBF): the wanted ways and multipolygons with their coordinates. Three passes over the
//! file (relations, ways, nodes), so that only what is wanted is in memory.

use super::{FootprintPolygon, Ring};
use crate::prepare::PrepareError;
use crate::prepare::source::SourceFile;
use osmpbf::{BlobReader, Element, ElementReader, RelMemberType};
use std::collections::{BTreeMap, HashMap, HashSet};
use std::io::Read;

/// Tags of an element.
pub type Tags = BTreeMap<String, String>;

/// A way: a line or, when its ends are one node, an area.
#[derive(Clone, Debug)]
pub struct Way {
    pub id: i64,
    pub nodes: Vec<i64>,
    pub tags: Tags,
}

impl Way {
    pub fn is_closed(&self) -> bool {
        self.nodes.len() >= 4 && self.nodes.first() == self.nodes.last()
    }
}

/// A relation.
#[derive(Clone, Debug)]
pub struct Relation {
    pub id: i64,
    pub kind: RelationKind,
    pub tags: Tags,
    /// Ways, and whether each bounds a hole.
    pub members: Vec<(i64, Role)>,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum RelationKind {
    /// Of type multipolygon or boundary.
    Area,
    /// Of any other; its members are not loaded.
    Other,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Role {
    Outer,
    Inner,
}

/// The wanted part of an extract.
#[derive(Debug, Default)]
pub struct OsmFile {
    /// Ordered by id. Includes the members of wanted relations.
    pub ways: Vec<Way>,
    /// Ordered by id.
    pub relations: Vec<Relation>,
    /// West, south, east, north in degrees: what the file says it covers, else where its nodes are.
    pub bounds_deg: [f64; 4],
    nodes: HashMap<i64, [f64; 2]>,
    way_at: HashMap<i64, usize>,
}

/// A part of a way.
#[derive(Clone, Debug, PartialEq)]
pub struct Piece {
    pub points: Ring,
    /// Whether the way goes on before the first and behind the last point.
    pub goes_on: [bool; 2],
}

/// Rings of a multipolygon.
#[derive(Debug, Default)]
pub struct Assembled {
    pub polygons: Vec<FootprintPolygon>,
    /// Rings that do not close, or lie outside every outer ring.
    pub broken: usize,
}

impl OsmFile {
    /// Loads the ways and multipolygon relations with a tag that is `wanted` (key, value).
    pub fn load(file: &SourceFile, wanted: &(dyn Fn(&str, &str) -> bool + Sync)) -> Result<Self, PrepareError> {
        check_header(file)?;
        let mut relations = pass(file, |element| match element {
            Element::Relation(relation) => relation_of(&relation, wanted).into_iter().collect(),
            _ => Vec::new(),
        })?;
        relations.sort_by_key(|relation: &Relation| relation.id);
        let members: HashSet<i64> = relations.iter().flat_map(|r| r.members.iter().map(|m| m.0)).collect();
        let mut ways = pass(file, |element| match element {
            Element::Way(way) if members.contains(&way.id()) || way.tags().any(|(k, v)| wanted(k, v)) => {
                vec![Way { id: way.id(), nodes: way.refs().collect(), tags: own(way.tags()) }]
            }
            _ => Vec::new(),
        })?;
        ways.sort_by_key(|way: &Way| way.id);
        let needed: HashSet<i64> = ways.iter().flat_map(|way| way.nodes.iter().copied()).collect();
        let nodes = pass(file, |element| {
            let (id, lon, lat) = match &element {
                Element::DenseNode(node) => (node.id(), node.lon(), node.lat()),
                Element::Node(node) => (node.id(), node.lon(), node.lat()),
                _ => return Vec::new(),
            };
            if needed.contains(&id) { vec![(id, [lon, lat])] } else { Vec::new() }
        })?;
        let way_at = ways.iter().enumerate().map(|(at, way)| (way.id, at)).collect();
        let bounds_deg = header_bounds(file).unwrap_or_else(|| around(nodes.iter().map(|node| node.1)));
        Ok(Self { ways, relations, bounds_deg, nodes: nodes.into_iter().collect(), way_at })
    }

    pub fn way(&self, id: i64) -> Option<&Way> {
        self.way_at.get(&id).map(|&at| &self.ways[at])
    }

    /// The pieces of a way of which the extract has all nodes, degrees; and whether each end goes on beyond the
    /// extract.
    pub fn pieces(&self, way: &Way) -> Vec<Piece> {
        let mut pieces = Vec::new();
        let mut current: Option<Piece> = None;
        for (at, node) in way.nodes.iter().enumerate() {
            match self.nodes.get(node) {
                Some(&point) => {
                    let piece = current.get_or_insert_with(|| Piece { points: Vec::new(), goes_on: [at > 0, false] });
                    piece.points.push(point);
                }
                None => {
                    let ended = current.take().map(|piece| Piece { goes_on: [piece.goes_on[0], true], ..piece });
                    pieces.extend(ended);
                }
            }
        }
        pieces.extend(current);
        pieces
    }

    /// The points of a way, degrees; nodes that the extract lacks are left out.
    pub fn line(&self, way: &Way) -> Ring {
        way.nodes.iter().filter_map(|node| self.nodes.get(node).copied()).collect()
    }

    /// Joins the members of a multipolygon to rings, and gives each hole to the smallest outer ring around it.
    pub fn assemble(&self, relation: &Relation) -> Assembled {
        let rings_of = |role: Role| {
            let ways = relation.members.iter().filter(|member| member.1 == role).map(|member| self.way(member.0));
            let (present, absent): (Vec<_>, Vec<_>) = ways.partition(Option::is_some);
            let (rings, open) = join(present.into_iter().flatten().map(|way| way.nodes.clone()).collect());
            let points = |ring: Vec<i64>| ring.iter().filter_map(|node| self.nodes.get(node).copied()).collect();
            (
                rings.into_iter().map(points).filter(|ring: &Ring| ring.len() >= 4).collect::<Vec<_>>(),
                open + absent.len(),
            )
        };
        let (outer, mut broken) = rings_of(Role::Outer);
        let (inner, broken_inner) = rings_of(Role::Inner);
        broken += broken_inner;
        let mut polygons: Vec<FootprintPolygon> = outer.into_iter().map(|ring| vec![ring]).collect();
        for hole in inner {
            let around = (0..polygons.len())
                .filter(|&at| contains(&polygons[at][0], middle_of_first_edge(&hole)))
                .min_by(|&a, &b| area(&polygons[a][0]).abs().total_cmp(&area(&polygons[b][0]).abs()));
            match around {
                Some(at) => polygons[at].push(hole),
                None => broken += 1,
            }
        }
        Assembled { polygons, broken }
    }
}

/// The reader takes a file too short for a block for an empty one.
fn check_header(file: &SourceFile) -> Result<(), PrepareError> {
    let mut start = Vec::new();
    let read = file.open()?.take(32).read_to_end(&mut start);
    match read {
        Ok(_) if start.windows(9).any(|window| window == b"OSMHeader") => Ok(()),
        _ => Err(PrepareError::damaged(file, "its header", "it must be OpenStreetMap PBF")),
    }
}

/// The bounds in the file's header, when they are sound.
fn header_bounds(file: &SourceFile) -> Option<[f64; 4]> {
    let blob = BlobReader::new(file.open().ok()?).next()?.ok()?;
    let bounds = blob.to_headerblock().ok()?.bbox()?;
    let bounds = [bounds.left, bounds.bottom, bounds.right, bounds.top];
    (bounds[0] < bounds[2] && bounds[1] < bounds[3]).then_some(bounds)
}

fn around(points: impl Iterator<Item = [f64; 2]>) -> [f64; 4] {
    let empty = [f64::INFINITY, f64::INFINITY, f64::NEG_INFINITY, f64::NEG_INFINITY];
    points.fold(empty, |b, p| [b[0].min(p[0]), b[1].min(p[1]), b[2].max(p[0]), b[3].max(p[1])])
}

/// One pass over the file, blocks in parallel; results in no particular order.
fn pass<T: Send>(file: &SourceFile, map: impl Fn(Element) -> Vec<T> + Sync + Send) -> Result<Vec<T>, PrepareError> {
    ElementReader::new(file.open()?)
        .par_map_reduce(map, Vec::new, |mut a, mut b| {
            if a.len() < b.len() {
                std::mem::swap(&mut a, &mut b);
            }
            a.append(&mut b);
            a
        })
        .map_err(|error| PrepareError::damaged(file, "a block", format!("{error}; it must be OpenStreetMap PBF")))
}

fn own<'a>(tags: impl Iterator<Item = (&'a str, &'a str)>) -> Tags {
    tags.map(|(key, value)| (key.to_owned(), value.to_owned())).collect()
}

fn relation_of(relation: &osmpbf::Relation, wanted: &(dyn Fn(&str, &str) -> bool + Sync)) -> Option<Relation> {
    let is_area = relation.tags().any(|(k, v)| k == "type" && matches!(v, "multipolygon" | "boundary"));
    if !relation.tags().any(|(k, v)| wanted(k, v)) {
        return None;
    }
    if !is_area {
        let (id, tags) = (relation.id(), own(relation.tags()));
        return Some(Relation { id, kind: RelationKind::Other, tags, members: Vec::new() });
    }
    let members = relation
        .members()
        .filter(|member| member.member_type == RelMemberType::Way)
        .map(|member| {
            let role = if member.role().is_ok_and(|role| role == "inner") { Role::Inner } else { Role::Outer };
            (member.member_id, role)
        })
        .collect();
    Some(Relation { id: relation.id(), kind: RelationKind::Area, tags: own(relation.tags()), members })
}

/// Joins lines of nodes end to end into closed rings; also how many lines stay open.
fn join(mut lines: Vec<Vec<i64>>) -> (Vec<Vec<i64>>, usize) {
    let mut rings = Vec::new();
    let mut open = 0;
    lines.retain(|line| line.len() >= 2);
    while let Some(mut ring) = lines.pop() {
        loop {
            let (first, last) = (ring[0], ring[ring.len() - 1]);
            if first == last {
                rings.push(ring);
                break;
            }
            let next = lines.iter().position(|line| line[0] == last || line[line.len() - 1] == last);
            let Some(next) = next else {
                open += 1;
                break;
            };
            let mut line = lines.swap_remove(next);
            if line[0] != last {
                line.reverse();
            }
            ring.extend_from_slice(&line[1..]);
        }
    }
    (rings, open)
}

/// Twice the signed area of a ring.
pub fn area(ring: &[[f64; 2]]) -> f64 {
    let Some(&[x0, y0]) = ring.first() else { return 0.0 };
    let next = ring.iter().cycle().skip(1);
    ring.iter().zip(next).map(|(a, b)| (a[0] - x0) * (b[1] - y0) - (b[0] - x0) * (a[1] - y0)).sum()
}

/// Whether a point lies in a ring (even–odd).
pub fn contains(ring: &[[f64; 2]], [x, y]: [f64; 2]) -> bool {
    let edges = ring.iter().zip(ring.iter().cycle().skip(1));
    edges.fold(false, |inside, (a, b)| {
        let crosses = (a[1] > y) != (b[1] > y) && x < (b[0] - a[0]) * (y - a[1]) / (b[1] - a[1]) + a[0];
        inside != crosses
    })
}

/// Holes often share a node with their outer ring, but seldom an edge.
fn middle_of_first_edge(ring: &[[f64; 2]]) -> [f64; 2] {
    match ring {
        [a, b, ..] => [(a[0] + b[0]) / 2.0, (a[1] + b[1]) / 2.0],
        _ => [f64::NAN; 2],
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_join_whichever_way_they_run() {
        let (rings, open) = join(vec![vec![1, 2, 3], vec![1, 5, 4], vec![3, 4], vec![7, 8], vec![10, 11, 12, 10]]);
        assert_eq!(open, 1);
        assert_eq!(rings.len(), 2);
        let long = rings.iter().find(|ring| ring.len() == 6).unwrap();
        assert_eq!(long[0], long[5]);
    }

    #[test]
    fn a_ring_contains_its_inside() {
        let ring = [[0.0, 0.0], [4.0, 0.0], [4.0, 4.0], [2.0, 1.0], [0.0, 4.0]];
        assert!(contains(&ring, [1.0, 1.0]) && contains(&ring, [3.5, 2.0]));
        assert!(!contains(&ring, [2.0, 2.0]) && !contains(&ring, [5.0, 1.0]));
    }
}
