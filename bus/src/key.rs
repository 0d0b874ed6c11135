//! Keys and key expressions by zenoh's rules, on both buses, but without `$*` (a part of a chunk).

use ::zenoh::key_expr::OwnedKeyExpr;

use crate::Error;

/// A key: no wildcards.
pub(crate) fn exact(key: &str) -> Result<OwnedKeyExpr, Error> {
    let expected = "a key such as `run/agent/0/act`";
    let parsed = parse(key, expected)?;
    if key.contains('*') {
        let reason = "`*` is allowed in key expressions only".into();
        return Err(Error::Key { key: key.into(), expected, reason });
    }
    Ok(parsed)
}

/// A key expression: `*` stands for one chunk, `**` for any number of chunks.
pub(crate) fn expression(key_expr: &str) -> Result<OwnedKeyExpr, Error> {
    parse(key_expr, "a key expression such as `run/agent/*/act`")
}

fn parse(key: &str, expected: &'static str) -> Result<OwnedKeyExpr, Error> {
    let fail = |reason: String| Error::Key { key: key.into(), expected, reason };
    if key.contains('$') {
        return Err(fail("`$` is reserved".into()));
    }
    OwnedKeyExpr::new(key).map_err(|error| fail(error.to_string()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn wildcards_stand_for_one_chunk_or_any_number() {
        let matches = |expr, key| expression(expr).unwrap().intersects(&exact(key).unwrap());
        assert!(matches("run/*/act", "run/3/act"));
        assert!(!matches("run/*/act", "run/3/4/act"));
        assert!(!matches("run/*/act", "run/act"));
        assert!(matches("run/**", "run"));
        assert!(matches("run/**/act", "run/3/4/act"));
        assert!(!matches("run/**", "runs/3"));
        assert!(matches("run/3/act", "run/3/act"));
    }

    #[test]
    fn what_is_no_key_is_refused() {
        for bad in ["", "/a", "a/", "a//b", "a/$*", "a#b", "a?b", "a/b*"] {
            assert!(matches!(expression(bad), Err(Error::Key { .. })), "{bad}");
        }
        for wild in ["a/*", "**"] {
            assert!(matches!(exact(wild), Err(Error::Key { .. })), "{wild}");
        }
    }
}
