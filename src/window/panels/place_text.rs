//! Reads places as people write them: `60.17, 24.95`, `60°10'12"N 24°57'E 400 m`, or the name of a bookmark.

use super::place_tokens::{Token, tokens};
use crate::geodesy::Geodetic;

/// Heights above ground that one may ask for, metres.
pub const HEIGHT_M: [f64; 2] = [1.0, 4e7];
/// A longer text is no place.
pub const PLACE_CHARS_MAX: usize = 120;

/// A place to fly to.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Place {
    /// −π/2 to π/2.
    pub lat_rad: f64,
    /// −π to π.
    pub lon_rad: f64,
    /// Above ground, metres, 1 to 4e7; `None` leaves it to the flight.
    pub above_ground_m: Option<f64>,
}

/// What a text names.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Named {
    Place(Place),
    /// An index into the bookmarks.
    Bookmark(usize),
}

#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum PlaceError {
    #[error("write a latitude and a longitude, such as 60.17, 24.95, or a bookmark's name")]
    Expected,
    #[error("{0:?} is no bookmark and no place: write a latitude and a longitude, such as 60.17, 24.95")]
    Unknown(String),
    #[error("{0} or {1}? Write more of the name")]
    Ambiguous(String, String),
    #[error("the longitude is missing: write both, such as 60.17, 24.95")]
    OneNumber,
    #[error("the latitude {0} is not from -90 to 90; it comes before the longitude")]
    Latitude(f64),
    #[error("the longitude {0} is not from -180 to 180")]
    Longitude(f64),
    #[error("minutes and seconds are from 0 to 60, and only the last part has a fraction: 60°10'12.5\"N")]
    Sexagesimal,
    #[error("write a sign or one of N, S, E, W, not both")]
    SignAndLetter,
    #[error("one latitude (N or S) and one longitude (E or W) make a place")]
    Letters,
    #[error("the height {0} m is not from 1 to 40,000,000 m above ground")]
    Height(f64),
}

/// Reads a place. Names of bookmarks match by their beginning, in any case; a whole name wins over beginnings.
pub fn parse_place(text: &str, bookmarks: &[String]) -> Result<Named, PlaceError> {
    let text = text.trim();
    if text.is_empty() {
        return Err(PlaceError::Expected);
    }
    if let Some(index) = bookmark(text, bookmarks)? {
        return Ok(Named::Bookmark(index));
    }
    let unknown = || PlaceError::Unknown(text.chars().take(24).collect());
    if text.chars().count() > PLACE_CHARS_MAX {
        return Err(unknown());
    }
    coordinates(&tokens(text).ok_or_else(unknown)?).map(Named::Place)
}

fn bookmark(text: &str, bookmarks: &[String]) -> Result<Option<usize>, PlaceError> {
    let wanted = text.to_lowercase();
    let names: Vec<String> = bookmarks.iter().map(|name| name.to_lowercase()).collect();
    if let Some(whole) = names.iter().position(|name| *name == wanted) {
        return Ok(Some(whole));
    }
    let mut begun = (0..names.len()).filter(|&at| names[at].starts_with(&wanted));
    match (begun.next(), begun.next()) {
        (Some(one), Some(other)) => Err(PlaceError::Ambiguous(bookmarks[one].clone(), bookmarks[other].clone())),
        (one, _) => Ok(one),
    }
}

/// One angle or height with what stands beside it.
#[derive(Debug, Default)]
struct Group {
    /// N, S, E or W.
    letter: Option<char>,
    /// Degrees, minutes, seconds; with whether each is whole.
    parts: Vec<(f64, bool)>,
    is_signed: bool,
    is_negative: bool,
    /// Parts that a mark or colon ended.
    marked: usize,
    /// A mark that asks for the next part.
    is_open: bool,
    unit_m: Option<f64>,
}

fn coordinates(tokens: &[Token]) -> Result<Place, PlaceError> {
    let (mut lat_deg, mut lon_deg, mut height_m) = (None, None, None);
    for group in groups(tokens)? {
        if let Some(unit_m) = group.unit_m {
            set(&mut height_m, group.plain()? * unit_m)?;
            continue;
        }
        match group.letter {
            Some('N' | 'S') => set(&mut lat_deg, group.angle_deg()?)?,
            Some(_) => set(&mut lon_deg, group.angle_deg()?)?,
            None if lat_deg.is_none() => lat_deg = Some(group.angle_deg()?),
            None if lon_deg.is_none() => lon_deg = Some(group.angle_deg()?),
            None => set(&mut height_m, group.plain()?)?,
        }
    }
    match (lat_deg, lon_deg) {
        (Some(lat_deg), Some(lon_deg)) => place(lat_deg, lon_deg, height_m),
        (None, None) => Err(PlaceError::Expected),
        _ => Err(PlaceError::OneNumber),
    }
}

