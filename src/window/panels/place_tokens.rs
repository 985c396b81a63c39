//! Splits a text of coordinates into numbers, marks and letters.

/// A text with more is no place.
const TOKENS_MAX: usize = 32;

#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Token {
    Number {
        value: f64,
        is_signed: bool,
        is_whole: bool,
    },
    /// Ends degrees (1) or minutes (2) or seconds (3).
    Mark(usize),
    /// `:` after degrees or minutes.
    Colon,
    /// N, S, E or W.
    Letter(char),
    /// Metres in one unit.
    Unit(f64),
    Comma,
}

/// `None` where a character or word belongs to no place.
pub(super) fn tokens(text: &str) -> Option<Vec<Token>> {
    let text = with_points(text).replace('−', "-").replace("''", "″");
    let mut rest = text.trim();
    let mut out = Vec::new();
    while let Some(first) = rest.chars().next() {
        if out.len() == TOKENS_MAX {
            return None;
        }
        let (token, used) = match first {
            '0'..='9' | '.' | '-' | '+' => number(rest)?,
            '°' | 'º' => (Token::Mark(1), first.len_utf8()),
            '\'' | '′' | '’' => (Token::Mark(2), first.len_utf8()),
            '"' | '″' | '”' => (Token::Mark(3), first.len_utf8()),
            ':' => (Token::Colon, 1),
            ',' | ';' => (Token::Comma, 1),
            _ => word(rest)?,
        };
        out.push(token);
        rest = rest[used..].trim_start();
    }
    Some(out)
}

/// `60,17 24,95` has commas for points: so read where each of the first two words holds exactly one, between digits.
fn with_points(text: &str) -> String {
    let words: Vec<&str> = text.split([' ', ';']).filter(|word| !word.is_empty()).collect();
    let has_decimal_comma = |word: &&str| {
        let parts: Vec<&str> = word.split(',').collect();
        let are_digits = |part: &str| !part.is_empty() && part.bytes().all(|b| b.is_ascii_digit());
        let [whole, fraction] = parts[..] else { return false };
        are_digits(whole.trim_start_matches(['-', '−', '+'])) && are_digits(fraction)
    };
    let is_meant = (2..=3).contains(&words.len()) && words.iter().take(2).all(has_decimal_comma);
    if is_meant { words.join(" ").replace(',', ".") } else { text.to_owned() }
}

fn number(text: &str) -> Option<(Token, usize)> {
    let is_signed = text.starts_with(['-', '+']);
    let sign = usize::from(is_signed);
    let digits = text[sign..].find(|c: char| !c.is_ascii_digit() && c != '.').map_or(text.len(), |end| end + sign);
    let value: f64 = text[..digits].parse().ok()?;
    Some((Token::Number { value, is_signed, is_whole: !text[..digits].contains('.') }, digits))
}

fn word(text: &str) -> Option<(Token, usize)> {
    let end = text.find(|c: char| !c.is_alphabetic()).unwrap_or(text.len());
    let token = match text[..end].to_ascii_uppercase().as_str() {
        "N" => Token::Letter('N'),
        "S" => Token::Letter('S'),
        "E" => Token::Letter('E'),
        "W" => Token::Letter('W'),
        "M" => Token::Unit(1.0),
        "KM" => Token::Unit(1000.0),
        _ => return None,
    };
    Some((token, end))
}
