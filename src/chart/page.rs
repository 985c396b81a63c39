//! The page: one HTML file with its charts inside, without scripts and without anything from elsewhere. Each number of a
//! table or a sentence is a `data` element whose value is the one of the CSV file.

use super::figure::Figure;
use super::plot::{Palette, PlotError, short, svg};
use super::sheet::{Cell, Sheet};
use std::fmt::Write;

const STYLE: &str = "\
body{font:15px/1.5 system-ui,sans-serif;color:#1b1f24;max-width:1180px;margin:2em auto;padding:0 1em}\
h1{font-size:1.7em;margin-bottom:.2em}h2{margin:2em 0 .3em;border-top:1px solid #d5d9de;padding-top:1em}\
p{max-width:60em}.panels{display:grid;grid-template-columns:repeat(auto-fit,minmax(480px,1fr));gap:.5em}\
.panels svg{width:100%;height:auto}code{background:#f0f2f4;padding:.1em .3em;overflow-wrap:anywhere}\
.choice{background:#eef6ee;border:1px solid #b6d7b6;padding:.6em 1em;border-radius:.4em}\
table{border-collapse:collapse;font-variant-numeric:tabular-nums;font-size:13px}\
th,td{border-bottom:1px solid #e3e6e9;padding:.15em .6em;text-align:right}th{text-align:right;vertical-align:bottom}\
td.word,th.word{text-align:left;vertical-align:top}details{margin:.4em 0}.source{color:#59636e;font-size:13px}.wide{overflow-x:auto}";

/// Rows that a table shows at once; of longer ones the file has the rest.
const ROWS_MAX: usize = 400;

/// What stands around the figures.
pub struct Frame<'a> {
    pub title: &'a str,
    /// A paragraph of HTML: what was flown and how.
    pub head: &'a str,
    /// The last section, HTML.
    pub recommendation: &'a str,
}

/// A figure with the command that makes it alone.
pub struct Entry<'a> {
    pub figure: &'a Figure,
    pub command: &'a str,
}

/// The whole page.
pub fn page(frame: &Frame<'_>, entries: &[Entry<'_>]) -> Result<String, PlotError> {
    let palette = Palette::of(entries.iter().flat_map(|entry| &entry.figure.panels));
    let mut text = format!(
        "<!DOCTYPE html>\n<html lang=\"en\">\n<head><meta charset=\"utf-8\"><title>{0}</title>\n<style>{STYLE}</style></head>\n\
         <body>\n<h1>{0}</h1>\n{1}\n",
        escaped(frame.title),
        frame.head
    );
    for entry in entries {
        section(&mut text, entry, &palette)?;
    }
    let _ = write!(text, "<h2 id=\"recommendation\">Recommendation</h2>\n{}\n</body>\n</html>\n", frame.recommendation);
    Ok(text)
}

fn section(text: &mut String, entry: &Entry<'_>, palette: &Palette) -> Result<(), PlotError> {
    let Entry { figure, command } = entry;
    let name = &figure.sheet.name;
    let _ = write!(text, "<h2 id=\"{name}\">{}</h2>\n<p>{}</p>\n", escaped(&figure.title), escaped(&figure.text));
    text.push_str("<div class=\"panels\">\n");
    for panel in &figure.panels {
        let _ = writeln!(text, "<figure style=\"margin:0\">{}</figure>", svg(panel, palette)?);
    }
    text.push_str("</div>\n");
    if figure.has_table {
        let is_all = figure.panels.is_empty();
        let (open, close) = if is_all { ("", "") } else { ("<details><summary>Numbers</summary>", "</details>") };
        let _ = writeln!(text, "{open}{}{close}", table(&figure.sheet));
    }
    let file = figure.sheet.file_name();
    let _ = writeln!(
        text,
        "<p class=\"source\">All numbers: <a href=\"{file}\">{file}</a>, made by <code>{}</code></p>",
        escaped(command)
    );
    Ok(())
}

/// A table of a sheet.
pub fn table(sheet: &Sheet) -> String {
    let is_word = |column: usize| sheet.rows.iter().any(|row| matches!(row[column], Cell::Text(_)));
    let class = |column: usize| if is_word(column) { " class=\"word\"" } else { "" };
    let mut text = String::from("<div class=\"wide\"><table>\n<tr>");
    for (at, column) in sheet.columns.iter().enumerate() {
        let _ = write!(text, "<th{}>{}</th>", class(at), escaped(&column.replace('_', " ")));
    }
    text.push_str("</tr>\n");
    for row in sheet.rows.iter().take(ROWS_MAX) {
        text.push_str("<tr>");
        for (at, cell) in row.iter().enumerate() {
            let _ = write!(text, "<td{}>{}</td>", class(at), shown(cell));
        }
        text.push_str("</tr>\n");
    }
    text.push_str("</table></div>");
    text
}

/// A cell as people read it, with its value as the files have it.
pub fn shown(cell: &Cell) -> String {
    match cell {
        Cell::Text(word) => escaped(word),
        Cell::Number(number) => format!("<data value=\"{}\">{}</data>", cell.written(), short(*number)),
        Cell::Nothing => "–".to_owned(),
    }
}

/// Text as HTML.
pub fn escaped(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace('"', "&quot;")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn words_are_escaped_and_numbers_keep_their_value() {
        let mut sheet = Sheet::new("a", &["name", "debt_px"]);
        sheet.push(["<b> & co".into(), Cell::from(1234567.25)]);
        let figure = Figure { title: "x < y".into(), text: "…".into(), panels: Vec::new(), sheet, has_table: true };
        let frame = Frame { title: "t", head: "", recommendation: "" };
        let text = page(&frame, &[Entry { figure: &figure, command: "stoop-chart \"w\"" }]).unwrap();
        for part in
            ["x &lt; y", "&lt;b&gt; &amp; co", "<data value=\"1234567.25\">1.23 M</data>", "&quot;w&quot;", "a.csv"]
        {
            assert!(text.contains(part), "{part}: {text}");
        }
        assert!(!text.contains("<script"));
    }
}
