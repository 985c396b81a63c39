//! How a recipe's section turns a feature's attributes into heights and colours.

use super::clean::Reason;
use super::color;
use super::roof::{RoofRule, RoofShape};
use crate::geodesy::VerticalDatum;
use crate::prepare::PrepareError;
use crate::prepare::expression::{Expression, WrongType};
use crate::prepare::recipe::{Amount, BuildingsSection};
use crate::prepare::vector::Feature;
use serde_json::{Map, Value};
use std::collections::BTreeSet;

/// Height of a storey where only their number is known, metres.
pub const STOREY_M: f64 = 3.2;
/// Heights above this are taken for mistakes, metres.
pub const HEIGHT_MAX_M: f64 = 1500.0;

/// A section of a recipe, ready to be applied.
#[derive(Clone, Debug)]
pub struct Rules {
    height: Expression,
    levels: Expression,
    base: Option<Expression>,
    min_height: Expression,
    default_height_m: Option<f64>,
    nodata: Option<f64>,
    roof: String,
    color: Option<String>,
    id: Option<String>,
    keep: Option<Vec<String>>,
    /// Heights above a datum mean nothing where copies are set down: all stands on the terrain.
    pub on_terrain: bool,
    /// What `base` counts from.
    pub vertical: VerticalDatum,
}

/// The note on roofs that cannot be drawn as they are.
pub const DRAWN_FLAT: Reason = "roof shape drawn flat";

/// The vertical extent of a building, metres.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Extent {
    /// Roof above the ground.
    pub height_m: f64,
    /// Underside above the ground; 0 where the building stands on it.
    pub min_height_m: f64,
    /// The ground itself above the source's datum, where the source says.
    pub base_m: Option<f64>,
    /// The height counts to the eaves, as storeys do, and not to the roof's top.
    pub to_eaves: bool,
}

impl Rules {
    /// Without keys in the recipe, `height`, `building:levels` and `min_height` are looked for. `vertical` holds
    /// where the section names none.
    pub fn new(section: &BuildingsSection, vertical: VerticalDatum) -> Result<Self, PrepareError> {
        let parse = |key: &str, amount: &Amount| match amount {
            Amount::Number(number) => Ok(Expression::Number(*number)),
            Amount::Text(text) => Expression::parse(text).map_err(|error| {
                let place = format!("[[buildings]] {:?}, {key}", section.name);
                PrepareError::value("the recipe", place, error, "write a number, an attribute, or an expression")
            }),
        };
        let or_attribute = |key: &str, amount: &Option<Amount>, name: &str| match amount {
            Some(amount) => parse(key, amount),
            None => Ok(Expression::Attribute(name.to_owned())),
        };
        Ok(Self {
            height: or_attribute("height", &section.height, "height")?,
            levels: or_attribute("levels", &section.levels, "building:levels")?,
            base: section.base.as_ref().map(|amount| parse("base", amount)).transpose()?,
            min_height: or_attribute("min_height", &section.min_height, "min_height")?,
            default_height_m: section.default_height,
            nodata: section.nodata,
            roof: section.roof.clone().unwrap_or_else(|| "roof:shape".into()),
            color: section.color.clone(),
            id: section.id.clone(),
            keep: section.attributes.clone(),
            on_terrain: section.copies.is_some(),
            vertical,
        })
    }

    /// Height by the first that is there and above 0: `height`, `levels`, `default_height`, the footprint's area. All
    /// but the first are noted.
    pub fn extent(
        &self,
        attributes: &Map<String, Value>,
        area_m2: f64,
        notes: &mut BTreeSet<Reason>,
    ) -> Result<Extent, WrongType> {
        let value = |expression: &Expression| {
            expression.value(attributes).map(|value| value.filter(|value| Some(*value) != self.nodata))
        };
        let given = value(&self.height)?;
        let mut to_eaves = false;
        let height_m = match given.filter(|height| (0.01..=HEIGHT_MAX_M).contains(height)) {
            Some(height) => height,
            None => {
                if given.is_some() {
                    notes.insert("height not above 0 or beyond 1500 m: ignored");
                }
                let levels = value(&self.levels)?.filter(|n| *n > 0.0 && n * STOREY_M <= HEIGHT_MAX_M);
                to_eaves = levels.is_some();
                self.height_without(levels, area_m2, notes)
            }
        };
        let mut min_height_m = value(&self.min_height)?.unwrap_or(0.0);
        if min_height_m == 0.0 {
            // As OpenStreetMap has it for parts over an arcade.
            let levels = Expression::Attribute("building:min_level".into()).value(attributes)?.unwrap_or(0.0);
            min_height_m = if levels > 0.0 { levels * STOREY_M } else { 0.0 };
        }
        if !(0.0..height_m).contains(&min_height_m) {
            notes.insert("underside not below the roof: ignored");
            min_height_m = 0.0;
        }
        let base_m = self.base_m(attributes)?;
        Ok(Extent { height_m, min_height_m, base_m, to_eaves })
    }

