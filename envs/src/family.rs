//! The families of worlds: what [`crate::task`] knows of each of them.

use crate::{lbf, mpe, rware, smaclite, Opponent, World};

/// All families. A new one is added by its line here.
pub static FAMILIES: [&Family; 4] = [&lbf::FAMILY, &rware::FAMILY, &mpe::FAMILY, &smaclite::FAMILY];

/// A family of tasks that share a world and a form of names.
#[derive(Debug)]
pub struct Family {
    /// As canonical names begin: `lbf`.
    pub name: &'static str,
    /// For people: `Level-based foraging`.
    pub title: &'static str,
    /// What happens in these worlds, what agents see and do and are rewarded for; some sentences.
    pub about: &'static str,
    /// Canonical names worth listing; the first is a good one to begin with.
    pub tasks: &'static [&'static str],
    /// The form of names, for messages.
    pub form: &'static str,
    /// Versions of the rules, the default first.
    pub rules: &'static [&'static str],
    /// The version that the multi-timescale paper played.
    pub paper_rules: &'static str,
    /// Understands a name, in any case of letters; `None` where it is of another family.
    pub make: fn(&Request) -> Option<Result<Made, Refusal>>,
}

/// A task that somebody asks for.
#[derive(Debug, Clone)]
pub struct Request<'a> {
    pub name: &'a str,
    /// Another version of the rules than the name says.
    pub rules: Option<&'a str>,
    pub opponent: &'a Opponent,
}

/// What a family makes of a request.
pub struct Made {
    /// The one name that is printed for this task, its rules included.
    pub name: String,
    /// One of [`Family::rules`].
    pub rules: &'static str,
    /// The package and release whose rules these are.
    pub source: &'static str,
    /// Never reset; to be copied.
    pub world: Box<dyn World>,
}

/// Why a family cannot make what was asked for, though the name is of its form.
#[derive(Debug, Clone, PartialEq)]
pub enum Refusal {
    /// Something in the name means nothing.
    Name(String),
    /// The name has a meaning, and that world cannot exist.
    Impossible(String),
    /// The name means a world of another package that is not here.
    Missing(String),
    /// There is no such version of the rules.
    Rules(String),
    /// The task has no opponent, or that one cannot play in it.
    Opponent(String),
}
