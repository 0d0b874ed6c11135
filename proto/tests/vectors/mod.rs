//! The test vectors of `docs/protocol.md`, for the tests of every crate that sends such bytes.

use std::collections::BTreeMap;

/// The page itself.
pub const DOCUMENT: &str = include_str!("../../../docs/protocol.md");

/// The blocks fenced as `hex NAME`; a `#` begins a remark.
pub fn vectors() -> BTreeMap<&'static str, Vec<u8>> {
    let mut vectors = BTreeMap::new();
    let mut lines = DOCUMENT.lines();
    while let Some(line) = lines.next() {
        let Some(name) = line.strip_prefix("```hex ") else { continue };
        let bytes = lines
            .by_ref()
            .take_while(|line| *line != "```")
            .flat_map(|line| line.split('#').next().unwrap_or_default().split_whitespace())
            .map(|byte| {
                u8::from_str_radix(byte, 16).unwrap_or_else(|_| panic!("`{byte}` in vector `{name}`"))
            })
            .collect();
        assert_eq!(vectors.insert(name, bytes), None, "two vectors are called `{name}`");
    }
    vectors
}