    /// What the source says of the ground, above its datum, metres.
    pub fn base_m(&self, attributes: &Map<String, Value>) -> Result<Option<f64>, WrongType> {
        let base = self.base.as_ref().filter(|_| !self.on_terrain).map(|base| base.value(attributes)).transpose()?;
        Ok(base.flatten().filter(|value| Some(*value) != self.nodata))
    }

    fn height_without(&self, levels: Option<f64>, area_m2: f64, notes: &mut BTreeSet<Reason>) -> f64 {
        if let Some(levels) = levels {
            notes.insert("height from levels, 3.2 m each");
            return levels * STOREY_M;
        }
        if let Some(height) = self.default_height_m {
            notes.insert("height from default_height");
            return height;
        }
        notes.insert("height from the footprint's area");
        f64::from(storeys_by_area(area_m2)) * STOREY_M
    }

    /// The roof to draw, by attribute or as the section names it; `None` for flat ones, and, noted, for shapes that
    /// cannot be drawn.
    pub fn roof(&self, attributes: &Map<String, Value>, notes: &mut BTreeSet<Reason>) -> Option<RoofRule> {
        let named = attributes.get(&self.roof).map(|value| value.as_str().unwrap_or_default());
        let shape = match named {
            Some(name) => RoofShape::parse(name).or_else(|| {
                notes.insert(DRAWN_FLAT);
                None
            }),
            None => RoofShape::parse(&self.roof),
        };
        shape.filter(|shape| *shape != RoofShape::Flat).map(|shape| RoofRule::new(shape, attributes))
    }

    /// Walls and roof: by the section, by the usual attributes, or by a palette in order of `ordinal`.
    pub fn colors(&self, attributes: &Map<String, Value>, ordinal: u32) -> ([u8; 3], [u8; 3]) {
        let named = |key: &str| attributes.get(key).and_then(Value::as_str).and_then(color::parse);
        let (wall_of_palette, roof) = color::palette(ordinal);
        let by_section = self.color.as_ref().and_then(|color| color::parse(color).or_else(|| named(color)));
        let of = |key: &str| attributes.get(key).and_then(Value::as_str).and_then(color::of_material);
        let wall = by_section.or_else(|| named("building:colour")).or_else(|| named("colour"));
        let wall = wall.or_else(|| of("building:material")).unwrap_or(wall_of_palette);
        (wall, named("roof:colour").or_else(|| of("roof:material")).unwrap_or(roof))
    }

    /// Whether an attribute is kept.
    pub fn keeps(&self, name: &str) -> bool {
        self.keep.as_ref().is_none_or(|names| names.iter().any(|kept| kept == name))
    }

    /// Those of the attributes that [`Rules::colors`] looks at.
    pub fn color_attributes(&self, attributes: &Map<String, Value>) -> Map<String, Value> {
        let usual = ["building:colour", "colour", "roof:colour", "building:material", "roof:material"];
        let names = usual.into_iter().chain(self.color.as_deref());
        names.filter_map(|name| Some((name.to_owned(), attributes.get(name)?.clone()))).collect()
    }

