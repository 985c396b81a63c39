//! Which kind of JSON a file holds.

use serde::de::{Deserializer, IgnoredAny, MapAccess, Visitor};
use std::fmt;
use std::io::Read;

/// Whether a file's first document is CityJSON: reads no further than to the first member that tells.
pub fn is_cityjson(reader: impl Read) -> bool {
    let mut told = false;
    // Where it is no JSON, the reader of GeoJSON says so better.
    let _ = serde_json::Deserializer::from_reader(reader).deserialize_map(Members(&mut told));
    told
}

struct Members<'a>(&'a mut bool);

impl<'de> Visitor<'de> for Members<'_> {
    type Value = ();

    fn expecting(&self, f: &mut fmt::Formatter) -> fmt::Result {
        f.write_str("an object")
    }

    fn visit_map<M: MapAccess<'de>>(self, mut map: M) -> Result<(), M::Error> {
        use serde::de::Error;
        while let Some(key) = map.next_key::<String>()? {
            let kind = match key.as_str() {
                "type" => map.next_value::<serde_json::Value>()?.as_str().map(str::to_owned),
                "CityObjects" | "vertices" => Some("CityJSON".into()),
                "features" | "geometry" => Some("GeoJSON".into()),
                _ => map.next_value::<IgnoredAny>().map(|_| None)?,
            };
            if let Some(kind) = kind {
                *self.0 = kind.starts_with("CityJSON");
                return Err(M::Error::custom("known"));
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_first_member_that_tells_tells() {
        let cases = [
            (r#"{"version": "2.0", "CityObjects": {}, "type": "CityJSON"}"#, true),
            (r#"{"type": "CityJSON", "features": []}"#, true),
            (r#"{"type": "FeatureCollection", "features": []}"#, false),
            (r#"{"name": "x", "features": [{"type": "CityJSON"}]}"#, false),
            ("[1, 2]", false),
            ("", false),
        ];
        for (text, expected) in cases {
            assert_eq!(is_cityjson(text.as_bytes()), expected, "{text}");
        }
    }
}
