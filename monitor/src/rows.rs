//! Metric rows from files: complete, incomplete, or of another program.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use serde_json::{Map, Value};

use crate::runs::Point;
use crate::Error;

/// Collects one metric from rows. Rows that cannot be used are skipped; the first of them and their number are stored.
pub struct Rows<'a> {
    path: &'a Path,
    metric: &'a str,
    points: Vec<Point>,
    /// Other names in the rows, for the error message.
    names: BTreeSet<String>,
    unusable: Option<Unusable>,
}

struct Unusable {
    count: usize,
    place: String,
    problem: String,
}

impl<'a> Rows<'a> {
    pub fn new(path: &'a Path, metric: &'a str) -> Self {
        Self { path, metric, points: Vec::new(), names: BTreeSet::new(), unusable: None }
    }

    /// Adds all rows of a `metrics.jsonl`. A last line without an end is a row that is still being written, not an
    /// error.
    pub fn take_lines(&mut self, bytes: &[u8]) {
        for (index, line) in bytes.split_inclusive(|byte| *byte == b'\n').enumerate() {
            if line.trim_ascii().is_empty() {
                continue;
            }
            let place = format!("line {}", index + 1);
            match parse::<Map<String, Value>>(line) {
                Ok(row) => self.take(&place, &row),
                Err(_) if !line.ends_with(b"\n") => {}
                Err(error) => self.leave_out(&place, format!("not a JSON object: {error}")),
            }
        }
    }

    /// Adds one row; `place` is its place for messages.
    pub fn take(&mut self, place: &str, row: &Map<String, Value>) {
        let Some(value) = row.get(self.metric) else {
            let new = row.keys().filter(|name| !self.names.contains(*name)).cloned().collect::<Vec<_>>();
            self.names.extend(new);
            return;
        };
        if is_not_finite(value) {
            return;
        }
        let Some(value) = value.as_f64() else {
            return self.leave_out(place, format!("expected a number for `{}`, got {value}", self.metric));
        };
        let Some(t_env) = row.get("t_env").and_then(whole) else {
            let expected = "expected a whole number `t_env` (environment steps) beside the value";
            return self.leave_out(place, expected.to_owned());
        };
        match self.points.last() {
            Some(last) if last.t_env >= t_env => {
                self.leave_out(place, format!("t_env {t_env} comes after {}, expected rising", last.t_env));
            }
            _ => self.points.push(Point { t_env, value }),
        }
    }

    /// Counts a row that cannot be used.
    pub fn leave_out(&mut self, place: &str, problem: String) {
        match &mut self.unusable {
            Some(unusable) => unusable.count += 1,
            None => self.unusable = Some(Unusable { count: 1, place: place.to_owned(), problem }),
        }
    }

    /// The points, and the skipped rows.
    ///
    /// # Errors
    /// [`Error::NoRows`] without any point.
    pub fn finish(self) -> Result<(Vec<Point>, Option<Error>), Error> {
        let path: PathBuf = self.path.to_owned();
        if !self.points.is_empty() {
            let left_out = self.unusable.map(|rows| Error::Rows {
                path,
                count: rows.count,
                place: rows.place,
                problem: rows.problem,
            });
            return Ok((self.points, left_out));
        }
        let names: Vec<String> = self.names.iter().map(|name| format!("`{name}`")).collect();
        let found = match (self.unusable, names.is_empty()) {
            (Some(rows), _) => {
                format!("{} rows cannot be used, the first at {}: {}", rows.count, rows.place, rows.problem)
            }
            (None, true) => "it has no rows with a value yet".to_owned(),
            (None, false) => format!("there are {}", names.join(", ")),
        };
        Err(Error::NoRows { path, metric: self.metric.to_owned(), found })
    }
}

/// Parses JSON with infinities and NaN as Python's `json` and other programs write them; they become `null`.
pub fn parse<T: serde::de::DeserializeOwned>(bytes: &[u8]) -> Result<T, serde_json::Error> {
    serde_json::from_slice(bytes).or_else(|error| match without_non_finite(bytes) {
        Some(bytes) => serde_json::from_slice(&bytes),
        None => Err(error),
    })
}

