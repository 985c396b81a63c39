//! How mapped things look from above: colours near to those of aerial pictures, and widths in metres.

use crate::prepare::expression::parse_metres;
use crate::prepare::vector::osm::Tags;

/// sRGB.
pub type Color = [u8; 3];

#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Form {
    Area,
    Line { width_m: f64 },
}

/// One thing to paint; a road is two, its pavement and its roadway.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Style {
    /// Lower ones are painted first.
    pub order: u16,
    pub form: Form,
    pub color: Color,
}

/// Where nothing is mapped in a city.
pub const GROUND: Color = [172, 166, 156];
pub const WATER: Color = [52, 78, 96];
const GRASS: Color = [122, 138, 88];
const WOOD: Color = [78, 98, 62];
const PAVED: Color = [182, 176, 165];
const ASPHALT: Color = [108, 107, 107];
const PATH: Color = [190, 180, 160];

/// Orders, from below.
pub const SEA: u16 = 0;
const LAND_USE: u16 = 10;
const GREEN: u16 = 20;
const INLAND_WATER: u16 = 30;
const SQUARE: u16 = 40;
const PAVEMENT: u16 = 50;
const FOOTWAY: u16 = 60;
const ROADWAY: u16 = 70;
const RAILS: u16 = 90;
const BUILDING: u16 = 100;

const KEYS: [&str; 11] = [
    "landuse",
    "natural",
    "leisure",
    "waterway",
    "highway",
    "railway",
    "man_made",
    "amenity",
    "place",
    "building",
    "area:highway",
];

/// Whether a tag may be painted.
pub fn is_painted(key: &str, _value: &str) -> bool {
    KEYS.contains(&key)
}

/// What is painted for an element, lowest first.
pub fn of(tags: &Tags, is_closed: bool) -> Vec<Style> {
    let tag = |key: &str| tags.get(key).map(String::as_str);
    if is_below_ground(tags) {
        return Vec::new();
    }
    let mut styles = Vec::new();
    if is_closed {
        styles.extend(area(tags).map(|(order, color)| Style { order, form: Form::Area, color }));
    }
    let is_area = is_closed && (tag("area") == Some("yes") || tags.contains_key("area:highway"));
    if let (Some(class), false) = (tag("highway"), is_area) {
        styles.extend(road(class, tags));
    }
    if let Some(class) = tag("railway") {
        styles.extend(rails(class));
    }
    if let Some(width_m) = tag("waterway").and_then(waterway_width) {
        let width_m = tag("width").and_then(parse_metres).unwrap_or(width_m).clamp(0.5, 500.0);
        styles.push(Style { order: INLAND_WATER, form: Form::Line { width_m }, color: WATER });
    }
    styles
}

fn is_below_ground(tags: &Tags) -> bool {
    let tag = |key: &str| tags.get(key).map(String::as_str);
    tag("tunnel").is_some_and(|value| value != "no")
        || tag("indoor").is_some_and(|value| value != "no")
        || matches!(tag("location"), Some("underground" | "indoor"))
        || tag("layer").and_then(|layer| layer.parse::<f64>().ok()).is_some_and(|layer| layer < 0.0)
}

fn area(tags: &Tags) -> Option<(u16, Color)> {
    let tag = |key: &str| tags.get(key).map(String::as_str);
    let by_key = [
        tag("building").filter(|value| *value != "no").map(|_| (BUILDING, [150, 141, 133])),
        tag("natural").and_then(natural),
        tag("waterway").filter(|value| matches!(*value, "riverbank" | "dock")).map(|_| (INLAND_WATER, WATER)),
        tag("leisure").and_then(leisure),
        tag("landuse").and_then(land_use),
        tag("man_made").filter(|value| matches!(*value, "pier" | "breakwater")).map(|_| (SQUARE, [168, 158, 146])),
        tag("amenity").and_then(amenity),
        tag("area:highway").map(|_| (ROADWAY, ASPHALT)),
        tag("highway")
            .filter(|_| tag("area") == Some("yes") || tag("highway") == Some("pedestrian"))
            .map(|_| (SQUARE, PAVED)),
        tag("railway").filter(|value| *value == "platform").map(|_| (SQUARE + 1, PAVED)),
        tag("place").filter(|value| *value == "square").map(|_| (SQUARE, PAVED)),
    ];
    by_key.into_iter().flatten().next()
}