    /// The attributes to keep, as a JSON object.
    pub fn kept(&self, feature: &Feature) -> String {
        let mut kept = Map::new();
        if let Some(id) = &feature.id {
            kept.insert("id".into(), Value::from(id.as_str()));
        }
        if let Some(id) = self.id.as_ref().and_then(|name| feature.attributes.get(name)) {
            kept.insert("id".into(), id.clone());
        }
        for (name, value) in &feature.attributes {
            if self.keeps(name) && !value.is_null() {
                kept.insert(name.clone(), value.clone());
            }
        }
        Value::Object(kept).to_string()
    }
}

/// The level of detail that a section asks for.
pub fn lod(section: &BuildingsSection) -> Result<Option<f64>, PrepareError> {
    let lod = match &section.lod {
        None => return Ok(None),
        Some(Amount::Number(number)) => Some(*number),
        Some(Amount::Text(text)) => text.trim().parse().ok(),
    };
    lod.filter(|lod: &f64| (0.0..5.0).contains(lod)).map(Some).ok_or_else(|| {
        let place = format!("[[buildings]] {:?}, lod", section.name);
        PrepareError::value("the recipe", place, "it is no level of detail", "write lod = 2, or lod = 2.2")
    })
}

/// Storeys where nothing is known but the footprint, the same for the same area: 1 below 48 m², 2 to 134 m², 3 to
/// 380 m², and one more for each factor of 2√2, at most 8.
pub fn storeys_by_area(area_m2: f64) -> u32 {
    (1.0 + ((area_m2 / 17.0).max(1.0).log2() / 1.5)).floor().clamp(1.0, 8.0) as u32
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    fn rules(keys: &str) -> Rules {
        let section: BuildingsSection = toml::from_str(&format!("name = \"a\"\nfile = \"b\"\n{keys}")).unwrap();
        Rules::new(&section, VerticalDatum::Ellipsoid).unwrap()
    }

    fn extent(keys: &str, attributes: Value) -> (Extent, Vec<Reason>) {
        let mut notes = BTreeSet::new();
        let extent = rules(keys).extent(attributes.as_object().unwrap(), 200.0, &mut notes).unwrap();
        (extent, notes.into_iter().collect())
    }

    #[test]
    fn heights_come_from_the_first_that_is_known() {
        assert_eq!(extent("", json!({"height": "12 m"})).0.height_m, 12.0);
        let (by_levels, notes) = extent("", json!({"building:levels": "5"}));
        assert_eq!((by_levels.height_m, notes), (16.0, vec!["height from levels, 3.2 m each"]));
        let (by_default, notes) = extent("default_height = 7", json!({}));
        assert_eq!((by_default.height_m, notes), (7.0, vec!["height from default_height"]));
        let (by_area, notes) = extent("", json!({}));
        assert_eq!((by_area.height_m, notes), (3.0 * STOREY_M, vec!["height from the footprint's area"]));
    }

    #[test]
    fn no_storeys_are_a_counted_default() {
        let (extent, notes) = extent("height = \"storeys * 3.5\"", json!({"storeys": 0}));
        assert!(extent.height_m >= STOREY_M);
        assert_eq!(notes.len(), 2, "{notes:?}");
    }

    #[test]
    fn undersides_stay_below_roofs() {
        assert_eq!(extent("", json!({"height": 20, "min_height": 5})).0.min_height_m, 5.0);
        assert_eq!(extent("", json!({"height": 20, "building:min_level": "2"})).0.min_height_m, 6.4);
        let (turned, notes) = extent("", json!({"height": 5, "min_height": 20}));
        assert_eq!((turned.min_height_m, notes.len()), (0.0, 1));
    }

    #[test]
    fn wrong_types_are_errors() {
        let attributes = json!({"height": [1]});
        assert!(rules("").extent(attributes.as_object().unwrap(), 1.0, &mut BTreeSet::new()).is_err());
        let section: BuildingsSection = toml::from_str("name = \"a\"\nfile = \"b\"\nheight = \"3 *\"").unwrap();
        assert!(Rules::new(&section, VerticalDatum::Ellipsoid).is_err());
    }

    #[test]
    fn storeys_grow_with_the_footprint() {
        let storeys: Vec<_> = [0.0, 30.0, 100.0, 300.0, 1000.0, 1e9].map(storeys_by_area).to_vec();
        assert_eq!(storeys, [1, 1, 2, 3, 4, 8]);
    }
}
