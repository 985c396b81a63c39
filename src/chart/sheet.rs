//! Tables of numbers and words: the same rows as CSV, as JSON and on the page.

use serde_json::{Map, Value};

/// One entry of a table.
#[derive(Clone, Debug, PartialEq)]
pub enum Cell {
    Text(String),
    Number(f64),
    /// Not measured, or not to be had.
    Nothing,
}

impl Cell {
    /// As it stands in files: numbers by the shortest digits that give them back.
    pub fn written(&self) -> String {
        match self {
            Self::Text(text) => text.clone(),
            Self::Number(number) => number.to_string(),
            Self::Nothing => String::new(),
        }
    }

    fn json(&self) -> Value {
        match self {
            Self::Text(text) => Value::from(text.as_str()),
            Self::Number(number) => Value::from(*number),
            Self::Nothing => Value::Null,
        }
    }
}

impl From<f64> for Cell {
    fn from(number: f64) -> Self {
        if number.is_finite() { Self::Number(number) } else { Self::Nothing }
    }
}

impl From<u64> for Cell {
    fn from(number: u64) -> Self {
        Self::Number(number as f64)
    }
}

impl From<Option<f64>> for Cell {
    fn from(number: Option<f64>) -> Self {
        number.map_or(Self::Nothing, Self::from)
    }
}

impl From<&str> for Cell {
    fn from(text: &str) -> Self {
        Self::Text(text.to_owned())
    }
}

impl From<String> for Cell {
    fn from(text: String) -> Self {
        Self::Text(text)
    }
}

impl From<&Value> for Cell {
    fn from(value: &Value) -> Self {
        match value {
            Value::Null => Self::Nothing,
            Value::Bool(truth) => Self::Number(f64::from(u8::from(*truth))),
            Value::Number(number) => number.as_f64().map_or(Self::Nothing, Self::Number),
            Value::String(text) => Self::Text(text.clone()),
            nested => Self::Text(nested.to_string()),
        }
    }
}

/// A named table; its name is that of its file, less the ending.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Sheet {
    pub name: String,
    /// With units as suffixes.
    pub columns: Vec<String>,
    /// As many cells as columns.
    pub rows: Vec<Vec<Cell>>,
}

impl Sheet {
    pub fn new(name: impl Into<String>, columns: &[&str]) -> Self {
        let columns = columns.iter().map(|&column| column.to_owned()).collect();
        Self { name: name.into(), columns, rows: Vec::new() }
    }

    /// Values that all have the same keys; the keys become columns.
    pub fn of_values(name: impl Into<String>, values: impl IntoIterator<Item = Map<String, Value>>) -> Self {
        let mut sheet = Self { name: name.into(), ..Self::default() };
        for value in values {
            if sheet.columns.is_empty() {
                sheet.columns = value.keys().cloned().collect();
            }
            let cell = |column: &String| value.get(column).map_or(Cell::Nothing, Cell::from);
            let row = sheet.columns.iter().map(cell).collect();
            sheet.rows.push(row);
        }
        sheet
    }

    pub fn push<const N: usize>(&mut self, row: [Cell; N]) {
        debug_assert_eq!(N, self.columns.len());
        self.rows.push(row.into());
    }

    pub fn file_name(&self) -> String {
        format!("{}.csv", self.name)
    }

    pub fn csv(&self) -> Result<Vec<u8>, csv::Error> {
        let mut writer = csv::Writer::from_writer(Vec::new());
        writer.write_record(&self.columns)?;
        for row in &self.rows {
            writer.write_record(row.iter().map(Cell::written))?;
        }
        writer.into_inner().map_err(|error| csv::Error::from(error.into_error()))
    }

    /// A list of objects.
    pub fn json(&self) -> Value {
        let object = |row: &Vec<Cell>| {
            let pairs = self.columns.iter().cloned().zip(row.iter().map(Cell::json));
            Value::Object(pairs.collect())
        };
        self.rows.iter().map(object).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn words_are_quoted_and_numbers_come_back() {
        let mut sheet = Sheet::new("debts", &["storage", "debt_px"]);
        sheet.push(["20,50,4".into(), Cell::from(0.1 + 0.2)]);
        sheet.push(["\"x\"".into(), Cell::from(f64::NAN)]);
        let text = String::from_utf8(sheet.csv().unwrap()).unwrap();
        assert_eq!(text, "storage,debt_px\n\"20,50,4\",0.30000000000000004\n\"\"\"x\"\"\",\n");
        assert_eq!(sheet.json()[0]["debt_px"], Value::from(0.1 + 0.2));
        assert_eq!(sheet.json()[1]["debt_px"], Value::Null);
    }
}