fn natural(value: &str) -> Option<(u16, Color)> {
    Some(match value {
        "water" => (INLAND_WATER, WATER),
        "wood" => (GREEN, WOOD),
        "scrub" => (GREEN, [104, 118, 78]),
        "heath" | "fell" => (GREEN, [132, 130, 92]),
        "grassland" => (GREEN, GRASS),
        "wetland" => (GREEN, [104, 116, 92]),
        "sand" | "beach" => (GREEN, [208, 194, 160]),
        "bare_rock" | "scree" | "shingle" => (GREEN, [156, 150, 142]),
        "glacier" => (GREEN, [232, 238, 242]),
        _ => return None,
    })
}

fn leisure(value: &str) -> Option<(u16, Color)> {
    Some(match value {
        "park" | "garden" | "common" | "golf_course" | "dog_park" => (GREEN, GRASS),
        "nature_reserve" => (LAND_USE, [116, 130, 88]),
        "pitch" | "stadium" | "track" => (GREEN + 1, [112, 136, 84]),
        "playground" => (GREEN + 1, [182, 166, 134]),
        "swimming_pool" => (INLAND_WATER, [112, 168, 184]),
        "marina" => (SEA + 1, WATER),
        _ => return None,
    })
}

fn land_use(value: &str) -> Option<(u16, Color)> {
    Some(match value {
        "grass" | "village_green" | "recreation_ground" | "flowerbed" | "greenfield" => (GREEN + 1, GRASS),
        "meadow" => (GREEN, [138, 146, 92]),
        "forest" => (GREEN, WOOD),
        "cemetery" | "allotments" => (GREEN, [118, 132, 90]),
        "farmland" => (LAND_USE, [166, 158, 112]),
        "orchard" | "vineyard" | "plant_nursery" => (LAND_USE, [122, 130, 80]),
        "basin" | "reservoir" | "pond" => (INLAND_WATER, WATER),
        "residential" => (LAND_USE, [174, 169, 158]),
        "commercial" | "retail" | "industrial" | "civil" | "garages" => (LAND_USE, [170, 165, 157]),
        "railway" => (LAND_USE + 1, [142, 134, 126]),
        "construction" | "brownfield" | "quarry" | "landfill" => (LAND_USE + 1, [176, 158, 134]),
        _ => return None,
    })
}

fn amenity(value: &str) -> Option<(u16, Color)> {
    Some(match value {
        "parking" | "bicycle_parking" => (SQUARE, [132, 130, 128]),
        "marketplace" => (SQUARE, PAVED),
        "fountain" => (SQUARE + 2, [110, 140, 154]),
        "school" | "university" | "hospital" | "college" => (LAND_USE, [170, 166, 152]),
        _ => return None,
    })
}

/// Width of the roadway, and its rank.
fn road_class(class: &str) -> Option<(f64, u16)> {
    Some(match class {
        "motorway" => (16.0, 9),
        "trunk" => (14.0, 8),
        "primary" => (12.0, 7),
        "secondary" => (10.5, 6),
        "tertiary" => (9.0, 5),
        "motorway_link" | "trunk_link" | "primary_link" | "secondary_link" | "tertiary_link" => (6.5, 4),
        "residential" | "unclassified" | "road" => (7.5, 3),
        "living_street" | "raceway" | "busway" => (6.0, 2),
        "service" => (4.0, 1),
        _ => return None,
    })
}

