//! A trace line by line, with errors that name the place.

use std::io::BufRead;

use serde::de::DeserializeOwned;

use super::ReplayError;

pub(super) struct Lines<'n, R> {
    reader: R,
    file: &'n str,
    /// The number of `line`, from 1; past the last one, where the next would be.
    pub number: u64,
    line: Vec<u8>,
}

impl<'n, R: BufRead> Lines<'n, R> {
    pub fn new(reader: R, file: &'n str) -> Self {
        Lines { reader, file, number: 0, line: Vec::new() }
    }

    /// Goes to the next line; false after the last one.
    pub fn advance(&mut self) -> Result<bool, ReplayError> {
        self.line.clear();
        self.number += 1;
        match self.reader.read_until(b'\n', &mut self.line) {
            Ok(length) => Ok(length > 0),
            Err(source) => Err(ReplayError::Read { file: self.file.to_owned(), line: self.number, source }),
        }
    }

    /// Reads the line as a record.
    pub fn parse<T: DeserializeOwned>(&self) -> Result<T, ReplayError> {
        serde_json::from_slice(&self.line).map_err(|error| {
            let text = error.to_string();
            // Each record is one line; the error gets its number in the file instead.
            let text = text.split(" at line ").next().unwrap_or_default();
            let cut = if error.is_eof() { "; the line looks cut off" } else { "" };
            self.damaged(format!("expected a record as JSON: {text} (column {}){cut}", error.column()))
        })
    }

    /// An error about the current line.
    pub fn damaged(&self, what: impl Into<String>) -> ReplayError {
        ReplayError::Damaged { file: self.file.to_owned(), line: self.number, what: what.into() }
    }
}
