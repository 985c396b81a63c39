//! Buildings of an OpenStreetMap extract: closed ways and multipolygons with `building` or `building:part`.
//!
//! Where an outline has parts (OSM wiki, *Simple 3D Buildings*), the parts stand for it. An outline whose parts cover
//! less than half of it is kept beside them, for unfinished mapping must not tear holes into a city.

use super::osm::{Assembled, OsmFile, RelationKind, Tags, Way, area, contains};
use super::{Feature, FootprintPolygon, ReadSummary, Visit};
use crate::prepare::PrepareError;
use crate::prepare::source::SourceFile;
use std::collections::{BTreeMap, HashMap, HashSet};
use std::sync::Arc;

/// What an extract holds.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct OsmBuildingCounts {
    /// Ways and relations with `building`.
    pub buildings: u64,
    /// Ways and relations with `building:part`.
    pub parts: u64,
    /// Buildings and parts with `height`.
    pub with_height: u64,
    /// Buildings and parts with `building:levels`.
    pub with_levels: u64,
    /// Outlines for which their parts stand.
    pub replaced: u64,
}

impl OsmBuildingCounts {
    fn add(&mut self, tags: &Tags) {
        self.buildings += u64::from(is(tags, "building"));
        self.parts += u64::from(is(tags, "building:part"));
        self.with_height += u64::from(tags.contains_key("height"));
        self.with_levels += u64::from(tags.contains_key("building:levels"));
    }
}

/// What a part takes from its outline where it says nothing itself.
const SIZES: [&str; 2] = ["height", "building:levels"];
const COLOURS: [&str; 2] = ["building:colour", "roof:colour"];

struct Candidate {
    id: String,
    tags: Tags,
    polygons: Vec<FootprintPolygon>,
}

pub fn read(file: &SourceFile, visit: &mut Visit) -> Result<ReadSummary, PrepareError> {
    let osm = OsmFile::load(file, &|key, value| matches!(key, "building" | "building:part") && value != "no")?;
    let mut summary = ReadSummary::default();
    let mut counts = OsmBuildingCounts::default();
    let (mut outlines, mut parts) = (Vec::new(), Vec::new());
    for candidate in candidates(&osm, &mut counts, &mut summary.kept_back) {
        if is(&candidate.tags, "building:part") {
            parts.push(candidate);
        } else {
            outlines.push(candidate);
        }
    }
    let families = Families::of(&outlines, &mut parts);
    for (at, outline) in outlines.into_iter().enumerate() {
        if families.replaced.contains(&at) {
            counts.replaced += 1;
            continue;
        }
        summary.features += 1;
        visit(feature(outline, None, summary.features))?;
    }
    for (at, part) in parts.into_iter().enumerate() {
        summary.features += 1;
        visit(feature(part, families.ground.get(&at).cloned(), summary.features))?;
    }
    if counts.replaced > 0 {
        summary.kept_back.insert("outline replaced by its parts".into(), counts.replaced);
    }
    summary.osm = Some(counts);
    Ok(summary)
}

fn is(tags: &Tags, key: &str) -> bool {
    tags.get(key).is_some_and(|value| value != "no")
}

fn feature(candidate: Candidate, ground: Option<Arc<Vec<[f64; 2]>>>, number: u64) -> Feature {
    let attributes = candidate.tags.into_iter().map(|(key, value)| (key, value.into())).collect();
    Feature { number, id: Some(candidate.id), polygons: candidate.polygons, attributes, ground, ..Feature::default() }
}

/// All areas that are buildings or parts, ways first.
fn candidates(osm: &OsmFile, counts: &mut OsmBuildingCounts, kept_back: &mut BTreeMap<String, u64>) -> Vec<Candidate> {
    let mut keep_back = |reason: &str| *kept_back.entry(reason.to_owned()).or_default() += 1;
    let mut found = Vec::new();
    // A ring that carries its relation's tag as well is one building, not two.
    let rings_of_relations: HashSet<i64> = osm.relations.iter().flat_map(|r| r.members.iter().map(|m| m.0)).collect();
    for way in &osm.ways {
        if !is(&way.tags, "building") && !is(&way.tags, "building:part")
            || doubles_relation(osm, way, &rings_of_relations)
        {
            continue;
        }
        counts.add(&way.tags);
        if !way.is_closed() {
            keep_back("way is not closed");
        } else if is_underground(&way.tags) {
            keep_back("underground");
        } else {
            let id = format!("way/{}", way.id);
            found.push(Candidate { id, tags: way.tags.clone(), polygons: vec![vec![osm.line(way)]] });
        }
    }
    for relation in &osm.relations {
        counts.add(&relation.tags);
        if relation.kind == RelationKind::Other {
            keep_back("relation is no multipolygon");
            continue;
        }
        let Assembled { polygons, broken } = osm.assemble(relation);
        if polygons.is_empty() {
            keep_back("multipolygon without a closed ring");
        } else if is_underground(&relation.tags) {
            keep_back("underground");
        } else {
            if broken > 0 {
                keep_back("ring of a multipolygon is not closed");
            }
            found.push(Candidate { id: format!("relation/{}", relation.id), tags: relation.tags.clone(), polygons });
        }
    }
    found
}

