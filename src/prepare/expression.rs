//! Values of recipes: an attribute's name, a number, or an expression over attributes such as `storeys * 3.5`.

use exmex::{Express, FlatEx};
use serde_json::{Map, Value};

/// What a recipe says a value is.
#[derive(Clone, Debug)]
pub enum Expression {
    Number(f64),
    Attribute(String),
    Formula { formula: Box<FlatEx<f64>>, text: String },
}

#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[error("{text:?} is neither a number, nor an attribute, nor an expression such as `storeys * 3.5` ({what})")]
pub struct ExpressionError {
    pub text: String,
    pub what: String,
}

/// An attribute of a type that cannot be a number.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[error("attribute {name:?} is {found}, and a number is needed")]
pub struct WrongType {
    pub name: String,
    pub found: String,
}

impl Expression {
    /// Names of attributes with other characters than letters, digits, `_` and `:` stand in braces: `{roof-height}`.
    pub fn parse(text: &str) -> Result<Self, ExpressionError> {
        let trimmed = text.trim();
        if let Ok(number) = trimmed.parse::<f64>() {
            return Ok(Self::Number(number));
        }
        if is_name(trimmed) {
            return Ok(Self::Attribute(trimmed.to_owned()));
        }
        let formula = exmex::parse::<f64>(&with_braces(trimmed))
            .map_err(|error| ExpressionError { text: text.to_owned(), what: error.to_string() })?;
        Ok(Self::Formula { formula: Box::new(formula), text: trimmed.to_owned() })
    }

    /// The value for a feature; `None` where an attribute is missing, null or text that is no number, or where the
    /// result is not finite.
    ///
    /// ```
    /// # use stoop::prepare::expression::Expression;
    /// let attributes = serde_json::json!({ "storeys": 4 });
    /// let height = Expression::parse("storeys * 3.5").unwrap();
    /// assert_eq!(height.value(attributes.as_object().unwrap()), Ok(Some(14.0)));
    /// ```
    pub fn value(&self, attributes: &Map<String, Value>) -> Result<Option<f64>, WrongType> {
        let value = match self {
            Self::Number(number) => Some(*number),
            Self::Attribute(name) => number_of(name, attributes.get(name))?,
            Self::Formula { formula, .. } => {
                let mut values = Vec::with_capacity(formula.var_names().len());
                for name in formula.var_names() {
                    match number_of(name, attributes.get(name))? {
                        Some(value) => values.push(value),
                        None => return Ok(None),
                    }
                }
                formula.eval(&values).ok()
            }
        };
        Ok(value.filter(|number| number.is_finite()))
    }
}

fn is_name(text: &str) -> bool {
    let mut characters = text.chars();
    characters.next().is_some_and(|first| first.is_alphabetic() || first == '_')
        && characters.all(|c| c.is_alphanumeric() || matches!(c, '_' | ':'))
}

/// Puts names with a colon, as OpenStreetMap has them, into the braces that the parser wants.
fn with_braces(text: &str) -> String {
    let mut out = String::new();
    let mut rest = text;
    while let Some(start) = rest.find(|c: char| c.is_alphabetic() || matches!(c, '_' | '{')) {
        out.push_str(&rest[..start]);
        rest = &rest[start..];
        let end = if rest.starts_with('{') {
            rest.find('}').map_or(rest.len(), |at| at + 1)
        } else {
            rest.find(|c: char| !(c.is_alphanumeric() || matches!(c, '_' | ':'))).unwrap_or(rest.len())
        };
        let name = &rest[..end];
        if name.contains(':') && !name.starts_with('{') {
            out.push('{');
            out.push_str(name);
            out.push('}');
        } else {
            out.push_str(name);
        }
        rest = &rest[end..];
    }
    out + rest
}