fn road(class: &str, tags: &Tags) -> Vec<Style> {
    let Some((usual_m, rank)) = road_class(class) else { return footway(class, tags).into_iter().collect() };
    let number = |key: &str| tags.get(key).and_then(|value| parse_metres(value));
    let by_lanes = number("lanes").map(|lanes| 1.0 + 3.2 * lanes);
    let width_m = number("width").or(by_lanes).unwrap_or(usual_m).clamp(2.0, 40.0);
    let color = match tags.get("surface").map(String::as_str) {
        Some("cobblestone" | "sett" | "unhewn_cobblestone" | "paving_stones") => [134, 128, 121],
        Some("unpaved" | "gravel" | "fine_gravel" | "ground" | "dirt" | "compacted" | "sand") => [168, 154, 130],
        _ => ASPHALT,
    };
    let mut styles = Vec::new();
    if (2..8).contains(&rank) {
        let form = Form::Line { width_m: width_m + 5.0 };
        styles.push(Style { order: PAVEMENT, form, color: PAVED });
    }
    styles.push(Style { order: ROADWAY + rank, form: Form::Line { width_m }, color });
    if rank >= 6 && width_m > 9.0 {
        let order = ROADWAY + 10;
        styles.push(Style { order, form: Form::Line { width_m: 0.3 }, color: [206, 204, 198] });
    }
    styles
}

fn footway(class: &str, tags: &Tags) -> Option<Style> {
    let (usual_m, color) = match class {
        "pedestrian" => (6.0, PAVED),
        "cycleway" => (2.5, [128, 120, 116]),
        "footway" | "path" | "bridleway" => (1.8, PATH),
        "steps" => (2.0, [160, 154, 146]),
        "track" => (3.0, [164, 150, 124]),
        _ => return None,
    };
    let width_m = tags.get("width").and_then(|value| parse_metres(value)).unwrap_or(usual_m).clamp(0.8, 20.0);
    Some(Style { order: FOOTWAY, form: Form::Line { width_m }, color })
}

fn rails(class: &str) -> Vec<Style> {
    let line = |order: u16, width_m: f64, color: Color| Style { order, form: Form::Line { width_m }, color };
    match class {
        "rail" | "light_rail" | "narrow_gauge" => {
            vec![line(PAVEMENT + 1, 4.5, [126, 116, 106]), line(RAILS, 1.6, [92, 84, 78])]
        }
        "tram" => vec![line(RAILS, 1.4, [92, 91, 90])],
        "abandoned" | "disused" => vec![line(PAVEMENT + 1, 3.0, [146, 140, 120])],
        _ => Vec::new(),
    }
}

fn waterway_width(class: &str) -> Option<f64> {
    Some(match class {
        "river" => 20.0,
        "canal" => 12.0,
        "stream" => 2.5,
        "drain" | "ditch" => 1.5,
        _ => return None,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn styles(text: &[(&str, &str)], is_closed: bool) -> Vec<Style> {
        of(&text.iter().map(|(k, v)| ((*k).to_owned(), (*v).to_owned())).collect(), is_closed)
    }

    #[test]
    fn roads_are_as_wide_as_they_say() {
        let width = |styles: &[Style]| match styles.iter().find(|s| s.color == ASPHALT).map(|s| s.form) {
            Some(Form::Line { width_m }) => width_m,
            other => panic!("{other:?}"),
        };
        assert_eq!(width(&styles(&[("highway", "residential")], false)), 7.5);
        assert_eq!(width(&styles(&[("highway", "residential"), ("width", "5,5 m")], false)), 5.5);
        assert_eq!(width(&styles(&[("highway", "primary"), ("lanes", "2")], false)), 7.4);
    }

    #[test]
    fn what_lies_below_ground_is_not_painted() {
        assert!(styles(&[("highway", "primary"), ("tunnel", "yes")], false).is_empty());
        assert!(styles(&[("railway", "subway")], false).is_empty());
        assert!(!styles(&[("highway", "primary"), ("tunnel", "no")], false).is_empty());
    }

    #[test]
    fn only_closed_ways_are_areas() {
        assert!(styles(&[("leisure", "park")], false).is_empty());
        assert_eq!(styles(&[("leisure", "park")], true)[0].form, Form::Area);
    }
}
