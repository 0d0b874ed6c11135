//! The whole run: seats, rounds, tests, checkpoints, close.

use std::sync::mpsc::RecvTimeoutError;
use std::time::{Duration, Instant};

use bus::Event;
use process::{Failure, Role, Scalars};
use proto::config::Config;
use proto::control::{Refusal, Seat};
use proto::exit;
use proto::tick::TickId;
use proto::Mode;
use serde::{Deserialize, Serialize};
use store::{Checkpoint, MetricsWriter, Position, RoleFolder, Row};

use crate::convert::Copies;
use crate::record::{Edge, Report, Seconds, Unlogged};
use crate::round::{Interrupted, Team, GRACE};
use crate::seats::Seats;
use crate::task::{check_transport, task};

/// How a run ended without an error.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Closed {
    /// The budget is used.
    Finished,
    /// It was stopped; it can be resumed.
    Stopped,
}

/// The content of the env-server's checkpoints. Random streams are named by round and need no state.
#[derive(Serialize, Deserialize)]
struct Saved {
    edge: Edge,
    epoch: u32,
    metrics: Position,
}

/// Runs the world until the budget is used or [`Event::Stop`] arrives. `start_over`: if no round is held by every
/// process, set the old state aside and start from the beginning.
///
/// # Errors
/// If the task is unknown or does not fit the configuration; if agents do not join or answer within `role.wait` (the
/// error names them), or leave; or on I/O errors.
pub fn run(role: Role, start_over: bool) -> Result<Closed, Failure> {
    let Role { ref bus, ref config, ref keys, ref events, ref folder, wait, .. } = role;
    let task = task(config, folder.run())?;
    check_transport(config, &task)?;
    if let Some(warning) = task.warning() {
        tracing::warn!(task = task.name(), "{warning}");
    }
    let agents = config.world.agents;

    let mut guards = Vec::new();
    for agent in 0..agents {
        guards.push(bus.subscribe(&keys.act(agent), role.inbox.clone())?);
    }
    guards.push(bus.serve(&keys.any_join(), role.inbox.clone())?);
    guards.push(bus.watch(&keys.any_alive(), role.inbox.clone())?);
    guards.push(bus.announce(&keys.alive_world())?);

    let checkpoints = folder.checkpoints();
    let mut seats = Seats::new(config, folder.held_rounds()?);
    let deadline = Instant::now() + wait;
    take_in(&mut seats, &role, deadline, Seats::not_joined)?;

    let round = match seats.common_round() {
        Ok(round) => round,
        Err(who_holds_what) if start_over => {
            tracing::warn!(who_holds_what, "starting over: no checkpoint is held by every process");
            0
        }
        Err(who_holds_what) => {
            let refusal = Refusal::no_common_round(&who_holds_what);
            seats.refuse(&refusal);
            return Err(Failure::new(exit::CONFIG, refusal));
        }
    };
    let (mut edge, mut least_epoch, mut position) = (Edge::default(), 0, Position::START);
    if round > 0 {
        let saved: Saved = serde_json::from_slice(&checkpoints.load(round)?.state).map_err(|e| {
            Failure::new(exit::CONFIG, format!("the checkpoint of round {round} cannot be used: {e}"))
        })?;
        (edge, least_epoch, position) = (saved.edge, saved.epoch + 1, saved.metrics);
        checkpoints.discard_after(round)?;
    } else {
        role.set_aside()?;
    }
    folder.keep_config(&config.to_toml())?;
    let epoch = folder.next_epoch(least_epoch)?;
    let seat = |agent: usize| Seat {
        epoch,
        round,
        t_env: edge.t_env,
        agents,
        obs_size: task.sizes().obs_size[agent] as u32,
        n_actions: task.sizes().n_actions[agent] as u32,
        copies: config.world.copies,
        test_episodes: config.test.episodes,
        episode_limit: task.sizes().episode_limit,
    };
    seats.grant((0..agents as usize).map(seat).collect());
    take_in(&mut seats, &role, deadline, Seats::absent)?;
    tracing::info!(epoch, round, "all agents joined");

    let observe = (0..agents).map(|agent| bus.publisher(&keys.observe(agent))).collect::<Result<_, _>>()?;
    let mut server = Server {
        display: Scalars::new(bus.best_effort_publisher(&keys.world_metrics())?),
        metrics: folder.metrics(position)?,
        row_missing: false,
        folder,
        config,
        epoch,
        saved: (round > 0).then_some(round),
        allocations_before: process::allocations(),
        steps_before: edge.t_env,
        edge,
        training: Copies::of(&task, config.world.copies, config.world.reward),
        testing: Copies::of(&task, config.test.episodes, config.world.reward),
        team: Team::new(keys.clone(), seats, observe, events, wait),
    };
    let closed = server.rounds();
    server.report(&role)?;
    closed
}

