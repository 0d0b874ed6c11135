//! The replay of a foraging trace: set each recorded start, play the recorded actions, compare everything.

use std::fmt::Debug;
use std::io::BufRead;

use rand::RngCore;

use super::record::{Header, Kind, Reset, Step};
use super::{Findings, Lines, ReplayError, Report};
use crate::lbf::{Config, Foraging, Rules, State, N_ACTIONS};
use crate::{End, World};

pub(super) fn replay<R: BufRead>(mut lines: Lines<R>, task: String) -> Result<Report, ReplayError> {
    let mut replay = Replay::new(&lines, &lines.parse()?)?;
    let (mut episodes, mut steps) = (0, 0);
    while lines.advance()? {
        replay.findings.line = lines.number;
        let Kind { kind } = lines.parse()?;
        match kind.as_str() {
            "reset" => replay.reset(&lines.parse()?).map(|()| episodes += 1),
            "step" => replay.step(&lines.parse()?).map(|()| steps += 1),
            _ => Err(format!("expected a record of type `reset` or `step`, found `{kind}`")),
        }
        .map_err(|what| lines.damaged(what))?;
    }
    if episodes == 0 {
        return Err(lines.damaged("expected an episode, found the end of the file"));
    }
    replay.check_over().map_err(|what| lines.damaged(what))?;
    let Findings { mismatches, first, .. } = replay.findings;
    Ok(Report { task, episodes, steps, mismatches, first })
}

struct Replay {
    world: Foraging,
    limit: u32,
    progress: Progress,
    findings: Findings,
    /// Scratch for what the world makes.
    obs: Vec<f32>,
    recorded_obs: Vec<f32>,
    rewards: Vec<f64>,
}

/// Where in an episode the trace is.
pub(super) enum Progress {
    Before,
    Running,
    /// The record and the world say so.
    Over,
    /// Only one of them says so, which is a mismatch already. The trace may go on either way.
    Disputed,
}

/// Damage is described without its place, which the caller adds.
pub(super) type Damage = String;

impl Replay {
    fn new<R: BufRead>(lines: &Lines<R>, header: &Header) -> Result<Replay, ReplayError> {
        let params = &header.params;
        let agents = u16::try_from(header.n_agents);
        let config = Config {
            rows: params.rows,
            cols: params.cols,
            players: agents.map_err(|_| lines.damaged(format!("n_agents is {}", header.n_agents)))?,
            foods: params.max_num_food,
            coop: params.force_coop,
            sight: params.sight,
            penalty: params.penalty,
            episode_limit: header.episode_limit,
            // Versions differ in the reset only, which a replay does not draw.
            rules: Rules::V3,
        };
        let world = Foraging::new(config).map_err(|why| lines.damaged(format!("impossible task: {why}")))?;
        check_header(header, &world).map_err(|what| lines.damaged(what))?;
        let sizes = world.sizes();
        Ok(Replay {
            limit: header.episode_limit,
            progress: Progress::Before,
            findings: Findings::default(),
            obs: vec![0.0; sizes.obs_size[0]],
            recorded_obs: Vec::new(),
            rewards: vec![0.0; sizes.agents],
            world,
        })
    }

    fn reset(&mut self, reset: &Reset) -> Result<(), Damage> {
        self.check_over()?;
        self.check_shape(&reset.obs, &reset.avail_actions)?;
        self.world.set_state(&reset.state).map_err(|error| format!("state: {error}"))?;
        self.progress = Progress::Running;
        (self.findings.episode, self.findings.t) = (reset.episode, 0);
        self.compare_views(&reset.obs, &reset.avail_actions);
        self.compare_state(&reset.state);
        Ok(())
    }

    fn step(&mut self, step: &Step) -> Result<(), Damage> {
        match self.progress {
            Progress::Before => return Err("expected a reset before the first step".to_owned()),
            Progress::Over => return Err("expected a reset, as the episode is over".to_owned()),
            Progress::Running | Progress::Disputed => {}
        }
        let expected = (self.findings.episode, self.findings.t + 1);
        if (step.episode, step.t) != expected {
            return Err(format!(
                "expected step {} of episode {}, found step {} of episode {}",
                expected.1, expected.0, step.t, step.episode
            ));
        }
        self.check_shape(&step.obs, &step.avail_actions)?;
        let agents = self.world.sizes().agents;
        check_length("actions", agents, step.actions.len())?;
        check_length("effective_actions", agents, step.effective_actions.len())?;
        check_length("rewards", agents, step.rewards.len())?;
        check_length("state.players", agents, step.state.players.len())?;
        if let Some(action) = step.actions.iter().find(|&&action| usize::from(action) >= N_ACTIONS) {
            return Err(format!("expected actions below {N_ACTIONS}, found {action}"));
        }

        let end = self.world.step(&step.actions, &mut NoDraws, &mut self.rewards);
        self.findings.t = step.t;
        self.compare_views(&step.obs, &step.avail_actions);
        self.compare_state(&step.state);
        let findings = &mut self.findings;
        findings.list("effective_actions", &step.effective_actions, self.world.effective_actions());
        findings.list("rewards", &step.rewards, &self.rewards);
        // The reference calls its own step limit termination; only the wrapper outside knows truncation.
        let (terminated, truncated) = (end != End::Running, step.t >= u64::from(self.limit));
        findings.value("terminated", &step.terminated, &terminated);
        findings.value("truncated", &step.truncated, &false);
        let reward = self.rewards.iter().fold(0.0, |sum, reward| sum + reward);
        findings.value("epymarl.reward", &step.epymarl.reward, &reward);
        findings.value("epymarl.terminated", &step.epymarl.terminated, &terminated);
        findings.value("epymarl.truncated", &step.epymarl.truncated, &truncated);

        self.progress = match (terminated || truncated, step.terminated || step.truncated || truncated) {
            (true, true) => Progress::Over,
            (false, false) => Progress::Running,
            _ => Progress::Disputed,
        };
        Ok(())
    }

