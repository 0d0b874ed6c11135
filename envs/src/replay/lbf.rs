//! The replay of a foraging trace: set each recorded start, play the recorded actions, compare everything.

use std::io::BufRead;

use rand::RngCore;

use super::episode::{check_length, play, Damage, Episodes, Outcome, RecordedSizes, Trace};
use super::record::{Header, Reset, Step};
use super::{Lines, ReplayError, Report};
use crate::lbf::{Config, Foraging, Rules, State};
use crate::World;

pub(super) fn replay<R: BufRead>(lines: Lines<R>, task: String) -> Result<Report, ReplayError> {
    let header: Header = lines.parse()?;
    let world = world(&header).map_err(|what| lines.damaged(what))?;
    let trace = Trace::new(world.sizes());
    let rewards = vec![0.0; world.sizes().agents];
    play(lines, task, Replay { world, rewards }, trace)
}

/// The world that the header describes.
fn world(header: &Header) -> Result<Foraging, Damage> {
    let params = &header.params;
    let config = Config {
        rows: params.rows,
        cols: params.cols,
        players: u16::try_from(header.n_agents).map_err(|_| format!("n_agents is {}", header.n_agents))?,
        foods: params.max_num_food,
        coop: params.force_coop,
        sight: params.sight,
        penalty: params.penalty,
        episode_limit: header.episode_limit,
        // Versions differ in the reset only, which a replay does not use.
        rules: Rules::V3,
    };
    let world = Foraging::new(config).map_err(|why| format!("impossible task: {why}"))?;
    let sizes = RecordedSizes {
        agents: &header.agents,
        obs_sizes: &header.obs_sizes,
        n_actions: &header.n_actions,
        episode_limit: header.episode_limit,
        epymarl: &header.epymarl,
    };
    sizes.check(world.sizes())?;
    Ok(world)
}

struct Replay {
    world: Foraging,
    /// Scratch.
    rewards: Vec<f64>,
}

impl Episodes for Replay {
    type Reset = Reset;
    type Step = Step;

    fn reset(&mut self, reset: &Reset, trace: &mut Trace) -> Result<(), Damage> {
        trace.check_over()?;
        trace.check_views(&reset.obs, &reset.avail_actions)?;
        self.world.set_state(&reset.state).map_err(|error| format!("state: {error}"))?;
        trace.begin(reset.episode);
        trace.compare_views(&self.world, &reset.obs, &reset.avail_actions);
        self.compare_state(&reset.state, trace);
        Ok(())
    }

    fn step(&mut self, step: &Step, trace: &mut Trace) -> Result<(), Damage> {
        trace.check_next(step.episode, step.t)?;
        trace.check_views(&step.obs, &step.avail_actions)?;
        trace.check_actions(&step.actions)?;
        let agents = self.rewards.len();
        check_length("effective_actions", agents, step.effective_actions.len())?;
        check_length("rewards", agents, step.rewards.len())?;
        check_length("state.players", agents, step.state.players.len())?;

        let end = self.world.step(&step.actions, &mut NoDraws, &mut self.rewards);
        trace.findings.t = step.t;
        trace.compare_views(&self.world, &step.obs, &step.avail_actions);
        self.compare_state(&step.state, trace);
        trace.findings.list("effective_actions", &step.effective_actions, self.world.effective_actions());
        let Step { t, terminated, truncated, .. } = *step;
        let outcome = Outcome { t, rewards: &step.rewards, terminated, truncated, epymarl: &step.epymarl };
        trace.compare_outcome(&outcome, &self.rewards, end);
        Ok(())
    }
}

impl Replay {
    fn compare_state(&self, recorded: &State, trace: &mut Trace) {
        let found = self.world.state();
        let findings = &mut trace.findings;
        for (i, (expected, found)) in recorded.players.iter().zip(&found.players).enumerate() {
            findings.whole(|| format!("state.players[{i}]"), expected, found);
        }
        findings.whole(|| "state.foods".to_owned(), &recorded.foods, &found.foods);
        let (expected, found_sum) = (recorded.food_level_sum_at_reset, found.food_level_sum_at_reset);
        findings.value("state.food_level_sum_at_reset", &expected, &found_sum);
        findings.value("state.step", &recorded.step, &found.step);
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
