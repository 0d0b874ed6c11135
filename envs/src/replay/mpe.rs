//! The replay of a particle trace: set each recorded start, play the recorded actions of all agents, and compare the
//! package's own values and EPyMARL's.
//!
//! Numbers may differ a little: a recorded `exp` may have been rounded otherwise.

use std::io::BufRead;

use serde::Deserialize;

use super::episode::{check_length, check_same, Damage, Progress};
use super::record::{EpymarlHeader, Kind};
use super::{Findings, Lines, ReplayError, Report};
use crate::mpe::{physics, Body, Game, Layout, Particles, Rules, State, PUSH};
use crate::{End, World};

/// Of positions, velocities and rewards.
const TOLERANCE: f64 = 1e-9;
/// Of observations, which are float32.
const OBS_TOLERANCE: f64 = 1e-6;

#[derive(Deserialize)]
struct Header {
    n_agents: usize,
    n_actions: Vec<usize>,
    obs_sizes: Vec<usize>,
    episode_limit: u32,
    agents: Vec<String>,
    params: Params,
    epymarl: EpymarlHeader,
}

#[derive(Deserialize)]
struct Params {
    dt: f64,
    damping: f64,
    contact_force: f64,
    contact_margin: f64,
    dim_c: usize,
    agents: Vec<AgentParams>,
    landmarks: Vec<LandmarkParams>,
}

#[derive(Deserialize)]
struct AgentParams {
    name: String,
    size: f64,
    movable: bool,
    collide: bool,
    silent: bool,
    accel: Option<f64>,
    max_speed: Option<f64>,
}

#[derive(Deserialize)]
struct LandmarkParams {
    size: f64,
    movable: bool,
    collide: bool,
}

#[derive(Deserialize)]
struct Reset {
    episode: u64,
    state: State,
    /// Float32 values, written so that they are exact when read as doubles and narrowed.
    obs: Vec<Vec<f64>>,
    avail_actions: Vec<Vec<u8>>,
}

#[derive(Deserialize)]
struct Step {
    episode: u64,
    t: u64,
    /// Of all agents, the opponent too.
    actions: Vec<u16>,
    rewards: Vec<f64>,
    obs: Vec<Vec<f64>>,
    terminated: bool,
    truncated: bool,
    avail_actions: Vec<Vec<u8>>,
    epymarl: Wrapped,
    state: State,
}

/// EPyMARL's report of a step.
#[derive(Deserialize)]
struct Wrapped {
    reward: f64,
    terminated: bool,
    truncated: bool,
    /// Present if it repeats the observation from before the step.
    obs: Option<Repeated>,
}

#[derive(Deserialize)]
#[serde(rename_all = "snake_case")]
enum Repeated {
    AsBeforeStep,
}

pub(super) fn replay<R: BufRead>(mut lines: Lines<R>, task: String) -> Result<Report, ReplayError> {
    let mut replay = Replay::new(&task, &lines.parse()?).map_err(|what| lines.damaged(what))?;
    let (mut episodes, mut steps) = (0, 0);
    while lines.advance()? {
        replay.findings.line = lines.number;
        let Kind { kind } = lines.parse()?;
        match kind.as_str() {
            "reset" => replay.reset(lines.parse()?).map(|()| episodes += 1),
            "step" => replay.step(lines.parse()?).map(|()| steps += 1),
            _ => Err(format!("expected a record of type `reset` or `step`, found `{kind}`")),
        }
        .map_err(|what| lines.damaged(what))?;
    }
    if episodes == 0 {
        return Err(lines.damaged("expected an episode, found the end of the file"));
    }
    replay.check_over().map_err(|what| lines.damaged(what))?;
    let Findings { mismatches, first, .. } = replay.findings;
    Ok(Report { task, episodes, steps, mismatches, first, excused: 0 })
}

struct Replay {
    layout: &'static Layout,
    /// Plays under [`Rules::Current`], as the package recorded.
    world: Particles,
    /// Plays the same under [`Rules::Epymarl`].
    wrapped: Particles,
    progress: Progress,
    findings: Findings,
    /// What the last record showed.
    obs_before: Vec<Vec<f64>>,
    /// Scratch for what the worlds make.
    rewards: Vec<f64>,
    wrapped_rewards: Vec<f64>,
}

impl Replay {
    fn new(task: &str, header: &Header) -> Result<Replay, Damage> {
        let game = Game::ALL.into_iter().find(|game| game.layout().task == task).ok_or_else(|| {
            let known = Game::ALL.map(|game| format!("`{}`", game.layout().task)).join(", ");
            format!("expected a task of {known}, found `{task}`")
        })?;
        let (world, wrapped) = (Particles::new(game, Rules::Current), Particles::new(game, Rules::Epymarl));
        let layout = game.layout();
        check_header(header, layout, &world)?;
        let agents = world.sizes().agents;
        Ok(Replay {
            layout,
            world,
            wrapped,
            progress: Progress::Before,
            findings: Findings::default(),
            obs_before: vec![],
            rewards: vec![0.0; agents],
            wrapped_rewards: vec![0.0; agents],
        })
    }

