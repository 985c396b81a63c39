//! Numbers as people read them. Every one takes any number, NaN and infinities included.

use crate::geodesy::Geodetic;

/// What stands for a number that is not known.
pub(super) const UNKNOWN: &str = "–";
/// A longer name is cut.
pub(super) const NAME_CHARS: usize = 28;

/// `60.16990° N  24.93840° E`, with as many decimals as a metre needs.
pub(super) fn place(place: Geodetic) -> String {
    let half = |degrees: f64, [positive, negative]: [char; 2]| {
        let letter = if degrees < 0.0 { negative } else { positive };
        format!("{:.5}° {letter}", degrees.abs())
    };
    if !(place.lat_rad.is_finite() && place.lon_rad.is_finite()) {
        return UNKNOWN.to_owned();
    }
    format!("{}  {}", half(place.lat_deg(), ['N', 'S']), half(place.lon_deg(), ['E', 'W']))
}

/// Metres below 10 km, else kilometres: `12.3 m`, `470 m`, `48.1 km`, `12 000 km`.
pub(super) fn metres(metres: f64) -> String {
    let size = metres.abs();
    if !metres.is_finite() {
        UNKNOWN.to_owned()
    } else if size < 99.95 {
        format!("{metres:.1} m")
    } else if size < 9_999.5 {
        format!("{} m", grouped(metres))
    } else if size < 99_950.0 {
        format!("{:.1} km", metres / 1000.0)
    } else if size < 1e13 {
        format!("{} km", grouped(metres / 1000.0))
    } else {
        format!("{:.1e} km", metres / 1000.0)
    }
}

/// Rounded, with thin groups of three: `12 000`.
fn grouped(value: f64) -> String {
    let digits = format!("{:.0}", value.abs());
    let mut out = String::from(if value < 0.0 { "-" } else { "" });
    for (at, digit) in digits.chars().enumerate() {
        if at > 0 && (digits.len() - at).is_multiple_of(3) && digits.len() > 4 {
            out.push('\u{2009}');
        }
        out.push(digit);
    }
    out
}

/// Three digits and a multiple: `812`, `12.4 k`, `3.10 M`.
pub(super) fn count(count: u64) -> String {
    let value = count as f64;
    match count {
        0..1000 => count.to_string(),
        _ if value < 99_950.0 => format!("{:.1} k", value / 1e3),
        _ if value < 999_500.0 => format!("{:.0} k", value / 1e3),
        _ if value < 99_950_000.0 => format!("{:.2} M", value / 1e6),
        _ if value < 9.995e8 => format!("{:.0} M", value / 1e6),
        _ => format!("{:.1} G", value / 1e9),
    }
}

/// Milliseconds: `16.7 ms`, `1.25 s`.
pub(super) fn millis(millis: f64) -> String {
    match millis.abs() {
        size if size < 999.5 => format!("{millis:.1} ms"),
        size if size < 1e8 => format!("{:.2} s", millis / 1000.0),
        _ => UNKNOWN.to_owned(),
    }
}

/// `0.25 px`, `12 px`.
pub(super) fn pixels(pixels: f64) -> String {
    match pixels.abs() {
        size if size < 9.995 => format!("{pixels:.2} px"),
        size if size < 1e5 => format!("{pixels:.0} px"),
        size if size.is_finite() => format!("{pixels:.0e} px"),
        _ => UNKNOWN.to_owned(),
    }
}

/// `0:07`, `12:34`, hours as minutes.
pub(super) fn clock(seconds: f64) -> String {
    if !(0.0..1e7).contains(&seconds) {
        return UNKNOWN.to_owned();
    }
    let whole = seconds as u64;
    format!("{}:{:02}", whole / 60, whole % 60)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_read_well() {
        assert_eq!(place(Geodetic::from_degrees(-60.1699, 24.9384, 0.0)), "60.16990° S  24.93840° E");
        assert_eq!(place(Geodetic::from_degrees(f64::NAN, 0.0, 0.0)), UNKNOWN);
        for (value, text) in [
            (0.0, "0.0 m"),
            (-3.25, "-3.2 m"),
            (99.96, "100 m"),
            (9_999.9, "10.0 km"),
            (470.4, "470 m"),
            (48_123.0, "48.1 km"),
            (1.2e7, "12\u{2009}000 km"),
            (f64::INFINITY, UNKNOWN),
            (1e300, "1.0e297 km"),
        ] {
            assert_eq!(metres(value), text, "{value}");
        }
        for (value, text) in
            [(0, "0"), (999, "999"), (12_440, "12.4 k"), (999_999, "1.00 M"), (u64::MAX, "18446744073.7 G")]
        {
            assert_eq!(count(value), text);
        }
        for (value, text) in [(16.67, "16.7 ms"), (1250.0, "1.25 s"), (f64::NAN, UNKNOWN)] {
            assert_eq!(millis(value), text);
        }
        for (value, text) in [(0.25, "0.25 px"), (12.2, "12 px"), (1e9, "1e9 px"), (f64::NAN, UNKNOWN)] {
            assert_eq!(pixels(value), text);
        }
        for (value, text) in [(7.9, "0:07"), (754.0, "12:34"), (-1.0, UNKNOWN), (f64::NAN, UNKNOWN)] {
            assert_eq!(clock(value), text);
        }
    }
}
