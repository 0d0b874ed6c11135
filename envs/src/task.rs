//! Tasks by name: the list of them, the meaning of a name, and the error for an unknown name.

use std::fmt;
use std::sync::Arc;

use crate::elsewhere;
use crate::family::{Family, Made, Refusal, Request, FAMILIES};
use crate::padded::{needs_padding, Padded};
use crate::smaclite::{made_of_map, BadMap, MapError};
use crate::{smaclite, Opponent, Sizes, World};

/// A world with all of its parameters. [`task`] makes it, so it can always be played.
pub struct Task {
    family: &'static Family,
    name: String,
    rules: &'static str,
    source: &'static str,
    opponent: Opponent,
    /// The text of a map of the user's own.
    map: Option<Arc<str>>,
    padded: bool,
    /// A world that has not been reset; `make` copies it.
    world: Box<dyn World>,
}

/// A line of the list of tasks.
#[derive(Debug, Clone)]
pub struct TaskInfo {
    pub name: &'static str,
    pub sizes: Sizes,
    /// The package and release whose rules these are.
    pub source: &'static str,
    pub family: &'static Family,
}

/// The name is not a task, or not one that can be played.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum UnknownTask {
    #[error("there is no task `{name}`; the nearest known one is `{nearest}`")]
    NoSuchTask { name: String, nearest: &'static str },
    #[error("there is no task `{name}`: {why}; the nearest known one is `{nearest}`")]
    BadName { name: String, why: String, nearest: &'static str },
    #[error("there is no task `{name}`: {why}")]
    Missing { name: String, why: String },
    #[error("task `{name}` cannot be played: {why}")]
    Impossible { name: String, why: String },
    #[error("task `{name}` has no rules `{found}`; there are {known}")]
    NoSuchRules { name: String, found: String, known: String },
    #[error("task `{name}`: {why}")]
    Opponent { name: String, why: String },
    #[error(transparent)]
    Map(#[from] MapError),
    #[error("the map is that of `{map}`, not of `{name}`")]
    OtherMap { name: String, map: String },
}

/// The task of that name. Spellings of the reference packages are accepted, in any case.
pub fn task(name: &str) -> Result<Task, UnknownTask> {
    Task::made(&Request { name, rules: None, opponent: &Opponent::Builtin })
}

/// The battle on a map of the user's own, from the text of its file (smaclite §1).
pub fn task_of_map(text: &str) -> Result<Task, UnknownTask> {
    Task::of_map(text.into(), None)
}

/// The same by its canonical name, which says the rules.
pub fn named_task_of_map(name: &str, text: &str) -> Result<Task, UnknownTask> {
    let task = task_of_map(text)?;
    let mut all = task.family().rules.iter().filter_map(|rules| task.with_rules(rules).ok());
    all.find(|task| task.name() == name)
        .ok_or_else(|| UnknownTask::OtherMap { name: name.to_owned(), map: task.name().to_owned() })
}

/// The listed tasks. Families have more: see [`Family::form`].
pub fn tasks() -> Vec<TaskInfo> {
    let info = |family: &'static Family, name: &'static str| {
        let task = task(name).expect("a test makes every listed task");
        TaskInfo { name, sizes: task.sizes().clone(), source: task.source, family }
    };
    FAMILIES.iter().flat_map(|family| family.tasks.iter().map(|name| info(family, name))).collect()
}

fn nearest(name: &str) -> &'static str {
    let name = name.to_ascii_lowercase();
    // Prefers a common prefix: the family and the size of the world come first in a name.
    let likeness = |known: &str| strsim::jaro_winkler(known, &name);
    let more_alike = |a: &&str, b: &&str| likeness(a).total_cmp(&likeness(b));
    let known = FAMILIES.iter().flat_map(|family| family.tasks).copied();
    known.max_by(more_alike).expect("the list is not empty")
}

impl Task {
    fn made(request: &Request) -> Result<Task, UnknownTask> {
        let name = request.name.to_owned();
        if let Some(why) = elsewhere::why_not_here(&name) {
            return Err(UnknownTask::Missing { name, why });
        }
        let made = FAMILIES.iter().find_map(|family| Some((*family, (family.make)(request)?)));
        let Some((family, made)) = made else {
            return Err(UnknownTask::NoSuchTask { nearest: nearest(&name), name });
        };
        let made = made.map_err(|refusal| refused(name, family, request.rules, refusal))?;
        Ok(Task { opponent: request.opponent.clone(), ..Task::new(family, made) })
    }

    fn of_map(map: Arc<str>, rules: Option<&str>) -> Result<Task, UnknownTask> {
        let family = &smaclite::FAMILY;
        let made = made_of_map(&map, rules).map_err(|bad| match bad {
            BadMap::Map(error) => UnknownTask::Map(error),
            BadMap::Refused(refusal) => refused("smaclite".to_owned(), family, rules, refusal),
        })?;
        Ok(Task { map: Some(map), ..Task::new(family, made) })
    }

    fn new(family: &'static Family, made: Made) -> Task {
        let Made { name, rules, source, world } = made;
        Task { family, name, rules, source, opponent: Opponent::Builtin, map: None, padded: false, world }
    }

    /// The text of the map that the task was made of, where it is not one that the program brings.
    pub fn map(&self) -> Option<&str> {
        self.map.as_deref()
    }

    /// The canonical name, the same for all spellings of one task.
    pub fn name(&self) -> &str {
        &self.name
    }

    pub fn family(&self) -> &'static Family {
        self.family
    }

    /// The version of the family's rules, such as `v3`.
    pub fn rules(&self) -> &'static str {
        self.rules
    }

    /// The package and release whose rules these are.
    pub fn source(&self) -> &'static str {
        self.source
    }

    /// What a user should know before a team learns it: see [`World::warning`].
    pub fn warning(&self) -> Option<String> {
        self.world.warning()
    }

    /// The same task under another version of the rules.
    pub fn with_rules(&self, version: &str) -> Result<Task, UnknownTask> {
        if let Some(map) = &self.map {
            return Task::of_map(map.clone(), Some(version));
        }
        let request = Request { name: &self.name, rules: Some(version), opponent: &self.opponent };
        Task::made(&request).map(|task| task.padded_if(self.padded))
    }

    /// The same task with another opponent.
    pub fn with_opponent(&self, opponent: &Opponent) -> Result<Task, UnknownTask> {
        if self.map.is_some() && *opponent == Opponent::Builtin {
            return Ok(self.clone());
        }
        if self.map.is_some() {
            return Err(refused(self.name.clone(), self.family, None, smaclite::no_opponent()));
        }
        let request = Request { name: &self.name, rules: None, opponent };
        Task::made(&request).map(|task| task.padded_if(self.padded))
    }

    /// The same task, padded: all agents get the sizes of the largest one (algorithms §2.4). Zeros follow an agent's
    /// own observation, and padding actions are never available. A team with equal sizes stays as it is.
    pub fn padded(&self) -> Task {
        self.clone().padded_if(true)
    }

    /// Whether the task is padded.
    pub fn is_padded(&self) -> bool {
        self.padded
    }

    fn padded_if(self, wanted: bool) -> Task {
        if !wanted || self.padded || !needs_padding(self.sizes()) {
            return self;
        }
        Task { padded: true, world: Box::new(Padded::new(self.world)), ..self }
    }

    pub fn sizes(&self) -> &Sizes {
        self.world.sizes()
    }

    /// A new world of this task. Reset it before use.
    pub fn make(&self) -> Box<dyn World> {
        self.world.copy()
    }
}

