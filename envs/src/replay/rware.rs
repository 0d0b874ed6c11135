//! The replay of a warehouse trace: set each recorded start, play the recorded actions with the recorded draws, and
//! compare all values.

use std::io::BufRead;

use serde::Deserialize;

use super::episode::{check_length, check_same, play, Damage, Episodes, Outcome, RecordedSizes, Trace};
use super::record::{EpymarlHeader, EpymarlStep};
use super::{Lines, ReplayError, Report};
use crate::rware::{Config, Direction, Impossible, Layout, Requests, Robot, Rules, State, Warehouse};
use crate::World;

pub(super) fn replay<R: BufRead>(lines: Lines<R>, task: String) -> Result<Report, ReplayError> {
    let header: Header = lines.parse()?;
    let world = world(&header).map_err(|what| lines.damaged(what))?;
    let trace = Trace::new(world.sizes());
    let rewards = vec![0.0; world.sizes().agents];
    play(lines, task, Replay { world, rewards }, trace)
}

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
    height: u16,
    width: u16,
    /// A line per row, `1` for a highway and `0` for a slot.
    highways: Vec<String>,
    goals_xy: Vec<(u16, u16)>,
    request_queue_size: u16,
    sensor_range: u16,
}

#[derive(Deserialize)]
struct Reset {
    episode: u64,
    state: Start,
    /// Float32 values, written so that they are exact when read as doubles and narrowed.
    obs: Vec<Vec<f64>>,
    avail_actions: Vec<Vec<u8>>,
}

#[derive(Deserialize)]
struct Start {
    agents: Vec<Agent>,
    shelves: Vec<Shelf>,
    request_queue: Vec<u16>,
    step: u32,
}

#[derive(Deserialize)]
struct Step {
    episode: u64,
    t: u64,
    actions: Vec<u16>,
    random: Random,
    effective_actions: Vec<u16>,
    /// Robot numbers.
    ties: Vec<Vec<usize>>,
    rewards: Vec<f64>,
    obs: Vec<Vec<f64>>,
    terminated: bool,
    truncated: bool,
    avail_actions: Vec<Vec<u8>>,
    epymarl: EpymarlStep,
    state: Later,
}

#[derive(Deserialize)]
struct Random {
    new_requests: Vec<u16>,
}

/// The state after a step, which lists only the shelves away from their slots.
#[derive(Deserialize)]
struct Later {
    agents: Vec<Agent>,
    displaced_shelves: Vec<Shelf>,
    request_queue: Vec<u16>,
    step: u32,
}

/// A robot. Robots are numbered from 1; shelf 0 means none.
#[derive(Debug, PartialEq, Deserialize)]
struct Agent {
    id: usize,
    x: u16,
    y: u16,
    dir: Direction,
    carrying: u16,
}

/// Id, x, y.
type Shelf = (u16, u16, u16);

