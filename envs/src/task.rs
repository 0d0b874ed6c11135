//! Tasks by name: which exist, what a name means, and what to say about a name that means nothing.

use crate::lbf::{self, Foraging, Impossible, NameError, Rules};
use crate::{Sizes, World};

/// The foraging tasks that [`tasks`] lists: those of the multi-timescale study, then the rest of the usual
/// benchmark.
const FORAGING: [&str; 8] = [
    "lbf-5x5-2p-1f",
    "lbf-8x8-2p-2f-coop",
    "lbf-10x10-3p-3f",
    "lbf-15x15-4p-3f",
    "lbf-2s-8x8-2p-2f-coop",
    "lbf-2s-10x10-3p-3f",
    "lbf-15x15-3p-5f",
    "lbf-15x15-4p-5f",
];

/// A kind of world with all of its numbers. Made by [`task`], so it can always be played.
#[derive(Debug, Clone)]
pub struct Task {
    name: String,
    kind: Kind,
}

/// One arm per family, with a world that was never reset: `make` copies it.
#[derive(Debug, Clone)]
enum Kind {
    Foraging(Foraging),
}

/// A line of the list of tasks.
#[derive(Debug, Clone)]
pub struct TaskInfo {
    pub name: &'static str,
    pub sizes: Sizes,
    /// The package and release whose rules these are.
    pub source: &'static str,
    /// What other names of the same family work.
    pub note: String,
}

/// A name that is no task, or not one that can be played.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum UnknownTask {
    #[error("there is no task `{name}`; the nearest known one is `{nearest}`")]
    NoSuchTask { name: String, nearest: &'static str },
    #[error("there is no task `{name}`: {why}; the nearest known one is `{nearest}`")]
    BadName { name: String, why: String, nearest: &'static str },
    #[error("task `{name}` cannot be played: {why}")]
    Impossible { name: String, why: Impossible },
    #[error("task `{name}` has no rules `{found}`; there are {known}")]
    NoSuchRules { name: String, found: String, known: String },
}

/// The task of that name. Spellings of the reference packages are understood, in any case of letters.
pub fn task(name: &str) -> Result<Task, UnknownTask> {
    match lbf::parse(name) {
        Some(Ok(config)) => Task::foraging(config),
        Some(Err(NameError::Impossible(why))) => Err(UnknownTask::Impossible { name: name.to_owned(), why }),
        Some(Err(why)) => {
            Err(UnknownTask::BadName { name: name.to_owned(), why: why.to_string(), nearest: nearest(name) })
        }
        None => Err(UnknownTask::NoSuchTask { name: name.to_owned(), nearest: nearest(name) }),
    }
}

/// The tasks worth listing. Families have more: see each [`TaskInfo::note`].
pub fn tasks() -> Vec<TaskInfo> {
    let info = |name: &'static str| {
        let task = task(name).expect("a test makes every listed task");
        let note = format!("family {}", lbf::FORM);
        TaskInfo { name, sizes: task.sizes().clone(), source: task.source(), note }
    };
    FORAGING.into_iter().map(info).collect()
}

fn nearest(name: &str) -> &'static str {
    let name = name.to_ascii_lowercase();
    // Favours a common beginning: the size of the world comes first in a name.
    let likeness = |known: &str| strsim::jaro_winkler(known, &name);
    let more_alike = |a: &&str, b: &&str| likeness(a).total_cmp(&likeness(b));
    FORAGING.into_iter().max_by(more_alike).expect("the list is not empty")
}

impl Task {
    fn foraging(config: lbf::Config) -> Result<Task, UnknownTask> {
        let name = config.name();
        match Foraging::new(config) {
            Ok(world) => Ok(Task { name, kind: Kind::Foraging(world) }),
            Err(why) => Err(UnknownTask::Impossible { name, why }),
        }
    }

    /// The canonical name: equal for all spellings of one task.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// The family of worlds, as names begin: `lbf`.
    pub fn family(&self) -> &'static str {
        match &self.kind {
            Kind::Foraging(_) => "lbf",
        }
    }

    /// The version of the family's rules, such as `v3`.
    pub fn rules(&self) -> &'static str {
        match &self.kind {
            Kind::Foraging(world) => world.config().rules.name(),
        }
    }

    /// The package and release whose rules these are.
    pub fn source(&self) -> &'static str {
        match &self.kind {
            Kind::Foraging(world) => world.config().rules.source(),
        }
    }

    /// The same task under another version of the rules (`v2` is what the study's paper used for foraging).
    pub fn with_rules(&self, version: &str) -> Result<Task, UnknownTask> {
        match &self.kind {
            Kind::Foraging(world) => {
                let rules = Rules::parse(version).ok_or_else(|| UnknownTask::NoSuchRules {
                    name: self.name.clone(),
                    found: version.to_owned(),
                    known: Rules::ALL.map(Rules::name).join(", "),
                })?;
                Task::foraging(lbf::Config { rules, ..world.config().clone() })
            }
        }
    }

    pub fn sizes(&self) -> &Sizes {
        match &self.kind {
            Kind::Foraging(world) => world.sizes(),
        }
    }

    /// A new world of this task. Reset it before anything else.
    pub fn make(&self) -> Box<dyn World> {
        match &self.kind {
            Kind::Foraging(world) => Box::new(world.clone()),
        }
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
            assert_eq!((task.family(), task.rules(), task.source()), ("lbf", "v3", "lbforaging 2.0.0"));
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
            "task `lbf-10x10-3p-3f-v2` has no rules `v7`; there are v0, v1, v2, v3"
        );
        let crowded = task("lbf-3x3-8p-1f").unwrap();
        assert_eq!(
            crowded.with_rules("v1").unwrap_err().to_string(),
            "task `lbf-3x3-8p-1f-v1` cannot be played: 8 players do not fit on 4 cells, which is where they \
             start on this grid"
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
                lbf::FORM
            )
        );
        assert_eq!(
            refusal("lbf-8x8-0p-2f"),
            "task `lbf-8x8-0p-2f` cannot be played: the number of players must be 1 to 64, not 0"
        );
    }
}