    fn reset(&mut self, reset: Reset) -> Result<(), Damage> {
        self.check_over()?;
        self.check_shape(&reset.obs, &reset.avail_actions)?;
        for world in [&mut self.world, &mut self.wrapped] {
            world.set_state(&reset.state).map_err(|error| format!("state: {error}"))?;
        }
        self.progress = Progress::Running;
        (self.findings.episode, self.findings.t) = (reset.episode, 0);
        self.compare_views(&reset.obs, &reset.avail_actions);
        self.compare_wrapped_views(&reset.obs);
        self.compare_state(&reset.state);
        self.obs_before = reset.obs;
        Ok(())
    }

    fn step(&mut self, step: Step) -> Result<(), Damage> {
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
        let sizes = self.world.sizes();
        check_length("actions", sizes.agents, step.actions.len())?;
        check_length("rewards", sizes.agents, step.rewards.len())?;
        check_length("state.agents", sizes.agents, step.state.agents.len())?;
        check_length("state.landmarks", self.layout.landmarks, step.state.landmarks.len())?;
        for (agent, (&action, &below)) in step.actions.iter().zip(&sizes.n_actions).enumerate() {
            if usize::from(action) >= below {
                return Err(format!("expected an action below {below} of agent {agent}, found {action}"));
            }
        }

        let over = self.world.play(&step.actions, &mut self.rewards) == End::TimeLimit;
        let wrapped_over = self.wrapped.play(&step.actions, &mut self.wrapped_rewards) == End::TimeLimit;
        self.findings.t = step.t;
        self.compare_views(&step.obs, &step.avail_actions);
        self.compare_state(&step.state);
        let (before, epymarl) = (std::mem::take(&mut self.obs_before), &step.epymarl);
        self.compare_wrapped_views(match epymarl.obs {
            Some(Repeated::AsBeforeStep) => &before,
            None => &step.obs,
        });
        let findings = &mut self.findings;
        findings.near("rewards", &step.rewards, &self.rewards, TOLERANCE);
        findings.value("terminated", &step.terminated, &false);
        findings.value("truncated", &step.truncated, &over);
        let reward = self.wrapped_rewards[self.layout.team.clone()].iter().sum();
        findings.near("epymarl.reward", &[epymarl.reward], &[reward], TOLERANCE);
        // EPyMARL does not distinguish the two ends here.
        findings.value("epymarl.terminated", &epymarl.terminated, &wrapped_over);
        findings.value("epymarl.truncated", &epymarl.truncated, &wrapped_over);

        self.progress = match (over, step.terminated || step.truncated) {
            (true, true) => Progress::Over,
            (false, false) => Progress::Running,
            _ => Progress::Disputed,
        };
        self.obs_before = step.obs;
        Ok(())
    }

    /// Checks that the episode is complete: otherwise records are missing.
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
        let most_actions = most(self.world.sizes().n_actions.iter());
        for i in 0..sizes.agents {
            check_length(&format!("obs[{i}]"), sizes.obs_size[i], obs[i].len())?;
            check_length(&format!("avail_actions[{i}]"), most_actions, avail_actions[i].len())?;
        }
        Ok(())
    }

    fn compare_views(&mut self, obs: &[Vec<f64>], avail_actions: &[Vec<u8>]) {
        for (i, (obs, mask)) in obs.iter().zip(avail_actions).enumerate() {
            self.findings.near(&format!("obs[{i}]"), &narrowed(obs), &seen(&self.world, i), OBS_TOLERANCE);
            let mut available = vec![0; mask.len()];
            self.world.available(i, &mut available[..self.world.sizes().n_actions[i]]);
            self.findings.list(&format!("avail_actions[{i}]"), mask, &available);
        }
    }

    /// Compares the team's observations under EPyMARL.
    fn compare_wrapped_views(&mut self, obs: &[Vec<f64>]) {
        for i in self.layout.team.clone() {
            let field = format!("epymarl.obs[{i}]");
            self.findings.near(&field, &narrowed(&obs[i]), &seen(&self.wrapped, i), OBS_TOLERANCE);
        }
    }

    fn compare_state(&mut self, recorded: &State) {
        let found = self.world.state();
        let findings = &mut self.findings;
        for (i, (expected, found)) in recorded.agents.iter().zip(&found.agents).enumerate() {
            findings.near(&format!("state.agents[{i}].pos"), &expected.pos, &found.pos, TOLERANCE);
            findings.near(&format!("state.agents[{i}].vel"), &expected.vel, &found.vel, TOLERANCE);
            findings.whole(|| format!("state.agents[{i}].comm"), &expected.comm, &found.comm);
        }
        for (i, (expected, found)) in recorded.landmarks.iter().zip(&found.landmarks).enumerate() {
            findings.near(&format!("state.landmarks[{i}]"), expected, found, TOLERANCE);
        }
        let (expected, found_goal) = (recorded.goal_landmark, found.goal_landmark);
        findings.whole(|| "state.goal_landmark".to_owned(), &expected, &found_goal);
        findings.value("state.step", &recorded.step, &found.step);
    }
}

