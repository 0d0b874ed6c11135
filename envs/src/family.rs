//! The families of worlds, as [`crate::task`] uses them.

use crate::{lbf, mpe, rware, smaclite, Opponent, World};

/// All families. A new family is added here.
pub static FAMILIES: [&Family; 4] = [&lbf::FAMILY, &rware::FAMILY, &mpe::FAMILY, &smaclite::FAMILY];

/// A family of tasks that share a world and a form of names.
#[derive(Debug)]
pub struct Family {
    /// Prefix of canonical names: `lbf`.
    pub name: &'static str,
    /// For people: `Level-based foraging`.
    pub title: &'static str,
    /// Some sentences: what happens in these worlds, what agents see and do, and their rewards.
    pub about: &'static str,
    /// Canonical names to list; the first is a good start.
    pub tasks: &'static [&'static str],
    /// The form of names, for messages.
    pub form: &'static str,
    /// Versions of the rules, the default first.
    pub rules: &'static [&'static str],
    /// The version that the multi-timescale paper played.
    pub paper_rules: &'static str,
    /// Makes a task from a name, in any case; `None` if the name is of another family.
    pub make: fn(&Request) -> Option<Result<Made, Refusal>>,
}

/// A requested task.
#[derive(Debug, Clone)]
pub struct Request<'a> {
    pub name: &'a str,
    /// A version of the rules that replaces the one in the name.
    pub rules: Option<&'a str>,
    pub opponent: &'a Opponent,
}

/// A task that a family has made.
pub struct Made {
    /// The canonical name of this task, its rules included.
    pub name: String,
    /// One of [`Family::rules`].
    pub rules: &'static str,
    /// The package and release whose rules these are.
    pub source: &'static str,
    /// A world that has not been reset; to be copied.
    pub world: Box<dyn World>,
}

/// Why a family cannot make a task whose name has its form.
#[derive(Debug, Clone, PartialEq)]
pub enum Refusal {
    /// A part of the name has no meaning.
    Name(String),
    /// The world of this name cannot exist.
    Impossible(String),
    /// The name is that of another package's world, which Rondo does not have.
    Missing(String),
    /// There is no such version of the rules.
    Rules(String),
    /// The task has no opponent, or that one cannot play in it.
    Opponent(String),
}
