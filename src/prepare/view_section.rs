//! `[[view]]` of a recipe: a bookmark of the world.

use crate::store::NamedView;
use serde::Deserialize;
use toml::Spanned;

/// `[[view]]`: where the eye is and where it looks; ranges are those of [`NamedView`].
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ViewSection {
    /// With its place in the text, for messages.
    pub name: Spanned<String>,
    pub lon_deg: f64,
    pub lat_deg: f64,
    /// Of the eye, above the ellipsoid, metres.
    pub height_m: f64,
    /// Clockwise from north; north by default.
    #[serde(default)]
    pub heading_deg: f64,
    /// Up from the horizon; straight down by default.
    #[serde(default = "NamedView::straight_down_deg")]
    pub pitch_deg: f64,
}

impl ViewSection {
    pub fn to_view(&self) -> NamedView {
        NamedView {
            name: self.name.get_ref().clone(),
            lon_deg: self.lon_deg,
            lat_deg: self.lat_deg,
            height_m: self.height_m,
            heading_deg: self.heading_deg,
            pitch_deg: self.pitch_deg,
        }
    }
}

/// The first thing wrong with a recipe's views, and the byte of the recipe where that view has its name.
pub fn fault(sections: &[ViewSection]) -> Option<(usize, String)> {
    sections.iter().enumerate().find_map(|(at, section)| {
        let name = section.name.get_ref();
        let is_double = sections[..at].iter().any(|other| other.name.get_ref() == name);
        let what = match section.to_view().check() {
            Err(what) => what,
            Ok(()) if is_double => "another view has the same name; names must differ".to_owned(),
            Ok(()) => return None,
        };
        Some((section.name.span().start, format!("[[view]] {name:?}: {what}")))
    })
}

#[cfg(test)]
mod tests {
    use super::super::Recipe;
    use std::path::Path;

    fn parse(views: &str) -> Result<Recipe, String> {
        let text = format!("name = \"x\"\n[[elevation]]\nfile = \"a\"\n{views}");
        Recipe::parse(&text, Path::new("r.toml")).map_err(|e| e.to_string())
    }

    #[test]
    fn views_are_read_and_what_they_leave_out_looks_north_and_down() {
        let recipe = parse(
            "[[view]]\nname = \"Above\"\nlon_deg = 25\nlat_deg = 60.5\nheight_m = 1000\n\
             [[view]]\nname = \"Ahead\"\nlon_deg = -190.0\nlat_deg = -90\nheight_m = -50\nheading_deg = -90\npitch_deg = 5",
        )
        .expect("sound");
        let views = recipe.views();
        let read: Vec<_> =
            views.iter().map(|v| (&*v.name, [v.lon_deg, v.lat_deg, v.height_m, v.heading_deg, v.pitch_deg])).collect();
        assert_eq!(read, [("Above", [25.0, 60.5, 1000.0, 0.0, -90.0]), ("Ahead", [-190.0, -90.0, -50.0, -90.0, 5.0])]);
    }

    #[test]
    fn a_bad_view_is_named_with_its_file_line_and_table() {
        let view = |change: &str| {
            let sound = ["name = \"A\"", "lon_deg = 1", "lat_deg = 2", "height_m = 3"];
            let key = change.split(' ').next().expect("a key");
            let mut lines: Vec<&str> = sound.into_iter().filter(|line| !line.starts_with(key)).collect();
            lines.push(change);
            format!("[[view]]\n{}\n", lines.join("\n"))
        };
        for (change, says) in [
            ("lat_deg = 91", "lat_deg = 91 is not from -90 to 90"),
            ("lon_deg = nan", "lon_deg = NaN is not from -360 to 360"),
            ("height_m = 1e9", "height_m = 1000000000 is not from"),
            ("height_m = -13000", "height_m = -13000 is not from"),
            ("heading_deg = inf", "heading_deg = inf is not from"),
            ("pitch_deg = -90.5", "pitch_deg = -90.5 is not from -90 to 90"),
            ("name = \" \"", "name = \" \" is not of 1 to"),
        ] {
            let sound = view("name = \"First\"");
            let error = parse(&format!("{sound}{}", view(change))).expect_err(change);
            // The second view's table begins in line 9; the error points at its name.
            let line = if change.starts_with("name") { 13 } else { 10 };
            assert!(error.starts_with(&format!("r.toml, line {line}: [[view]] ")), "{change}: {error}");
            assert!(error.contains(says), "{change}: {error}");
        }
        let twice = format!("{}{}", view("pitch_deg = 0"), view("pitch_deg = 1"));
        let error = parse(&twice).expect_err("two of a name");
        assert!(error.contains("[[view]] \"A\": another view has the same name"), "{error}");
        let error = parse(&view("picth_deg = 0")).expect_err("typo");
        assert!(error.contains("line 9: unknown key `picth_deg`; did you mean `pitch_deg`?"), "{error}");
        let error = parse("[[view]]\nname = \"A\"\nlon_deg = 1\nlat_deg = 2").expect_err("no height");
        assert!(error.contains("line 4") && error.contains("missing field `height_m`"), "{error}");
    }
}