/// The warehouse that the header describes.
fn world(header: &Header) -> Result<Warehouse, Damage> {
    let Params { request_queue_size, sensor_range, .. } = header.params;
    let robots = u16::try_from(header.n_agents).map_err(|_| format!("n_agents is {}", header.n_agents))?;
    let config = |(shelf_rows, shelf_columns, column_height)| Config {
        shelf_rows,
        shelf_columns,
        column_height,
        robots,
        requests: request_queue_size,
        sensor_range,
        episode_limit: header.episode_limit,
        // The versions play alike.
        rules: Rules::V2,
    };
    let impossible = |why: Impossible| format!("impossible task: {why}");
    let (width, height) = (header.params.width, header.params.height);
    let mut worlds = blocks(width, height).map(|blocks| Warehouse::new(config(blocks)).map_err(impossible));
    let first = worlds.next().ok_or_else(|| {
        format!(
            "expected a grid of shelf blocks between highways, 3 columns each and 1 more, found {width}x{height} cells"
        )
    })?;
    // The rows of the map show the height of the blocks. If none fits, the error is that of the first.
    let mut world = first?;
    let fits = |world: &Warehouse| highways(world.layout()) == header.params.highways;
    if !fits(&world) {
        world = worlds.flatten().find(fits).unwrap_or(world);
    }
    let expected = highways(world.layout());
    check_length("params.highways", expected.len(), header.params.highways.len())?;
    for (y, (expected, found)) in expected.iter().zip(&header.params.highways).enumerate() {
        check_same(&format!("params.highways[{y}]"), expected, found)?;
    }
    check_same("params.goals_xy", &world.layout().goals.to_vec(), &header.params.goals_xy)?;
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

/// Rows, columns and heights of shelf blocks that make a grid of this width and height, the usual height first.
fn blocks(width: u16, height: u16) -> impl Iterator<Item = (u16, u16, u16)> {
    let columns = (width % 3 == 1).then_some(width / 3);
    let room = height.saturating_sub(2);
    let heights = std::iter::once(8).chain(1..room);
    columns.into_iter().flat_map(move |columns| {
        let whole = heights.clone().filter(move |high| room > 0 && room.is_multiple_of(high + 1));
        whole.map(move |high| (room / (high + 1), columns, high))
    })
}

/// The map in the form of headers.
fn highways(layout: &Layout) -> Vec<String> {
    let cell = |x, y| if layout.is_highway(x, y) { '1' } else { '0' };
    (0..layout.height).map(|y| (0..layout.width).map(|x| cell(x, y)).collect()).collect()
}

struct Replay {
    world: Warehouse,
    /// Scratch.
    rewards: Vec<f64>,
}

impl Episodes for Replay {
    type Reset = Reset;
    type Step = Step;

    fn reset(&mut self, reset: &Reset, trace: &mut Trace) -> Result<(), Damage> {
        trace.check_over()?;
        trace.check_views(&reset.obs, &reset.avail_actions)?;
        check_length("state.agents", self.rewards.len(), reset.state.agents.len())?;
        let state = state(&reset.state)?;
        self.world.set_state(&state).map_err(|error| format!("state: {error}"))?;
        trace.begin(reset.episode);
        trace.compare_views(&self.world, &reset.obs, &reset.avail_actions);
        Ok(())
    }

    fn step(&mut self, step: &Step, trace: &mut Trace) -> Result<(), Damage> {
        trace.check_next(step.episode, step.t)?;
        trace.check_views(&step.obs, &step.avail_actions)?;
        trace.check_actions(&step.actions)?;
        let agents = self.rewards.len();
        check_length("effective_actions", agents, step.effective_actions.len())?;
        check_length("rewards", agents, step.rewards.len())?;
        check_length("state.agents", agents, step.state.agents.len())?;

        let recorded = &step.random.new_requests;
        let mut drawn = Vec::new();
        let end = self.world.step_with(&step.actions, &mut self.rewards, |requests| {
            let choice = recorded_draw(recorded.get(drawn.len()), requests);
            drawn.push(choice);
            choice
        });
        trace.findings.t = step.t;
        trace.compare_views(&self.world, &step.obs, &step.avail_actions);
        let ties: Vec<Vec<usize>> = self.world.ties();
        let found = ties.iter().map(|group| group.iter().map(|robot| robot + 1).collect()).collect();
        let findings = &mut trace.findings;
        findings.whole(|| "random.new_requests".to_owned(), recorded, &drawn);
        findings.list("effective_actions", &step.effective_actions, self.world.effective_actions());
        findings.whole(|| "ties".to_owned(), &in_order(&step.ties), &found);
        self.compare_state(&step.state, trace);
        let Step { t, terminated, truncated, .. } = *step;
        let outcome = Outcome { t, rewards: &step.rewards, terminated, truncated, epymarl: &step.epymarl };
        trace.compare_outcome(&outcome, &self.rewards, end);
        Ok(())
    }
}

impl Replay {
    fn compare_state(&self, recorded: &Later, trace: &mut Trace) {
        let State { robots, shelves, request_queue, step } = self.world.state();
        let findings = &mut trace.findings;
        for (i, (expected, robot)) in recorded.agents.iter().zip(&robots).enumerate() {
            let Robot { x, y, direction, carrying } = *robot;
            let found = Agent { id: i + 1, x, y, dir: direction, carrying: carrying.unwrap_or(0) };
            findings.whole(|| format!("state.agents[{i}]"), expected, &found);
        }
        let all = (1..).zip(&shelves).zip(&self.world.layout().slots);
        let displaced = all.filter(|((_, place), slot)| place != slot).map(|((id, &(x, y)), _)| (id, x, y));
        let displaced: Vec<Shelf> = displaced.collect();
        findings.whole(|| "state.displaced_shelves".to_owned(), &recorded.displaced_shelves, &displaced);
        findings.whole(|| "state.request_queue".to_owned(), &recorded.request_queue, &request_queue);
        findings.value("state.step", &recorded.step, &step);
    }
}

/// The recorded choice. If it is missing or not allowed, the first allowed shelf: the comparison of draws then finds
/// the difference.
fn recorded_draw(recorded: Option<&u16>, requests: &Requests) -> u16 {
    let allowed = |id: &u16| requests.unrequested().any(|other| other == *id);
    let first = || requests.unrequested().next().expect("a warehouse has more shelves than requests");
    recorded.copied().filter(allowed).unwrap_or_else(first)
}

/// Groups in the order of their robots; the trace's own order has no meaning.
fn in_order(ties: &[Vec<usize>]) -> Vec<Vec<usize>> {
    let mut ties = ties.to_vec();
    ties.sort();
    ties
}

/// The recorded start as a state, where robots and shelves come in the order of their numbers.
fn state(start: &Start) -> Result<State, Damage> {
    let robot = |(number, agent): (usize, &Agent)| {
        check_same(&format!("state.agents[{}].id", number - 1), &number, &agent.id)?;
        let &Agent { x, y, dir: direction, carrying, .. } = agent;
        Ok(Robot { x, y, direction, carrying: Some(carrying).filter(|&id| id != 0) })
    };
    let shelf = |(number, &(id, x, y)): (usize, &Shelf)| {
        check_same(&format!("state.shelves[{}][0]", number - 1), &number, &usize::from(id))?;
        Ok((x, y))
    };
    Ok(State {
        robots: (1..).zip(&start.agents).map(robot).collect::<Result<_, Damage>>()?,
        shelves: (1..).zip(&start.shelves).map(shelf).collect::<Result<_, Damage>>()?,
        request_queue: start.request_queue.clone(),
        step: start.step,
    })
}
