//! Curves that other programs measured: rows of a CSV file, as of single-seek layouts their redundancy against their delay
//! (Jiang, Sajadi, Gopi 2013, fig. 4).

use super::figure::{Axis, Curve, Figure, Panel, Spot, Stroke};
use super::sheet::{Cell, Sheet};
use std::path::{Path, PathBuf};

/// Rows of a file at most.
pub const ROWS_MAX: usize = 100_000;

#[derive(Debug, thiserror::Error)]
pub enum RowsError {
    #[error("cannot read {}: {source}; write a header and rows: x, y, and the curve's name where there are several", file.display())]
    Csv { file: PathBuf, source: csv::Error },
    #[error("{}: {what}", file.display())]
    Content { file: PathBuf, what: String },
}

/// A figure of a file whose header names the axes: columns x, y, and where there is a third the name of the curve. Rows of
/// a curve are joined in their order. The figure is called like the file.
pub fn figure_of_rows(file: &Path) -> Result<Figure, RowsError> {
    let fail = |source| RowsError::Csv { file: file.to_owned(), source };
    let content = |what: String| RowsError::Content { file: file.to_owned(), what };
    let mut reader = csv::ReaderBuilder::new().trim(csv::Trim::All).from_path(file).map_err(fail)?;
    let columns: Vec<String> = reader.headers().map_err(fail)?.iter().map(str::to_owned).collect();
    if !(2..=3).contains(&columns.len()) {
        return Err(content(format!("there are {} columns; there should be x, y, and perhaps a name", columns.len())));
    }
    let title = file.file_stem().map_or_else(|| "rows".to_owned(), |stem| stem.to_string_lossy().into_owned());
    let mut sheet = Sheet { name: title.clone(), columns, rows: Vec::new() };
    let mut curves: Vec<Curve> = Vec::new();
    for (at, record) in reader.records().enumerate() {
        let record = record.map_err(fail)?;
        if at >= ROWS_MAX {
            return Err(content(format!("there are more than {ROWS_MAX} rows; leave some out")));
        }
        let number = |column: usize| {
            let word = &record[column];
            let value = word.parse::<f64>().ok().filter(|value| value.is_finite());
            value.ok_or_else(|| content(format!("row {}: {word:?} is no number", at + 2)))
        };
        let (x, y) = (number(0)?, number(1)?);
        let name = record.get(2).unwrap_or(&title).to_owned();
        let mut row: Vec<Cell> = vec![x.into(), y.into()];
        row.extend(record.get(2).map(Cell::from));
        sheet.rows.push(row);
        let spot = Spot { x, y, name: None };
        match curves.iter_mut().find(|curve| curve.name == name) {
            Some(curve) => curve.spots.push(spot),
            None => curves.push(Curve { name, stroke: Stroke::Dotted, spots: vec![spot] }),
        }
    }
    let [x, y] = [0, 1].map(|at| Axis::linear(&sheet.columns[at].replace('_', " ")));
    let panels = vec![Panel { title: title.clone(), x, y, curves }];
    Ok(Figure { title, text: format!("As {} has it.", file.display()), panels, sheet, has_table: true })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(text: &str) -> Result<Figure, RowsError> {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("layouts.csv");
        std::fs::write(&file, text).unwrap();
        figure_of_rows(&file)
    }

    #[test]
    fn rows_become_curves_by_name() {
        let figure = read("redundancy,delay_ms,side\n10, 5.5,100 m\n20,4,100 m\n12,6,200 m\n").unwrap();
        let [panel] = &figure.panels[..] else { panic!("one panel") };
        let told: Vec<(&str, usize)> = panel.curves.iter().map(|curve| (&*curve.name, curve.spots.len())).collect();
        assert_eq!(told, [("100 m", 2), ("200 m", 1)]);
        assert_eq!((&*panel.y.name, figure.sheet.rows.len()), ("delay ms", 3));
        assert_eq!(read("x,y\n1,2\n").unwrap().panels[0].curves[0].name, "layouts");
    }

    #[test]
    fn what_is_no_number_is_named_with_its_row() {
        for (text, said) in [("x,y\n1,2\n1,b\n", "row 3"), ("x\n1\n", "1 columns"), ("x,y\n1\n", "layouts.csv")] {
            let message = read(text).unwrap_err().to_string();
            assert!(message.contains(said), "{message}");
        }
    }
}