/// The float32 values of recorded observations.
fn narrowed(obs: &[f64]) -> Vec<f64> {
    obs.iter().map(|&number| f64::from(number as f32)).collect()
}

/// What an agent sees, as a trace writes it.
fn seen(world: &Particles, agent: usize) -> Vec<f64> {
    let mut seen = vec![0.0; world.sizes().obs_size[agent]];
    world.observe(agent, &mut seen);
    seen.into_iter().map(f64::from).collect()
}

fn most<'a>(sizes: impl Iterator<Item = &'a usize>) -> usize {
    sizes.copied().max().unwrap_or(0)
}

/// Checks the header's numbers of the game.
fn check_header(header: &Header, layout: &Layout, world: &Particles) -> Result<(), Damage> {
    let sizes = world.sizes();
    check_same("n_agents", &sizes.agents, &header.n_agents)?;
    check_same("n_actions", &sizes.n_actions, &header.n_actions)?;
    check_same("obs_sizes", &sizes.obs_size, &header.obs_sizes)?;
    check_same("episode_limit", &sizes.episode_limit, &header.episode_limit)?;
    check_length("agents", sizes.agents, header.agents.len())?;
    for (i, (body, found)) in layout.agents.iter().zip(&header.agents).enumerate() {
        check_same(&format!("agents[{i}]"), &body.name, &found.as_str())?;
    }
    check_params(&header.params, layout)?;

    let (team, epymarl) = (&layout.team, &header.epymarl);
    let obs_size = most(sizes.obs_size[team.clone()].iter());
    check_same("epymarl.controlled", &team.clone().collect(), &epymarl.controlled)?;
    check_same("epymarl.n_agents", &team.len(), &epymarl.n_agents)?;
    check_same("epymarl.obs_size", &obs_size, &epymarl.obs_size)?;
    check_same("epymarl.n_actions", &most(sizes.n_actions.iter()), &epymarl.n_actions)?;
    check_same("epymarl.state_size", &(team.len() * obs_size), &epymarl.state_size)?;
    check_same("epymarl.episode_limit", &sizes.episode_limit, &epymarl.episode_limit)
}

fn check_params(params: &Params, layout: &Layout) -> Result<(), Damage> {
    check_same("params.dt", &physics::DT, &params.dt)?;
    check_same("params.damping", &physics::DAMPING, &params.damping)?;
    check_same("params.contact_force", &physics::CONTACT_FORCE, &params.contact_force)?;
    check_same("params.contact_margin", &physics::CONTACT_MARGIN, &params.contact_margin)?;
    check_same("params.dim_c", &layout.comm_size, &params.dim_c)?;
    check_length("params.agents", layout.agents.len(), params.agents.len())?;
    for (i, (body, found)) in layout.agents.iter().zip(&params.agents).enumerate() {
        let field = |name: &str| format!("params.agents[{i}].{name}");
        let Body { name, radius, movable, collides, max_speed, .. } = body;
        check_same(&field("name"), name, &found.name.as_str())?;
        check_same(&field("size"), radius, &found.size)?;
        check_same(&field("movable"), movable, &found.movable)?;
        check_same(&field("collide"), collides, &found.collide)?;
        check_same(&field("silent"), &!layout.speaks(i), &found.silent)?;
        check_same(&field("max_speed"), max_speed, &found.max_speed)?;
        check_same(&field("accel"), &body.push, &found.accel.unwrap_or(PUSH))?;
    }
    check_length("params.landmarks", layout.landmarks, params.landmarks.len())?;
    for (i, found) in params.landmarks.iter().enumerate() {
        let field = |name: &str| format!("params.landmarks[{i}].{name}");
        check_same(&field("size"), &layout.landmark_radius, &found.size)?;
        check_same(&field("movable"), &false, &found.movable)?;
        check_same(&field("collide"), &layout.landmarks_collide, &found.collide)?;
    }
    Ok(())
}
