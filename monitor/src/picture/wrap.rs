//! Wraps text to a width.

/// `text` in lines of at most `columns` letters, broken between words; a word that is longer alone is cut. An
/// empty text has no lines.
pub fn wrap(text: &str, columns: usize) -> Vec<String> {
    let columns = columns.max(1);
    let mut lines: Vec<String> = Vec::new();
    let mut used = 0;
    for word in text.split_whitespace() {
        let letters: Vec<char> = word.chars().collect();
        for (k, part) in letters.chunks(columns).enumerate() {
            match lines.last_mut() {
                Some(line) if k == 0 && used + 1 + part.len() <= columns => {
                    line.push(' ');
                    line.extend(part);
                    used += 1 + part.len();
                }
                _ => {
                    lines.push(part.iter().collect());
                    used = part.len();
                }
            }
        }
    }
    lines
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_break_between_words_and_cut_what_is_too_long_alone() {
        assert_eq!(wrap("one two  three\nfour", 9), ["one two", "three", "four"]);
        assert_eq!(wrap("one two three", 13), ["one two three"]);
        assert_eq!(wrap("a bcdefghij k", 4), ["a", "bcde", "fghi", "j k"]);
        assert_eq!(wrap("äöü ß", 3), ["äöü", "ß"]);
        assert_eq!(wrap("ab", 0), ["a", "b"]);
        assert!(wrap(" ", 9).is_empty());
    }
}
