//! The rows of `STABILITY.md`: written by what measures them, and compared with the page.

use std::fmt;
use std::path::PathBuf;

/// What a case found.
#[derive(Clone, Debug)]
pub struct Row {
    pub case: &'static str,
    /// The usual method, and how it fails.
    pub usual: String,
    pub ours: String,
    /// How far ours can be pushed, with a unit.
    pub limit: String,
}

impl fmt::Display for Row {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "| {} | {} | {} | {} |", self.case, self.usual, self.ours, self.limit)
    }
}

/// Figures may differ by this share from machine to machine: sines differ in their last bits, and searches with them.
const FIGURES_SHARE: f64 = 0.1;
const WRITE: &str = "STOOP_WRITE_STABILITY";

const HEAD: &str = "# Where numbers and methods fail

Each row is a test in `tests/stability.rs`: it runs the usual method and shows where it fails, runs ours over the same,
and searches how far ours can be pushed. The figures below are those that the tests measure; one of them compares this
page with them. To write it anew:

```sh
STOOP_WRITE_STABILITY=1 cargo test --release --test stability
```

Flights are by the virtual clock over made-up worlds, 640 × 360 pixels, tolerance 1 px, 30 frames a second where nothing
else is said; *debt* is the screen's mean error in excess of the tolerance. Figures follow from the input alone: no
row depends on how fast a machine is.

| case | usual method | ours | ours can be pushed to |
|---|---|---|---|
";

const TAIL: &str = "
What ours does not do as it should:

- A spike that could be a height on Earth (below 20 km) is taken as one; `clamp_m` in the recipe holds heights of a source
  between limits.
- Where half of all reads fail, a front is not whole a minute later: the wait before a page is tried again doubles with
  each failure, up to 30 s.
";

fn page_file() -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("STABILITY.md")
}

/// Compares the page with the rows, or writes it where that is asked for.
pub fn assert_page(rows: &[&Row]) {
    let lines: Vec<String> = rows.iter().map(ToString::to_string).collect();
    if std::env::var_os(WRITE).is_some() {
        std::fs::write(page_file(), format!("{HEAD}{}\n{TAIL}", lines.join("\n"))).unwrap();
        return;
    }
    let page = std::fs::read_to_string(page_file()).unwrap_or_default();
    let known: Vec<&str> =
        page.lines().skip_while(|line| !line.starts_with("|---")).skip(1).take_while(|l| l.starts_with('|')).collect();
    assert_eq!(known.len(), lines.len(), "rows of {}; to write it anew set {WRITE}=1", page_file().display());
    for (known, measured) in known.iter().zip(&lines) {
        assert!(agree(known, measured), "the page says\n{known}\nand measured is\n{measured}\nSet {WRITE}=1");
    }
}

/// Whether two rows have the same words, and nearly the same figures.
fn agree(a: &str, b: &str) -> bool {
    let words = |text: &str| text.split_whitespace().map(str::to_owned).collect::<Vec<_>>();
    let (a, b) = (words(a), words(b));
    a.len() == b.len() && a.iter().zip(&b).all(|(a, b)| a == b || figures_agree(a, b))
}

fn figures_agree(a: &str, b: &str) -> bool {
    let figure = |word: &str| {
        let digits = word.replace(',', "");
        digits.trim_matches(|c: char| !c.is_ascii_digit() && c != '-').parse::<f64>().ok()
    };
    match (figure(a), figure(b)) {
        (Some(a), Some(b)) => (a - b).abs() <= FIGURES_SHARE * a.abs().max(b.abs()),
        _ => false,
    }
}

/// Two digits: `0.0012`, `3.4`, `120`, `6,400,000`; from 10⁷ on and below 10⁻³ as `1.2e9`.
pub fn digits(value: f64) -> String {
    if value == 0.0 || !value.is_finite() {
        return format!("{value}");
    }
    let exponent = value.abs().log10().floor() as i32;
    let rounded: f64 = format!("{value:.1e}").parse().unwrap();
    if !(-3..7).contains(&exponent) {
        return format!("{rounded:e}");
    }
    if exponent < 2 {
        return format!("{rounded:.*}", (1 - exponent).max(0) as usize);
    }
    grouped(rounded as i64)
}

/// All digits, in groups of three.
pub fn grouped(value: i64) -> String {
    let text = value.abs().to_string();
    let mut out = String::new();
    for (at, digit) in text.chars().enumerate() {
        if at > 0 && (text.len() - at).is_multiple_of(3) {
            out.push(',');
        }
        out.push(digit);
    }
    if value < 0 { format!("-{out}") } else { out }
}

#[test]
fn figures_are_written_short_and_compared_by_value() {
    let cases = [(0.00123, "0.0012"), (3.44, "3.4"), (123.4, "120"), (6_378_137.0, "6,400,000"), (1.27e9, "1.3e9")];
    for (value, text) in cases {
        assert_eq!(digits(value), text);
        assert_eq!(digits(-value), format!("-{text}"));
    }
    assert!(agree("| a | 6,400,000 m, | 0.10 px |", "| a | 6,500,000 m, | 0.10 px |"));
    assert!(!agree("| a | 6,400,000 m |", "| a | 7,500,000 m |") && !agree("| a b | 1 |", "| a c | 1 |"));
    assert!(!agree("| 1 px |", "| 1 px or so |") && !agree("| 1 px |", "| many px |"));
}