fn set(slot: &mut Option<f64>, value: f64) -> Result<(), PlaceError> {
    if slot.replace(value).is_some() { Err(PlaceError::Letters) } else { Ok(()) }
}

fn place(lat_deg: f64, lon_deg: f64, above_ground_m: Option<f64>) -> Result<Place, PlaceError> {
    if !(-90.0..=90.0).contains(&lat_deg) {
        return Err(PlaceError::Latitude(lat_deg));
    }
    if !(-180.0..=180.0).contains(&lon_deg) {
        return Err(PlaceError::Longitude(lon_deg));
    }
    if let Some(height_m) = above_ground_m.filter(|height_m| !(HEIGHT_M[0]..=HEIGHT_M[1]).contains(height_m)) {
        return Err(PlaceError::Height(height_m));
    }
    let Geodetic { lat_rad, lon_rad, .. } = Geodetic::from_degrees(lat_deg, lon_deg, 0.0);
    Ok(Place { lat_rad, lon_rad, above_ground_m })
}

/// Numbers grouped into angles: by commas, by letters before or after them, by marks, else one by one.
fn groups(tokens: &[Token]) -> Result<Vec<Group>, PlaceError> {
    let letters_lead = matches!(tokens.first(), Some(Token::Letter(_)));
    let letters_follow = !letters_lead && tokens.iter().any(|token| matches!(token, Token::Letter(_)));
    // `60 10 12 N`: what stands before the last letter and has no letter of its own belongs to the next one.
    let last_letter = tokens.iter().rposition(|token| matches!(token, Token::Letter(_))).unwrap_or(0);
    let mut done = Vec::new();
    let mut open = Group::default();
    for (at, token) in tokens.iter().enumerate() {
        match *token {
            Token::Comma => close(&mut open, &mut done),
            Token::Letter(letter) => {
                if letters_lead {
                    close(&mut open, &mut done);
                }
                if open.letter.replace(letter).is_some() || (!letters_lead && open.parts.is_empty()) {
                    return Err(PlaceError::Letters);
                }
                if !letters_lead {
                    close(&mut open, &mut done);
                }
            }
            Token::Number { value, is_signed, is_whole } => {
                let waits_for_letter = letters_follow && at < last_letter && !is_signed;
                let goes_on = open.parts.is_empty() || (!is_signed && (open.is_open || waits_for_letter));
                if !goes_on {
                    close(&mut open, &mut done);
                }
                open.push(value, is_signed, is_whole);
            }
            Token::Mark(part) => open.mark(part)?,
            Token::Colon => open.mark(open.parts.len())?,
            Token::Unit(metres) => {
                open.unit_m = Some(metres);
                close(&mut open, &mut done);
            }
        }
    }
    close(&mut open, &mut done);
    Ok(done)
}

fn close(open: &mut Group, done: &mut Vec<Group>) {
    let group = std::mem::take(open);
    if !group.parts.is_empty() || group.letter.is_some() || group.unit_m.is_some() {
        done.push(group);
    }
}

impl Group {
    fn push(&mut self, value: f64, is_signed: bool, is_whole: bool) {
        if self.parts.is_empty() {
            self.is_signed = is_signed;
            // The sign of −0°30' counts too.
            self.is_negative = value.is_sign_negative();
        }
        self.parts.push((value.abs(), is_whole));
        self.is_open = false;
    }

    /// Degrees, minutes and seconds come in order, each with its own mark.
    fn mark(&mut self, part: usize) -> Result<(), PlaceError> {
        if part != self.parts.len() || part <= self.marked || part == 0 {
            return Err(PlaceError::Sexagesimal);
        }
        self.marked = part;
        self.is_open = part < 3;
        Ok(())
    }

    /// A single number without marks or letters.
    fn plain(&self) -> Result<f64, PlaceError> {
        match (self.parts.as_slice(), self.letter, self.marked) {
            (&[(value, _)], None, 0) => Ok(if self.is_negative { -value } else { value }),
            _ => Err(PlaceError::Letters),
        }
    }

