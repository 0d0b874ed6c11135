//! Particle worlds of the reference packages that Rondo does not have.

/// Without `-`, which the packages write in different places. MPE2 and PettingZoo, then what PyMARLzoo+ adds.
const GAMES: [&str; 12] = [
    "simple",
    "simplecrypto",
    "simplepush",
    "simplereference",
    "simplespread",
    "simpleworldcomm",
    "simpleformation",
    "simpleline",
    "collecttreasure",
    "multispeakerlistener",
    "climbingspread",
    "doublespread",
];

/// The game of a name such as `simple-spread-v3`, `simplespread-3-v0` or `doublespread-2ag-v0`, without numbers.
pub(super) fn game(name: &str) -> Option<String> {
    let words: Vec<&str> =
        name.split('-').take_while(|word| !is_number(word, "v", "") && !is_number(word, "", "ag")).collect();
    let joined = words.concat();
    GAMES.contains(&&*joined).then(|| words.join("-"))
}

/// Digits between `before` and `after`, the latter of which may be missing.
fn is_number(word: &str, before: &str, after: &str) -> bool {
    let digits = word.strip_prefix(before).map(|rest| rest.strip_suffix(after).unwrap_or(rest));
    digits.is_some_and(|digits| !digits.is_empty() && digits.bytes().all(|byte| byte.is_ascii_digit()))
}
