//! Where numbers and methods fail: the table of STABILITY.md, which the tests of this version hold to what they measure.

use crate::chart::figure::Figure;
use crate::chart::sheet::{Cell, Sheet};

const PAGE: &str = include_str!("../../../STABILITY.md");
const COLUMNS: [&str; 4] = ["case", "usual_method", "ours", "ours_can_be_pushed_to"];

/// The table; it tells of this version, on any machine, and not of the world that is charted.
pub fn stability() -> Figure {
    let mut sheet = Sheet::new("stability", &COLUMNS);
    rows(PAGE).for_each(|row| sheet.push(row));
    Figure {
        title: "Where numbers and methods fail".into(),
        text: "Each row is a test of this version: it runs the usual method and shows where that fails, runs ours over the \
               same, and searches how far ours can be pushed. Flights are by the virtual clock over made-up worlds; made anew \
               by STOOP_WRITE_STABILITY=1 cargo test --release --test stability."
            .into(),
        panels: Vec::new(),
        sheet,
        has_table: true,
    }
}

/// Rows of the page's only table, as the tests write it: below its rule, one to a line.
fn rows(page: &str) -> impl Iterator<Item = [Cell; 4]> + '_ {
    let below = page.lines().skip_while(|line| !line.starts_with("|---")).skip(1);
    below.map_while(|line| line.strip_prefix("| ")?.strip_suffix(" |")).filter_map(|line| {
        let mut cells = line.split(" | ").map(|cell| Cell::Text(cell.replace('`', "")));
        Some([cells.next()?, cells.next()?, cells.next()?, cells.next()?])
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_page_has_all_rows_of_the_table() {
        let figure = stability();
        let lines = PAGE.lines().filter(|line| line.starts_with("| ") && !line.starts_with("| case")).count();
        assert!(lines >= 10 && figure.sheet.rows.len() == lines, "{lines} {}", figure.sheet.rows.len());
        let words = |cell: &Cell| matches!(cell, Cell::Text(text) if text.len() > 3);
        assert!(figure.sheet.rows.iter().all(|row| row.iter().all(words)));
    }
}
