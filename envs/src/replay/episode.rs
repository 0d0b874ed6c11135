//! The common parts of the families' replays: the order of records, their shapes, and observations.

use std::fmt::Debug;
use std::io::BufRead;

use super::record::{EpymarlHeader, EpymarlStep, Kind};
use super::{Findings, Lines, ReplayError, Report};
use crate::{End, Sizes, World};

/// Description of a damage. The caller adds its place.
pub(super) type Damage = String;

/// A family's part: its records and its world.
pub(super) trait Episodes {
    type Reset: serde::de::DeserializeOwned;
    type Step: serde::de::DeserializeOwned;

    fn reset(&mut self, reset: &Self::Reset, trace: &mut Trace) -> Result<(), Damage>;
    fn step(&mut self, step: &Self::Step, trace: &mut Trace) -> Result<(), Damage>;

    /// Steps whose differences do not count.
    fn excused(&mut self, _: &mut Findings) -> u64 {
        0
    }
}

/// Plays the records after the header.
pub(super) fn play<R: BufRead, E: Episodes>(
    mut lines: Lines<R>,
    task: String,
    mut family: E,
    mut trace: Trace,
) -> Result<Report, ReplayError> {
    let (mut episodes, mut steps) = (0, 0);
    while lines.advance()? {
        trace.findings.line = lines.number;
        let Kind { kind } = lines.parse()?;
        match kind.as_str() {
            "reset" => family.reset(&lines.parse()?, &mut trace).map(|()| episodes += 1),
            "step" => family.step(&lines.parse()?, &mut trace).map(|()| steps += 1),
            _ => Err(format!("expected a record of type `reset` or `step`, found `{kind}`")),
        }
        .map_err(|what| lines.damaged(what))?;
    }
    if episodes == 0 {
        return Err(lines.damaged("expected an episode, found the end of the file"));
    }
    trace.check_over().map_err(|what| lines.damaged(what))?;
    let excused = family.excused(&mut trace.findings);
    let Findings { mismatches, first, .. } = trace.findings;
    Ok(Report { task, episodes, steps, mismatches, first, excused })
}

/// The present place in a trace, and the results so far.
pub(super) struct Trace {
    pub findings: Findings,
    sizes: Sizes,
    progress: Progress,
    /// Scratch for what agents see.
    seen: Vec<f32>,
    recorded: Vec<f32>,
    available: Vec<u8>,
}

/// The present place in an episode.
pub(super) enum Progress {
    Before,
    Running,
    /// Both the record and the world have ended it.
    Over,
    /// Only one of them has ended it, which is already a mismatch. The trace may continue either way.
    Disputed,
}

impl Trace {
    pub fn new(sizes: &Sizes) -> Trace {
        Trace {
            findings: Findings::default(),
            sizes: sizes.clone(),
            progress: Progress::Before,
            seen: Vec::new(),
            recorded: Vec::new(),
            available: Vec::new(),
        }
    }

    /// Starts an episode.
    pub fn begin(&mut self, episode: u64) {
        self.progress = Progress::Running;
        (self.findings.episode, self.findings.t) = (episode, 0);
    }

    /// Checks that the episode is complete: otherwise records are missing.
    pub fn check_over(&self) -> Result<(), Damage> {
        match self.progress {
            Progress::Running => {
                let (episode, t) = (self.findings.episode, self.findings.t);
                Err(format!("expected step {} of episode {episode}, which is not over", t + 1))
            }
            Progress::Before | Progress::Over | Progress::Disputed => Ok(()),
        }
    }

    /// Whether this step comes next.
    pub fn check_next(&self, episode: u64, t: u64) -> Result<(), Damage> {
        match self.progress {
            Progress::Before => return Err("expected a reset before the first step".to_owned()),
            Progress::Over => return Err("expected a reset, as the episode is over".to_owned()),
            Progress::Running | Progress::Disputed => {}
        }
        let expected = (self.findings.episode, self.findings.t + 1);
        if (episode, t) == expected {
            return Ok(());
        }
        Err(format!(
            "expected step {} of episode {}, found step {t} of episode {episode}",
            expected.1, expected.0
        ))
    }

    /// Checks that every agent has an observation and a mask of the right length.
    pub fn check_views(&self, obs: &[Vec<f64>], avail_actions: &[Vec<u8>]) -> Result<(), Damage> {
        check_length("obs", self.sizes.agents, obs.len())?;
        check_length("avail_actions", self.sizes.agents, avail_actions.len())?;
        for i in 0..self.sizes.agents {
            check_length(&format!("obs[{i}]"), self.sizes.obs_size[i], obs[i].len())?;
            check_length(&format!("avail_actions[{i}]"), self.sizes.n_actions[i], avail_actions[i].len())?;
        }
        Ok(())
    }