    /// An episode that breaks off has lost records.
    fn check_over(&self) -> Result<(), Damage> {
        match self.progress {
            Progress::Running => {
                let (episode, t) = (self.findings.episode, self.findings.t);
                Err(format!("expected step {} of episode {episode}, which is not over", t + 1))
            }
            Progress::Before | Progress::Over | Progress::Disputed => Ok(()),
        }
    }

    fn check_shape(&self, obs: &[Vec<f64>], avail_actions: &[Vec<u8>]) -> Result<(), Damage> {
        let sizes = self.world.sizes();
        check_length("obs", sizes.agents, obs.len())?;
        check_length("avail_actions", sizes.agents, avail_actions.len())?;
        for i in 0..sizes.agents {
            check_length(&format!("obs[{i}]"), sizes.obs_size[i], obs[i].len())?;
            check_length(&format!("avail_actions[{i}]"), sizes.n_actions[i], avail_actions[i].len())?;
        }
        Ok(())
    }

    fn compare_views(&mut self, obs: &[Vec<f64>], avail_actions: &[Vec<u8>]) {
        for (i, (obs, mask)) in obs.iter().zip(avail_actions).enumerate() {
            self.world.observe(i, &mut self.obs);
            self.recorded_obs.clear();
            self.recorded_obs.extend(obs.iter().map(|&number| number as f32));
            self.findings.list(&format!("obs[{i}]"), &self.recorded_obs, &self.obs);
            let mut available = [0; N_ACTIONS];
            self.world.available(i, &mut available);
            self.findings.list(&format!("avail_actions[{i}]"), mask, &available);
        }
    }

    fn compare_state(&mut self, recorded: &State) {
        let found = self.world.state();
        let findings = &mut self.findings;
        for (i, (expected, found)) in recorded.players.iter().zip(&found.players).enumerate() {
            findings.whole(|| format!("state.players[{i}]"), expected, found);
        }
        findings.whole(|| "state.foods".to_owned(), &recorded.foods, &found.foods);
        let (expected, found_sum) = (recorded.food_level_sum_at_reset, found.food_level_sum_at_reset);
        findings.value("state.food_level_sum_at_reset", &expected, &found_sum);
        findings.value("state.step", &recorded.step, &found.step);
    }
}

/// What the header says twice must agree, or the trace is of another task than it claims.
fn check_header(header: &Header, world: &Foraging) -> Result<(), Damage> {
    let sizes = world.sizes();
    let epymarl = &header.epymarl;
    let (agents, obs_size) = (sizes.agents, sizes.obs_size[0]);
    check_length("agents", agents, header.agents.len())?;
    check_same("obs_sizes", &sizes.obs_size, &header.obs_sizes)?;
    check_same("n_actions", &sizes.n_actions, &header.n_actions)?;
    check_same("epymarl.controlled", &(0..agents).collect(), &epymarl.controlled)?;
    check_same("epymarl.n_agents", &agents, &epymarl.n_agents)?;
    check_same("epymarl.obs_size", &obs_size, &epymarl.obs_size)?;
    check_same("epymarl.n_actions", &N_ACTIONS, &epymarl.n_actions)?;
    check_same("epymarl.state_size", &(agents * obs_size), &epymarl.state_size)?;
    check_same("epymarl.episode_limit", &header.episode_limit, &epymarl.episode_limit)
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

/// A step of foraging draws nothing.
struct NoDraws;

impl RngCore for NoDraws {
    fn next_u32(&mut self) -> u32 {
        unreachable!("a step of foraging is deterministic")
    }
    fn next_u64(&mut self) -> u64 {
        unreachable!("a step of foraging is deterministic")
    }
    fn fill_bytes(&mut self, _: &mut [u8]) {
        unreachable!("a step of foraging is deterministic")
    }
}