/// Waits until no agent is `missing`.
fn take_in(
    seats: &mut Seats,
    role: &Role,
    deadline: Instant,
    missing: fn(&Seats) -> Vec<usize>,
) -> Result<(), Failure> {
    let (keys, run) = (&role.keys, &role.config.run);
    while !missing(seats).is_empty() {
        let event = role.events.recv_timeout(deadline.saturating_duration_since(Instant::now()));
        match event.map(|event| seats.hear(keys, event)) {
            Ok(Some(Event::Query(query))) => tracing::warn!(key = %query.key, "ignored a query"),
            Ok(Some(Event::Stop)) | Err(RecvTimeoutError::Disconnected) => {
                return Err(Failure::new(
                    exit::AGAIN,
                    format!("run `{run}` was stopped before all agents had joined"),
                ));
            }
            Err(RecvTimeoutError::Timeout) => return Err(did_not_join(seats, missing, role)),
            Ok(_) => {}
        }
        // Before the first round, an agent that leaves has died.
        if let Some((id, _)) = seats.next_loss(Duration::ZERO, |_| true) {
            let text = format!("agent {id} left run `{run}` before it began\nhint: look at its log");
            return Err(Failure::new(exit::AGAIN, text));
        }
    }
    Ok(())
}

fn did_not_join(seats: &Seats, missing: fn(&Seats) -> Vec<usize>, role: &Role) -> Failure {
    let missing = missing(seats);
    let list = |ids: &[usize]| ids.iter().map(usize::to_string).collect::<Vec<_>>().join(", ");
    let named = |ids: &[usize]| format!("agent{} {}", if ids.len() == 1 { "" } else { "s" }, list(ids));
    let here: Vec<usize> = (0..seats.team_size()).filter(|id| !missing.contains(id)).collect();
    let here = if here.is_empty() { "none joined".to_owned() } else { format!("joined: {}", list(&here)) };
    let first = missing.first().copied().unwrap_or_default();
    if seats.not_joined().is_empty() {
        let text = format!(
            "{} of run `{}` joined, but did not announce {} within {:?} ({here})\n  waited for the \
             liveliness token `{}`\nhint: an agent declares it after its seat; look at its log",
            named(&missing),
            role.config.run,
            if missing.len() == 1 { "itself" } else { "themselves" },
            role.wait,
            role.keys.alive_agent(first as u32)
        );
        return Failure::new(exit::AGAIN, text);
    }
    Failure::new(
        exit::AGAIN,
        format!(
            "{} of run `{}` did not join within {:?} ({here})\n  waited on `{}`\n\
             hint: on its host run `rondo-agent --id {first} --config FILE --out DIR --connect ENDPOINT …`, \
             or give it longer with `--wait`",
            named(&missing),
            role.config.run,
            role.wait,
            role.keys.join(first as u32)
        ),
    )
}

struct Server<'a> {
    config: &'a Config,
    folder: &'a RoleFolder,
    epoch: u32,
    /// Round of the newest checkpoint.
    saved: Option<u64>,
    /// Allocations of this process before the first tick.
    allocations_before: Option<u64>,
    /// Environment steps that an earlier process counted.
    steps_before: u64,
    edge: Edge,
    training: Copies,
    testing: Copies,
    team: Team<'a>,
    metrics: MetricsWriter,
    /// A due row could not be written. The present state counts it as written, so a run resumed from here would lack
    /// it. Therefore nothing is saved after that.
    row_missing: bool,
    display: Scalars,
}