    /// Checks that all actions exist.
    pub fn check_actions(&self, actions: &[u16]) -> Result<(), Damage> {
        check_length("actions", self.sizes.agents, actions.len())?;
        for (&action, &n_actions) in actions.iter().zip(&self.sizes.n_actions) {
            if usize::from(action) >= n_actions {
                return Err(format!("expected actions below {n_actions}, found {action}"));
            }
        }
        Ok(())
    }

    /// Compares observations bit by bit, and masks. Their shapes have been checked.
    pub fn compare_views(&mut self, world: &dyn World, obs: &[Vec<f64>], avail_actions: &[Vec<u8>]) {
        for (i, (obs, mask)) in obs.iter().zip(avail_actions).enumerate() {
            self.seen.resize(self.sizes.obs_size[i], 0.0);
            world.observe(i, &mut self.seen);
            self.recorded.clear();
            self.recorded.extend(obs.iter().map(|&number| number as f32));
            self.findings.list(&format!("obs[{i}]"), &self.recorded, &self.seen);
            self.available.resize(self.sizes.n_actions[i], 0);
            world.available(i, &mut self.available);
            self.findings.list(&format!("avail_actions[{i}]"), mask, &self.available);
        }
    }

    /// Compares rewards and ends of a step and moves to it, for a reference without truncation: it reports its own step
    /// limit as a termination, and only the outer wrapper has a limit.
    pub fn compare_outcome(&mut self, recorded: &Outcome, rewards: &[f64], end: End) {
        let (terminated, truncated) =
            (end != End::Running, recorded.t >= u64::from(self.sizes.episode_limit));
        let findings = &mut self.findings;
        findings.list("rewards", recorded.rewards, rewards);
        findings.value("terminated", &recorded.terminated, &terminated);
        findings.value("truncated", &recorded.truncated, &false);
        let reward = rewards.iter().fold(0.0, |sum, reward| sum + reward);
        findings.value("epymarl.reward", &recorded.epymarl.reward, &reward);
        findings.value("epymarl.terminated", &recorded.epymarl.terminated, &terminated);
        findings.value("epymarl.truncated", &recorded.epymarl.truncated, &truncated);
        self.settle(terminated || truncated, recorded.terminated || recorded.truncated || truncated);
    }

    /// Notes whether the episode is over, by what came out here and by the record.
    pub fn settle(&mut self, found: bool, recorded: bool) {
        self.progress = match (found, recorded) {
            (true, true) => Progress::Over,
            (false, false) => Progress::Running,
            _ => Progress::Disputed,
        };
    }
}

/// The recorded outcome of a step.
pub(super) struct Outcome<'a> {
    pub t: u64,
    pub rewards: &'a [f64],
    pub terminated: bool,
    pub truncated: bool,
    pub epymarl: &'a EpymarlStep,
}

/// The sizes in a header.
pub(super) struct RecordedSizes<'a> {
    pub agents: &'a [String],
    pub obs_sizes: &'a Vec<usize>,
    pub n_actions: &'a Vec<usize>,
    pub episode_limit: u32,
    pub epymarl: &'a EpymarlHeader,
}

impl RecordedSizes<'_> {
    /// Checks that the header's redundant numbers agree with the task. All agents are the team's and have the same
    /// sizes.
    pub fn check(&self, sizes: &Sizes) -> Result<(), Damage> {
        self.check_with_state(sizes, sizes.agents * sizes.obs_size[0])
    }

    /// The same for a task whose shared state is not what all agents see together.
    pub fn check_with_state(&self, sizes: &Sizes, state_size: usize) -> Result<(), Damage> {
        let epymarl = self.epymarl;
        let (agents, obs_size, n_actions) = (sizes.agents, sizes.obs_size[0], sizes.n_actions[0]);
        check_length("agents", agents, self.agents.len())?;
        check_same("obs_sizes", &sizes.obs_size, self.obs_sizes)?;
        check_same("n_actions", &sizes.n_actions, self.n_actions)?;
        check_same("epymarl.controlled", &(0..agents).collect(), &epymarl.controlled)?;
        check_same("epymarl.n_agents", &agents, &epymarl.n_agents)?;
        check_same("epymarl.obs_size", &obs_size, &epymarl.obs_size)?;
        check_same("epymarl.n_actions", &n_actions, &epymarl.n_actions)?;
        check_same("epymarl.state_size", &state_size, &epymarl.state_size)?;
        check_same("epymarl.episode_limit", &self.episode_limit, &epymarl.episode_limit)
    }
}

pub(super) fn check_same<T: PartialEq + Debug>(field: &str, expected: &T, found: &T) -> Result<(), Damage> {
    if found == expected {
        Ok(())
    } else {
        Err(format!("expected {expected:?} in `{field}`, found {found:?}"))
    }
}

pub(super) fn check_length(field: &str, expected: usize, found: usize) -> Result<(), Damage> {
    if found == expected {
        Ok(())
    } else {
        Err(format!("expected {expected} entries in `{field}`, found {found}"))
    }
}