fn number_of(name: &str, value: Option<&Value>) -> Result<Option<f64>, WrongType> {
    let wrong = |found: &str| Err(WrongType { name: name.to_owned(), found: found.to_owned() });
    match value {
        None | Some(Value::Null) => Ok(None),
        Some(Value::Number(number)) => Ok(number.as_f64()),
        Some(Value::String(text)) => Ok(parse_metres(text)),
        Some(Value::Bool(_)) => wrong("true or false"),
        Some(Value::Array(_)) => wrong("a list"),
        Some(Value::Object(_)) => wrong("an object"),
    }
}

/// A length as people tag it: `12`, `12.5 m`, `12,5`, `40'`, `6'4"`, `40 ft`; metres. Plain numbers stay as they are.
pub fn parse_metres(text: &str) -> Option<f64> {
    const FOOT_M: f64 = 0.3048;
    let text = text.trim();
    let number = |part: &str| -> Option<f64> {
        let part = part.trim();
        let value = part.parse().or_else(|_| part.replacen(',', ".", 1).parse()).ok()?;
        Some(value).filter(|value: &f64| value.is_finite())
    };
    if let Some((feet, inches)) = text.split_once('\'') {
        let inches = inches.trim().trim_end_matches('"');
        let inches = if inches.is_empty() { 0.0 } else { number(inches)? };
        return Some((number(feet)? + inches / 12.0) * FOOT_M);
    }
    for (unit, metres) in
        [("feet", FOOT_M), ("ft", FOOT_M), ("km", 1000.0), ("metres", 1.0), ("meters", 1.0), ("m", 1.0)]
    {
        if let Some(part) = text.strip_suffix(unit) {
            return number(part).map(|value| value * metres);
        }
    }
    number(text)
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    fn value(expression: &str, attributes: Value) -> Result<Option<f64>, WrongType> {
        Expression::parse(expression).unwrap().value(attributes.as_object().unwrap())
    }

    #[test]
    fn names_numbers_and_formulas() {
        assert_eq!(value("height", json!({"height": 3.5})), Ok(Some(3.5)));
        assert_eq!(value("height", json!({"height": "12 m"})), Ok(Some(12.0)));
        assert_eq!(value("12", json!({})), Ok(Some(12.0)));
        assert_eq!(value("storeys * 3.5", json!({"storeys": 62.0})), Ok(Some(217.0)));
        assert_eq!(value("building:levels * 3 + 1", json!({"building:levels": "5"})), Ok(Some(16.0)));
        assert_eq!(value("{roof-height} + {a}", json!({"roof-height": 2, "a": 1})), Ok(Some(3.0)));
        assert_eq!(value("max(a, b)", json!({"a": 2, "b": 1})), Ok(Some(2.0)));
    }

    #[test]
    fn what_is_missing_is_none_and_what_is_wrong_an_error() {
        assert_eq!(value("height", json!({})), Ok(None));
        assert_eq!(value("height * 2", json!({"height": null})), Ok(None));
        assert_eq!(value("height", json!({"height": "tall"})), Ok(None));
        assert_eq!(value("1 / a", json!({"a": 0})), Ok(None));
        assert!(value("height", json!({"height": [1]})).is_err());
        assert!(value("height * 2", json!({"height": true})).is_err());
        for bad in ["", "storeys *", "3 +* 4", "(a"] {
            assert!(Expression::parse(bad).is_err(), "{bad}");
        }
    }

    #[test]
    fn lengths_as_people_write_them() {
        for (text, metres) in
            [("12", 12.0), ("12 m", 12.0), ("12,5", 12.5), ("40'", 12.192), ("6'6\"", 1.9812), ("10 ft", 3.048)]
        {
            let parsed = parse_metres(text).unwrap();
            assert!((parsed - metres).abs() < 1e-9, "{text}: {parsed}");
        }
        for text in ["", "m", "~12", "12-15", "nan", "inf", "high"] {
            assert_eq!(parse_metres(text), None, "{text}");
        }
    }
}