impl Server<'_> {
    /// Plays rounds until the end of the budget, a request to stop, or a failure. In every case it then saves the state
    /// after the last round, if possible, and sends the closing tick to all agents that can be reached.
    fn rounds(&mut self) -> Result<Closed, Failure> {
        let start = Instant::now();
        let played = self.play_on();
        self.team.seconds.total = start.elapsed().as_secs_f64();
        self.save()?;
        let (mode, result) = match played {
            Ok(Closed::Finished) => (Mode::Finished, Ok(Closed::Finished)),
            Ok(Closed::Stopped) => (Mode::Stopped, Ok(Closed::Stopped)),
            Err(Interrupted::Aborted) => return Ok(Closed::Stopped),
            Err(Interrupted::Failed(failure)) => (Mode::Stopped, Err(failure)),
        };
        // If an agent is already lost, the wait for the others is shorter.
        if result.is_err() {
            self.team.patience = GRACE;
        }
        let id = TickId { epoch: self.epoch, round: self.edge.round, mode, tick: 0 };
        match self.team.close(id, self.edge.t_env) {
            Err(Interrupted::Failed(failure)) if result.is_ok() => Err(failure),
            _ => result,
        }
    }

    fn play_on(&mut self) -> Result<Closed, Interrupted> {
        self.display.show(true, || self.edge.metrics());
        // A run may have been interrupted between a round and its test.
        while self.edge.t_env < self.config.t_max {
            if self.team.stop {
                return Ok(Closed::Stopped);
            }
            if self.edge.round > 0 && self.edge.test_is_due(self.config.test.interval) {
                self.test()?;
            }
            self.train()?;
        }
        // The end of the budget is always tested.
        if self.edge.last_test != Some(self.edge.t_env) && !self.team.stop {
            self.test()?;
        }
        Ok(if self.team.stop { Closed::Stopped } else { Closed::Finished })
    }

    fn train(&mut self) -> Result<(), Interrupted> {
        let id = TickId { epoch: self.epoch, round: self.edge.round, mode: Mode::Train, tick: 0 };
        self.team.play(&mut self.training, id, self.edge.t_env, self.config.seed)?;
        let before = self.edge.unlogged.steps();
        self.edge.unlogged.add(self.training.played(), self.config.world.reward);
        self.edge.t_env += self.edge.unlogged.steps() - before;
        self.edge.round += 1;
        if let Some(row) = self.edge.training_row(self.config.log.interval) {
            self.write(&row)?;
        }
        if self.edge.round.is_multiple_of(self.config.save.interval) {
            self.save()?;
        }
        self.display.show(false, || self.edge.metrics());
        Ok(())
    }

    fn test(&mut self) -> Result<(), Interrupted> {
        let before = self.team.seconds;
        let start = Instant::now();
        let id = TickId { epoch: self.epoch, round: self.edge.round, mode: Mode::Test, tick: 0 };
        self.team.play(&mut self.testing, id, self.edge.t_env, self.config.seed)?;
        // The wait at its tick 0 is for the update calls; the rest is the test's.
        let updates = self.team.seconds.updates;
        self.team.seconds = Seconds { updates, ..before };
        self.team.seconds.tests += start.elapsed().as_secs_f64() - (updates - before.updates);
        let mut test = Unlogged::default();
        test.add(self.testing.played(), self.config.world.reward);
        let row = self.edge.test_row(&test);
        self.write(&row)?;
        self.display.show(true, || self.edge.metrics());
        Ok(())
    }

    fn write(&mut self, row: &Row) -> Result<(), Failure> {
        let start = Instant::now();
        self.row_missing = true;
        self.metrics.append(row)?;
        self.row_missing = false;
        self.team.seconds.disk += start.elapsed().as_secs_f64();
        Ok(())
    }

    /// Saves the state between rounds, unless it is already saved. The state is the same before and after a test: a run
    /// resumed from it plays a due test first.
    fn save(&mut self) -> Result<(), Failure> {
        if self.saved == Some(self.edge.round) || self.edge.round == 0 || self.row_missing {
            return Ok(());
        }
        let start = Instant::now();
        let saved = Saved { edge: self.edge.clone(), epoch: self.epoch, metrics: self.metrics.sync()? };
        let state = serde_json::to_vec(&saved).expect("numbers and strings always serialise");
        self.folder.checkpoints().save(&Checkpoint { round: self.edge.round, state, tensors: vec![] })?;
        self.saved = Some(self.edge.round);
        self.team.seconds.disk += start.elapsed().as_secs_f64();
        Ok(())
    }

    fn report(&self, role: &Role) -> Result<(), Failure> {
        role.folder.write_result(&Report {
            role: "world",
            t_env: self.edge.t_env,
            rounds: self.edge.round,
            steps_played: self.edge.t_env - self.steps_before,
            ticks: self.team.ticks,
            test_return_mean: self.edge.test_return_mean,
            best_test_return_mean: self.edge.best_test_return_mean,
            test_facts: self.edge.test_facts.clone(),
            seconds: self.team.seconds,
            ignored_messages: self.team.ignored.count(),
            peak_memory_bytes: process::peak_memory_bytes(),
            cpu_seconds: process::cpu_seconds(),
            allocations: process::allocations()
                .zip(self.allocations_before)
                .map(|(now, before)| now - before),
            first_step_at: self.team.first_step_at,
            traffic: role.traffic(),
        })?;
        Ok(())
    }
}