/// The same text with `null` for each bare word that is a number but not finite, such as `NaN`, `-Infinity` or
/// `1e999`; `None` if there is no such word.
fn without_non_finite(bytes: &[u8]) -> Option<Vec<u8>> {
    let ends_word = |byte: u8| byte.is_ascii_whitespace() || b",:[]{}\"".contains(&byte);
    let mut out = Vec::with_capacity(bytes.len());
    let mut found = false;
    let mut rest = bytes;
    while let Some(&first) = rest.first() {
        let length = match first {
            b'"' => text_length(rest),
            byte if ends_word(byte) => 1,
            _ => rest.iter().position(|byte| ends_word(*byte)).unwrap_or(rest.len()),
        };
        let (part, after) = rest.split_at(length);
        let number = std::str::from_utf8(part).ok().and_then(|word| word.parse::<f64>().ok());
        if number.is_some_and(|number| !number.is_finite()) {
            found = true;
            out.extend_from_slice(b"null");
        } else {
            out.extend_from_slice(part);
        }
        rest = after;
    }
    found.then_some(out)
}

/// Bytes of the text that begins here, its quotation marks included.
fn text_length(bytes: &[u8]) -> usize {
    let mut escaped = false;
    for (index, byte) in bytes.iter().enumerate().skip(1) {
        match byte {
            _ if escaped => escaped = false,
            b'\\' => escaped = true,
            b'"' => return index + 1,
            _ => {}
        }
    }
    bytes.len()
}

/// `null`, and texts such as `"NaN"`, which some programs write for numbers that JSON does not have.
fn is_not_finite(value: &Value) -> bool {
    value.is_null()
        || value.as_str().and_then(|text| text.parse::<f64>().ok()).is_some_and(|number| !number.is_finite())
}

/// A count, also if written as `1000.0`.
fn whole(value: &Value) -> Option<u64> {
    let float = || value.as_f64().filter(|x| x.fract() == 0.0 && (0.0..9e15).contains(x)).map(|x| x as u64);
    value.as_u64().or_else(float)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn points(text: &str) -> (Vec<(u64, f64)>, Option<String>) {
        let mut rows = Rows::new(Path::new("F"), "x");
        rows.take_lines(text.as_bytes());
        let (points, left_out) = rows.finish().unwrap();
        let points = points.iter().map(|point| (point.t_env, point.value)).collect();
        (points, left_out.map(|error| error.to_string()))
    }

    #[test]
    fn numbers_that_are_not_finite_are_skipped_however_they_are_written() {
        for word in
            ["NaN", "Infinity", "-Infinity", "nan", "inf", "-inf", "1e999", "-1e400", "\"NaN\"", "null"]
        {
            let text = format!("{{\"t_env\":1,\"x\":{word}}}\n{{\"t_env\": 2, \"y\": {word}, \"x\": 5}}\n");
            assert_eq!(points(&text), (vec![(2, 5.0)], None), "{word}");
        }
        let text = "{\"t_env\":1,\"x\":1,\"note\":\"a \\\" NaN, b\",\"y\":[NaN,{\"z\":-Infinity}]}\n";
        assert_eq!(points(text), (vec![(1, 1.0)], None));
    }

    #[test]
    fn a_text_keeps_what_looks_like_a_number() {
        let row: Map<String, Value> = parse(b"{\"NaN\": \"a \\\" NaN\", \"x\": NaN}").unwrap();
        assert_eq!((&row["NaN"], &row["x"]), (&Value::from("a \" NaN"), &Value::Null));
        assert!(parse::<Map<String, Value>>(b"{\"x\": nothing}").is_err());
        assert!(parse::<Map<String, Value>>(b"{\"x\": \"NaN").is_err());
    }

    #[test]
    fn steps_may_be_written_with_a_fraction_of_zero() {
        assert_eq!(points("{\"t_env\":1000.0,\"x\":1}\n"), (vec![(1000, 1.0)], None));
        assert_eq!(points("{\"t_env\":1.5,\"x\":1}\n{\"t_env\":2,\"x\":1}\n").0, [(2, 1.0)]);
    }

    #[test]
    fn unusable_rows_are_counted_and_the_first_is_named() {
        let text = "{\"t_env\":1,\"x\":1}\n\u{0}\u{0}\n{\"t_env\":1,\"x\":1}\n{\"t_env\":3,\"x\":3}\n{\"t_en";
        let (points, left_out) = points(text);
        assert_eq!(points, [(1, 1.0), (3, 3.0)]);
        let left_out = left_out.unwrap();
        assert!(left_out.starts_with("2 rows of F, the first at line 2: not a JSON object: "), "{left_out}");
    }
}