fn doubles_relation(osm: &OsmFile, way: &Way, rings: &HashSet<i64>) -> bool {
    rings.contains(&way.id)
        && osm.relations.iter().any(|relation| {
            relation.members.iter().any(|member| member.0 == way.id && member.1 == super::osm::Role::Outer)
                && ["building", "building:part"].iter().all(|key| is(&relation.tags, key) == is(&way.tags, key))
        })
}

fn is_underground(tags: &Tags) -> bool {
    tags.get("location").is_some_and(|place| place == "underground")
}

/// Which outline each part belongs to.
#[derive(Default)]
struct Families {
    /// Outlines, by index, for which their parts stand.
    replaced: HashSet<usize>,
    /// For each part, by index, the footprint that its ground is taken from.
    ground: HashMap<usize, Arc<Vec<[f64; 2]>>>,
}

/// Side of the buckets that outlines are found by, degrees.
const BUCKET_DEG: f64 = 1e-3;
/// Outlines are replaced when their parts cover at least this share of them.
const COVERED_SHARE: f64 = 0.5;

impl Families {
    fn of(outlines: &[Candidate], parts: &mut [Candidate]) -> Self {
        let buckets = bucket(outlines);
        let mut covered: HashMap<usize, f64> = HashMap::new();
        let mut families = Self::default();
        let mut members: Vec<(usize, usize)> = Vec::new();
        for (at, part) in parts.iter_mut().enumerate() {
            let Some(inside) = inner_point(&part.polygons) else { continue };
            let key = bucket_of(inside);
            let outline = buckets
                .get(&key)
                .into_iter()
                .flatten()
                .copied()
                .filter(|&candidate| holds(&outlines[candidate].polygons, inside))
                .min_by(|&a, &b| size(&outlines[a].polygons).total_cmp(&size(&outlines[b].polygons)));
            let Some(outline) = outline else { continue };
            *covered.entry(outline).or_default() += size(&part.polygons);
            inherit(&mut part.tags, &outlines[outline].tags);
            members.push((at, outline));
        }
        for (&outline, &by) in &covered {
            if by >= COVERED_SHARE * size(&outlines[outline].polygons) {
                families.replaced.insert(outline);
            }
        }
        let mut grounds: HashMap<usize, Arc<Vec<[f64; 2]>>> = HashMap::new();
        for (part, outline) in members {
            let ground = grounds.entry(outline).or_insert_with(|| {
                Arc::new(outlines[outline].polygons.iter().flat_map(|rings| rings[0].iter().copied()).collect())
            });
            families.ground.insert(part, ground.clone());
        }
        families
    }
}

fn inherit(part: &mut Tags, outline: &Tags) {
    for group in [SIZES, COLOURS] {
        if group.iter().any(|key| part.contains_key(*key)) {
            continue;
        }
        for key in group {
            if let Some(value) = outline.get(key) {
                part.insert(key.to_owned(), value.clone());
            }
        }
    }
}

fn bucket_of([lon, lat]: [f64; 2]) -> (i64, i64) {
    ((lon / BUCKET_DEG).floor() as i64, (lat / BUCKET_DEG).floor() as i64)
}

fn bucket(outlines: &[Candidate]) -> HashMap<(i64, i64), Vec<usize>> {
    let mut buckets: HashMap<(i64, i64), Vec<usize>> = HashMap::new();
    for (at, outline) in outlines.iter().enumerate() {
        for rings in &outline.polygons {
            let (mut low, mut high) = ([f64::INFINITY; 2], [f64::NEG_INFINITY; 2]);
            for point in &rings[0] {
                low = [low[0].min(point[0]), low[1].min(point[1])];
                high = [high[0].max(point[0]), high[1].max(point[1])];
            }
            let (low, high) = (bucket_of(low), bucket_of(high));
            for x in low.0..=high.0 {
                for y in low.1..=high.1 {
                    let list = buckets.entry((x, y)).or_default();
                    if list.last() != Some(&at) {
                        list.push(at);
                    }
                }
            }
        }
    }
    buckets
}

/// Twice the area, square degrees.
fn size(polygons: &[FootprintPolygon]) -> f64 {
    polygons
        .iter()
        .map(|rings| area(&rings[0]).abs() - rings[1..].iter().map(|hole| area(hole).abs()).sum::<f64>())
        .sum()
}

fn holds(polygons: &[FootprintPolygon], point: [f64; 2]) -> bool {
    polygons.iter().any(|rings| contains(&rings[0], point) && !rings[1..].iter().any(|hole| contains(hole, point)))
}

/// A point inside an area: in the middle of the widest run through it at half height.
fn inner_point(polygons: &[FootprintPolygon]) -> Option<[f64; 2]> {
    use geo::InteriorPoint;
    let rings = polygons.first()?;
    let line = |ring: &Vec<[f64; 2]>| geo::LineString::from(ring.iter().map(|p| (p[0], p[1])).collect::<Vec<_>>());
    let polygon = geo::Polygon::new(line(rings.first()?), rings[1..].iter().map(line).collect());
    polygon.interior_point().map(|point| [point.x(), point.y()])
}
