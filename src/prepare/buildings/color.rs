//! Colours of walls and roofs.

/// Colours as OpenStreetMap's mappers name them (CSS), sRGB.
const NAMES: [(&str, [u8; 3]); 24] = [
    ("white", [255, 255, 255]),
    ("black", [30, 30, 30]),
    ("gray", [128, 128, 128]),
    ("grey", [128, 128, 128]),
    ("lightgray", [211, 211, 211]),
    ("lightgrey", [211, 211, 211]),
    ("darkgray", [110, 110, 110]),
    ("darkgrey", [110, 110, 110]),
    ("silver", [192, 192, 192]),
    ("red", [176, 60, 48]),
    ("maroon", [128, 0, 0]),
    ("brown", [140, 84, 60]),
    ("orange", [222, 150, 80]),
    ("yellow", [230, 205, 120]),
    ("beige", [235, 225, 200]),
    ("ivory", [250, 245, 225]),
    ("tan", [210, 180, 140]),
    ("pink", [232, 190, 180]),
    ("green", [90, 130, 90]),
    ("lightgreen", [160, 200, 160]),
    ("blue", [90, 115, 160]),
    ("lightblue", [173, 200, 220]),
    ("purple", [120, 90, 130]),
    ("gold", [212, 175, 55]),
];

/// Materials of walls and roofs (OpenStreetMap's `building:material` and `roof:material`), sRGB.
const MATERIALS: [(&str, [u8; 3]); 24] = [
    ("brick", [168, 96, 72]),
    ("bronze", [150, 116, 74]),
    ("cement_block", [172, 170, 164]),
    ("concrete", [186, 184, 178]),
    ("copper", [120, 164, 142]),
    ("eternit", [150, 148, 146]),
    ("glass", [138, 164, 184]),
    ("grass", [112, 142, 84]),
    ("gravel", [156, 150, 140]),
    ("limestone", [214, 204, 180]),
    ("marble", [228, 224, 218]),
    ("metal", [164, 168, 172]),
    ("metal_sheet", [160, 164, 168]),
    ("plaster", [222, 214, 198]),
    ("roof_tiles", [164, 88, 66]),
    ("sandstone", [206, 182, 142]),
    ("slate", [92, 96, 104]),
    ("solar_panels", [48, 58, 88]),
    ("steel", [160, 164, 170]),
    ("stone", [184, 176, 160]),
    ("tar_paper", [84, 82, 80]),
    ("thatch", [150, 126, 88]),
    ("tile", [164, 88, 66]),
    ("wood", [146, 108, 74]),
];

/// The colour of a material; `None` for one that is not known.
pub fn of_material(name: &str) -> Option<[u8; 3]> {
    let name = name.trim().to_ascii_lowercase();
    MATERIALS.iter().find(|(known, _)| *known == name).map(|(_, color)| *color)
}

/// `#rgb`, `#rrggbb`, or a name; `None` for anything else.
pub fn parse(text: &str) -> Option<[u8; 3]> {
    let text = text.trim().to_ascii_lowercase();
    let Some(digits) = text.strip_prefix('#') else {
        let name = text.replace(['_', ' ', '-'], "");
        return NAMES.iter().find(|(known, _)| *known == name).map(|(_, color)| *color);
    };
    let bits = u32::from_str_radix(digits, 16).ok()?;
    match digits.len() {
        3 => Some([bits >> 8 & 15, bits >> 4 & 15, bits & 15].map(|nibble| (nibble * 17) as u8)),
        6 => Some([(bits >> 16) as u8, (bits >> 8) as u8, bits as u8]),
        _ => None,
    }
}

/// Plaster, brick, stone and concrete.
const WALLS: [[u8; 3]; 10] = [
    [214, 203, 184],
    [199, 186, 165],
    [186, 160, 138],
    [171, 130, 108],
    [205, 196, 186],
    [178, 176, 172],
    [222, 210, 178],
    [193, 174, 160],
    [160, 150, 142],
    [210, 190, 170],
];
/// Tar, gravel, metal and tiles.
const ROOFS: [[u8; 3]; 6] =
    [[120, 116, 112], [142, 138, 132], [104, 98, 94], [134, 104, 90], [155, 152, 148], [112, 118, 118]];

/// Walls and roof of the object with this number: always the same, and neighbours differ.
pub fn palette(ordinal: u32) -> ([u8; 3], [u8; 3]) {
    let bits = scatter(u64::from(ordinal));
    let shade = 232 + (bits >> 40 & 31) as u32;
    let shaded = |color: [u8; 3]| color.map(|c| (u32::from(c) * shade / 256).min(255) as u8);
    (shaded(WALLS[(bits % 10) as usize]), shaded(ROOFS[(bits >> 20) as usize % 6]))
}

/// SplitMix64's output function (Steele, Lea, Flood 2014).
fn scatter(ordinal: u64) -> u64 {
    let mut z = ordinal.wrapping_add(1).wrapping_mul(0x9e37_79b9_7f4a_7c15);
    z = (z ^ z >> 30).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ z >> 27).wrapping_mul(0x94d0_49bb_1331_11eb);
    z ^ z >> 31
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn colours_as_people_write_them() {
        assert_eq!(parse("#fff"), Some([255; 3]));
        assert_eq!(parse("#10203F"), Some([16, 32, 63]));
        assert_eq!(parse("Light_Grey"), Some([211; 3]));
        for text in ["", "#", "#12", "#zzzzzz", "striped", "#1234567"] {
            assert_eq!(parse(text), None, "{text}");
        }
        assert!(of_material("Slate").is_some() && of_material("cheese").is_none());
    }
}