/// What somebody is told whose task cannot be made.
fn refused(name: String, family: &Family, rules: Option<&str>, refusal: Refusal) -> UnknownTask {
    match refusal {
        Refusal::Name(why) => UnknownTask::BadName { nearest: nearest(&name), name, why },
        Refusal::Impossible(why) => match rules {
            Some(rules) => UnknownTask::Impossible { name, why: format!("{why} (rules {rules})") },
            None => UnknownTask::Impossible { name, why },
        },
        Refusal::Missing(why) => UnknownTask::Missing { name, why },
        Refusal::Rules(found) => UnknownTask::NoSuchRules { name, found, known: family.rules.join(", ") },
        Refusal::Opponent(why) => UnknownTask::Opponent { name, why },
    }
}

impl Clone for Task {
    fn clone(&self) -> Self {
        Self {
            name: self.name.clone(),
            opponent: self.opponent.clone(),
            map: self.map.clone(),
            world: self.world.copy(),
            ..*self
        }
    }
}

impl fmt::Debug for Task {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Task").field("name", &self.name).finish_non_exhaustive()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn refusal(name: &str) -> String {
        task(name).map(|task| task.name().to_owned()).expect_err("not a task").to_string()
    }

    #[test]
    fn every_listed_name_is_canonical_and_its_sizes_are_those_of_the_spec() {
        for info in tasks() {
            let task = task(info.name).unwrap();
            assert_eq!(task.name(), info.name);
            assert_eq!(task.rules(), task.family().rules[0], "{}", info.name);
        }
        for (name, obs_size) in [("lbf-8x8-2p-2f-coop", 12), ("lbf-10x10-3p-3f", 18), ("lbf-15x15-4p-3f", 21)]
        {
            let task = task(name).unwrap();
            let agents = task.sizes().agents;
            let expected = Sizes {
                agents,
                obs_size: vec![obs_size; agents],
                n_actions: vec![6; agents],
                episode_limit: 50,
            };
            assert_eq!(*task.sizes(), expected);
        }
    }

    #[test]
    fn other_rules_are_another_task() {
        let paper = task("lbforaging:Foraging-10x10-3p-3f-v3").unwrap().with_rules("v2").unwrap();
        assert_eq!((paper.name(), paper.rules()), ("lbf-10x10-3p-3f-v2", "v2"));
        assert_eq!(paper.with_rules("V3").unwrap().name(), "lbf-10x10-3p-3f");
        assert_eq!(
            paper.with_rules("v7").unwrap_err().to_string(),
            "task `lbf-10x10-3p-3f-v2` has no rules `v7`; there are v3, v2, v1, v0"
        );
        let crowded = task("lbf-3x3-8p-1f").unwrap();
        assert_eq!(
            crowded.with_rules("v1").unwrap_err().to_string(),
            "task `lbf-3x3-8p-1f` cannot be played: 8 players do not fit on 4 cells, which is where they start \
             on this grid (rules v1)"
        );
    }

    #[test]
    fn a_wrong_name_is_answered_with_what_to_do() {
        assert_eq!(
            refusal("lfb-8x8-2p-2f-coop"),
            "there is no task `lfb-8x8-2p-2f-coop`; the nearest known one is `lbf-8x8-2p-2f-coop`"
        );
        assert_eq!(
            refusal("lbf-8x8-2p-2"),
            format!(
                "there is no task `lbf-8x8-2p-2`: expected a number of foods such as `2f`, found `2`; the form is \
                 {}; the nearest known one is `lbf-8x8-2p-2f-coop`",
                FAMILIES[0].form
            )
        );
        assert_eq!(
            refusal("lbf-8x8-0p-2f"),
            "task `lbf-8x8-0p-2f` cannot be played: the number of players must be 1 to 64, not 0"
        );
    }
}
