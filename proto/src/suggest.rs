//! "Did you mean …?": the known name nearest to a misspelt one.

/// The known name nearest to `wrong`, if one is near enough.
///
/// Near enough means: at most one edit (insertion, deletion, replacement, swap of neighbours) for every three letters,
/// rounded up, and fewer edits than letters. Case is ignored. Of equally near names the first one given is returned.
pub fn nearest<'a>(wrong: &str, known: impl IntoIterator<Item = &'a str>) -> Option<&'a str> {
    let wrong = wrong.to_lowercase();
    let letters = wrong.chars().count();
    let allowed = letters.div_ceil(3).min(letters.saturating_sub(1));
    known
        .into_iter()
        .map(|name| (strsim::damerau_levenshtein(&wrong, &name.to_lowercase()), name))
        .filter(|&(edits, _)| edits <= allowed)
        .min_by_key(|&(edits, _)| edits)
        .map(|(_, name)| name)
}

#[cfg(test)]
mod tests {
    use super::nearest;

    const KNOWN: [&str; 5] = ["epochs", "entropy_coef", "n_step", "gamma", "hidden"];

    #[test]
    fn a_slip_of_the_finger_is_recognised() {
        assert_eq!(nearest("epoch", KNOWN), Some("epochs"));
        assert_eq!(nearest("gmama", KNOWN), Some("gamma"));
        assert_eq!(nearest("Hidden", KNOWN), Some("hidden"));
        assert_eq!(nearest("entropy_coeff", KNOWN), Some("entropy_coef"));
        assert_eq!(nearest("nstep", KNOWN), Some("n_step"));
    }

    #[test]
    fn something_else_altogether_is_not_guessed_at() {
        assert_eq!(nearest("learning_rate", KNOWN), None);
        assert_eq!(nearest("x", KNOWN), None);
        assert_eq!(nearest("", KNOWN), None);
        assert_eq!(nearest("x", ["y"]), None);
    }

    #[test]
    fn the_first_of_equally_near_names_wins() {
        assert_eq!(nearest("bat", ["cat", "rat"]), Some("cat"));
        assert_eq!(nearest("bat", ["rat", "cat"]), Some("rat"));
    }
}