    fn angle_deg(&self) -> Result<f64, PlaceError> {
        if self.parts.is_empty() {
            return Err(PlaceError::Letters);
        }
        let fits = |(at, &(value, is_whole)): (usize, &(f64, bool))| {
            (at == 0 || value < 60.0) && (is_whole || at + 1 == self.parts.len())
        };
        if self.parts.len() > 3 || !self.parts.iter().enumerate().all(fits) {
            return Err(PlaceError::Sexagesimal);
        }
        if self.letter.is_some() && self.is_signed {
            return Err(PlaceError::SignAndLetter);
        }
        let degrees = self.parts.iter().rev().fold(0.0, |finer, (value, _)| value + finer / 60.0);
        let is_negative = self.is_negative || matches!(self.letter, Some('S' | 'W'));
        Ok(if is_negative { -degrees } else { degrees })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn names() -> Vec<String> {
        ["Globe", "Helsinki", "Golden Gate", "Golden"].map(str::to_owned).into()
    }

    fn degrees(text: &str) -> Result<(f64, f64, Option<f64>), PlaceError> {
        match parse_place(text, &names())? {
            Named::Place(place) => Ok((place.lat_rad.to_degrees(), place.lon_rad.to_degrees(), place.above_ground_m)),
            Named::Bookmark(at) => panic!("{text} is bookmark {at}"),
        }
    }

    #[test]
    fn places_are_read_as_people_write_them() {
        let helsinki = (60.17, 24.95, None);
        for (text, expected) in [
            ("60.17, 24.95", helsinki),
            ("60.17 24.95", helsinki),
            ("  60.17;24.95 ", helsinki),
            ("60,17 24,95", helsinki),
            ("60,17 24,95 400", (60.17, 24.95, Some(400.0))),
            ("60.17 24.95 400", (60.17, 24.95, Some(400.0))),
            ("60.17, 24.95, 1.5 km", (60.17, 24.95, Some(1500.0))),
            ("60.17N 24.95E", helsinki),
            ("24.95 e 60.17 n", helsinki),
            ("N60.17 E24.95", helsinki),
            ("N 60.17, E 24.95, 400m", (60.17, 24.95, Some(400.0))),
            ("N60 E24 400", (60.0, 24.0, Some(400.0))),
            ("60°10'12\"N 24°57'E", helsinki),
            ("60° 10′ 12″ N, 24° 57′ 0″ E, 400", (60.17, 24.95, Some(400.0))),
            ("60 10 12 N 24 57 0 E 400", (60.17, 24.95, Some(400.0))),
            ("60:10:12, 24:57", helsinki),
            ("60° 10.2', 24° 57.0'", helsinki),
            ("N60°10'12\" E24°57'", helsinki),
            ("34.5S 58.25W", (-34.5, -58.25, None)),
            ("-34.5 -58.25", (-34.5, -58.25, None)),
            ("−0°30' , +1", (-0.5, 1.0, None)),
            ("90 -180 1", (90.0, -180.0, Some(1.0))),
        ] {
            let (lat, lon, height) = degrees(text).unwrap_or_else(|error| panic!("{text}: {error}"));
            assert!((lat - expected.0).abs() < 1e-9 && (lon - expected.1).abs() < 1e-9, "{text}: {lat} {lon}");
            assert_eq!(height, expected.2, "{text}");
        }
    }

    #[test]
    fn wrong_places_say_what_is_wrong() {
        use PlaceError::*;
        for (text, expected) in [
            ("", Expected),
            ("60.17", OneNumber),
            ("60N 61N", Letters),
            ("60N", OneNumber),
            ("N E", Letters),
            ("124.95, 60.17", Latitude(124.95)),
            ("60, 181", Longitude(181.0)),
            ("60°61'N 24E", Sexagesimal),
            ("60.5°30'N 24E", Sexagesimal),
            ("60'N 24E", Sexagesimal),
            ("-60N 24E", SignAndLetter),
            ("60 24 0", Height(0.0)),
            ("60 24 -5", Height(-5.0)),
            ("60 24 50000000", Height(5e7)),
            ("60 24 100 100", Letters),
            ("60 24 99999 km", Height(99_999_000.0)),
            ("atlantis", Unknown("atlantis".into())),
            ("60..1 24", Unknown("60..1 24".into())),
        ] {
            assert_eq!(parse_place(text, &names()), Err(expected), "{text}");
        }
    }

    #[test]
    fn bookmarks_are_found_by_their_beginning() {
        for (text, index) in [("hel", 1), ("GLOBE", 0), ("golden g", 2), ("Golden", 3), ("golden", 3)] {
            assert_eq!(parse_place(text, &names()), Ok(Named::Bookmark(index)), "{text}");
        }
        let ambiguous = parse_place("g", &names());
        assert_eq!(ambiguous, Err(PlaceError::Ambiguous("Globe".into(), "Golden Gate".into())));
    }

    proptest::proptest! {
        #[test]
        fn no_text_panics_and_every_place_is_on_earth(text in "[-0-9 .,;:NSEWm°'\"k+]{0,40}") {
            if let Ok(Named::Place(place)) = parse_place(&text, &names()) {
                assert!(place.lat_rad.abs() <= std::f64::consts::FRAC_PI_2, "{text}");
                assert!(place.lon_rad.abs() <= std::f64::consts::PI, "{text}");
                assert!(place.above_ground_m.is_none_or(|m| (1.0..=4e7).contains(&m)), "{text}");
            }
        }

        #[test]
        fn written_places_come_back(lat in -90.0..90.0f64, lon in -180.0..180.0f64) {
            let (read_lat, read_lon, _) = degrees(&format!("{lat:.7}, {lon:.7}")).unwrap();
            assert!((read_lat - lat).abs() < 1e-7 && (read_lon - lon).abs() < 1e-7);
        }
    }
}
