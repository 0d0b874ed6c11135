//! The configuration as a TOML file, and its digest.

use super::Config;
use crate::config::AlgoName;
use crate::presets::{self, Family};
use crate::suggest::nearest;
use thiserror::Error;
use toml::de::{DeTable, DeValue};
use toml::Table;

/// Why a configuration cannot be used. The texts are for the person who wrote the file.
#[derive(Debug, Clone, PartialEq, Eq, Error)]
pub enum ConfigError {
    /// Not TOML, a missing key or a value of the wrong kind; with line, column and excerpt.
    #[error("the configuration cannot be read: {0}")]
    Toml(String),
    /// Unknown keys, one entry each.
    #[error("{}", numbered(.0, "unknown key"))]
    UnknownKeys(Vec<String>),
    /// Invalid values, one entry each.
    #[error("{}", numbered(.0, "mistake"))]
    Invalid(Vec<String>),
}

fn numbered(entries: &[String], what: &str) -> String {
    let plural = if entries.len() == 1 { "" } else { "s" };
    let mut text = format!("the configuration has {} {what}{plural}", entries.len());
    for entry in entries {
        text.push_str("\n  - ");
        text.push_str(entry);
    }
    text
}

impl Config {
    /// Reads a TOML file that has every key. Values are not checked: see [`Config::validate`].
    ///
    /// # Errors
    /// [`ConfigError::UnknownKeys`] with the nearest known key of each, else [`ConfigError::Toml`].
    pub fn from_toml(text: &str) -> Result<Self, ConfigError> {
        let readable = |error: toml::de::Error| ConfigError::Toml(error.to_string().trim_end().to_owned());
        let document = DeTable::parse(text).map_err(readable)?;
        let unknown = unknown_keys(document.get_ref(), text);
        if !unknown.is_empty() {
            return Err(ConfigError::UnknownKeys(unknown));
        }
        toml::from_str(text).map_err(readable)
    }

    /// The configuration as a TOML file, always with the same keys in the same order; this text goes into the run
    /// folder verbatim.
    pub fn to_toml(&self) -> String {
        toml::to_string(self)
            .expect("plain numbers, strings, lists and tables below plain values are always TOML")
    }

    /// BLAKE3 of [`Config::to_toml`]. The processes of a run compare it when an agent joins.
    pub fn digest(&self) -> [u8; 32] {
        *blake3::hash(self.to_toml().as_bytes()).as_bytes()
    }
}

/// One entry for each unknown key, in the order of the file.
fn unknown_keys(document: &DeTable<'_>, text: &str) -> Vec<String> {
    let known = known_keys();
    let mut unknown = Vec::new();
    for (key, value) in document {
        let name = key.get_ref().as_ref();
        match (known.get(name), value.get_ref()) {
            (None, _) => unknown.push((key.span().start, "", name)),
            (Some(toml::Value::Table(section)), DeValue::Table(found)) => {
                let strangers = found.keys().filter(|key| !section.contains_key(key.get_ref().as_ref()));
                unknown.extend(strangers.map(|key| (key.span().start, name, key.get_ref().as_ref())));
            }
            _ => {}
        }
    }
    unknown.sort_unstable();
    unknown
        .into_iter()
        .map(|(at, section, name)| {
            let line = 1 + text.bytes().take(at).filter(|&b| b == b'\n').count();
            format!("line {line}: `{}` is not a key; {}", dotted(section, name), hint(&known, section, name))
        })
        .collect()
}

/// The nearest known key of the same section, else a key or section of that name anywhere.
fn hint(known: &Table, section: &str, name: &str) -> String {
    let of = |section: &str| match known.get(section) {
        Some(toml::Value::Table(table)) => table.keys().map(String::as_str).collect::<Vec<_>>(),
        _ => known.keys().map(String::as_str).collect(),
    };
    let near = nearest(name, of(section)).map(|key| dotted(section, key));
    let elsewhere = || {
        let sections =
            known.iter().filter(|(_, value)| value.is_table()).map(|(section, _)| section.as_str());
        [""].into_iter()
            .chain(sections)
            .find_map(|other| nearest(name, of(other)).map(|key| dotted(other, key)))
    };
    match near.or_else(elsewhere) {
        Some(key) => format!("did you mean `{key}`?"),
        None => format!("expected one of {}", of(section).join(", ")),
    }
}

fn dotted(section: &str, key: &str) -> String {
    if section.is_empty() {
        key.to_owned()
    } else {
        format!("{section}.{key}")
    }
}

/// All keys. They are read from a configuration with the sections of all learners, so the list always matches the
/// structs.
fn known_keys() -> Table {
    let ppo = presets::config("example", "example", 2, AlgoName::Ippo, Family::Lbf);
    let mut example = Config { q: Some(presets::q_defaults()), ..ppo };
    example.world.map = Some(String::new());
    Table::try_from(example).expect("the preset holds plain values only")
}

#[cfg(test)]
mod tests;
