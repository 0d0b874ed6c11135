//! The agent's main loop, from its seat to its last checkpoint.

use std::collections::hash_map::RandomState;
use std::hash::BuildHasher;
use std::sync::mpsc::RecvTimeoutError;
use std::time::{Duration, Instant, SystemTime};

use algos::device::{Device, DeviceName};
use bus::{Event, Publisher};
use process::{Failure, Ignored, Role, Scalars};
use proto::codec::{decode, encode};
use proto::control::{Join, Progress, Rates, RatesQuery, Seat};
use proto::exit;
use proto::keys::Key;
use proto::stream::stream;
use proto::tick::{Mode, TickId};
use proto::{Act, Observe};
use rand_chacha::ChaCha8Rng;
use serde::Serialize;
use store::{MetricsWriter, Position};

use crate::host::host;
use crate::join::take_seat;
use crate::learner::{owner, Learner};
use crate::progress::{metrics, timed, Seconds, Unlogged};
use crate::timetable::Timetable;
use crate::Machine;

/// A lost env-server may come back, for example after a short network failure. The agent gives up after this time.
const GRACE: Duration = Duration::from_secs(5);

/// Timeout of a query to the coordinator; it is repeated after that.
const ASK_AGAIN: Duration = Duration::from_secs(2);

/// Why an agent left without an error.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Left {
    /// The run has used its budget.
    Finished,
    /// The run or this agent was stopped; it can be resumed.
    Stopped,
}

/// The content of the role's result.json.
#[derive(Serialize)]
struct Report {
    role: &'static str,
    device: String,
    update_calls: u64,
    seconds: Seconds,
    /// Of them, the learner's own, by kernel.
    learner_seconds: algos::host::Seconds,
    ignored_messages: u64,
    peak_memory_bytes: Option<u64>,
    cpu_seconds: Option<f64>,
    /// In all threads of the process since the first tick; only in builds that count allocations.
    allocations: Option<u64>,
    traffic: Vec<(String, u64, u64)>,
}

/// Runs one agent until the run ends.
///
/// # Errors
/// If the device cannot be used or fails; if it gets no seat, no tick or no learning rate within `role.wait`; if it
/// loses the env-server; or on I/O errors.
pub fn run(role: Role, id: u32, machine: Machine) -> Result<Left, Failure> {
    // Before other processes wait for this agent.
    let opened = machine.device.open().map_err(|error| Failure::new(exit::CONFIG, error))?;
    let join =
        Join { config_digest: role.config.digest(), nonce: nonce(), checkpoints: role.folder.held_rounds()? };
    let seat = take_seat(&role, id, &join)?;
    tracing::info!(agent = id, epoch = seat.epoch, round = seat.round, device = %machine.device, "has a seat");

    if seat.round == 0 {
        role.set_aside()?;
    }
    role.folder.keep_config(&role.config.to_toml())?;
    let mut agent = Agent::start(&role, id, seat, machine, opened)?;
    // The token comes last: a process that sees it can rely on the subscriptions.
    let _schedule = role.bus.subscribe(&role.keys.schedule(), role.inbox.clone())?;
    let _observe = role.bus.subscribe(&role.keys.observe(id), role.inbox.clone())?;
    let _world = role.bus.watch(&role.keys.alive_world(), role.inbox.clone())?;
    let _token = role.bus.announce(&role.keys.alive_agent(id))?;
    agent.live()
}

/// A random number of this process: the hasher's keys are drawn anew in every process.
fn nonce() -> u64 {
    RandomState::new().hash_one((std::process::id(), SystemTime::now()))
}

struct Agent<'a> {
    role: &'a Role,
    id: u32,
    device: DeviceName,
    seat: Seat,
    learner: Learner,
    timetable: Timetable,
    metrics: MetricsWriter,
    unlogged: Unlogged,
    /// Round of the newest checkpoint.
    saved: Option<u64>,
    act: Publisher,
    progress: Publisher,
    display: Scalars,
    seconds: Seconds,
    ignored: Ignored,
    round: Round,
}

/// The agent's place in a round, and its last answer.
struct Round {
    observe: Observe,
    reply: Act,
    reply_bytes: Vec<u8>,
    /// The tick that `reply_bytes` answers.
    answered: Option<TickId>,
    rng: Option<ChaCha8Rng>,
}

/// Publishes the number of completed update calls, and whether the run is finished.
fn report(publisher: &mut Publisher, update_calls: u64, finished: bool) -> Result<(), Failure> {
    let encoded =
        encode(&Progress { update_calls, finished }).map_err(|error| Failure::new(exit::BUG, error))?;
    Ok(publisher.send(&encoded)?)
}

impl<'a> Agent<'a> {
    fn start(
        role: &'a Role,
        id: u32,
        seat: Seat,
        Machine { device, threads }: Machine,
        opened: Device,
    ) -> Result<Self, Failure> {
        let Role { bus, keys, config, folder, .. } = role;
        let (mut learner, saved) = Learner::start(config, id, &seat, folder)?;
        learner.compute_on(device, opened);
        // A GPU runs one pass after another anyway.
        learner.run_on(host(if device == DeviceName::Cpu { threads } else { 1 }));
        if let Some(before) = saved.as_ref().map(|saved| &saved.device).filter(|kind| *kind != device.kind())
        {
            tracing::warn!(
                agent = id,
                round = seat.round,
                before,
                now = device.kind(),
                "resumed on another kind of device; the last bits will differ from those of the device before"
            );
        }
        let (unlogged, position) = match saved {
            Some(saved) => (saved.unlogged, saved.metrics),
            None => (Unlogged::default(), Position::START),
        };
        folder.checkpoints().discard_after(seat.round)?;
        Ok(Self {
            act: bus.publisher(&keys.act(id))?,
            progress: bus.publisher(&keys.progress(id))?,
            display: Scalars::new(bus.best_effort_publisher(&keys.agent_metrics(id))?),
            metrics: folder.metrics(position)?,
            saved: (seat.round > 0).then_some(seat.round),
            role,
            id,
            device,
            seat,
            learner,
            timetable: Timetable::default(),
            unlogged,
            seconds: Seconds::default(),
            ignored: Ignored::default(),
            round: Round {
                observe: Observe::default(),
                reply: Act::default(),
                reply_bytes: Vec::new(),
                answered: None,
                rng: None,
            },
        })
    }

    fn live(&mut self) -> Result<Left, Failure> {
        let mut started: Option<(Instant, Option<u64>)> = None;
        let mut deadline = Instant::now() + self.role.wait;
        let (mut world_gone, mut last_chance) = (false, false);
        let left = loop {
            match self.role.events.recv_timeout(deadline.saturating_duration_since(Instant::now())) {
                Ok(Event::Message { key, payload }) => match self.role.keys.parse(&key) {
                    Some(Key::Schedule) => self.hear_rates(&payload),
                    Some(Key::Observe(_)) => {
                        let (started, _) =
                            started.get_or_insert_with(|| (Instant::now(), process::allocations()));
                        deadline = Instant::now() + self.role.wait;
                        (world_gone, last_chance) = (false, false);
                        if let Some(left) = self.hear_tick(&payload)? {
                            self.seconds.total = started.elapsed().as_secs_f64();
                            break left;
                        }
                    }
                    _ => self.ignored.add("a message on a key that agents do not use"),
                },
                Ok(Event::Gone { .. }) => {
                    (deadline, world_gone) = (Instant::now() + GRACE, true);
                }
                // The same env-server repeats its tick soon. A new one does not know this agent, which then has to
                // start again too.
                Ok(Event::Alive { .. }) if world_gone => deadline = Instant::now() + 2 * GRACE,
                Ok(Event::Alive { .. }) => deadline = Instant::now() + self.role.wait,
                Ok(Event::Query(_)) => self.ignored.add("a query"),
                Ok(Event::Stop) | Err(RecvTimeoutError::Disconnected) => break Left::Stopped,
                // Perhaps this process was suspended: the env-server repeats its tick every second.
                Err(RecvTimeoutError::Timeout) if !world_gone && !last_chance => {
                    (deadline, last_chance) = (Instant::now() + GRACE, true);
                }
                Err(RecvTimeoutError::Timeout) => {
                    self.save()?;
                    return Err(self.abandoned(world_gone));
                }
            }
        };
        self.save()?;
        if left == Left::Finished {
            report(&mut self.progress, self.learner.update_calls(), true)?;
        }
        self.role.folder.write_result(&Report {
            role: "agent",
            device: self.device.to_string(),
            update_calls: self.learner.update_calls(),
            seconds: self.seconds,
            learner_seconds: self.learner.seconds(),
            ignored_messages: self.ignored.count(),
            peak_memory_bytes: process::peak_memory_bytes(),
            cpu_seconds: process::cpu_seconds(),
            allocations: process::allocations()
                .zip(started.and_then(|(_, allocations)| allocations))
                .map(|(now, before)| now - before),
            traffic: self.role.traffic(),
        })?;
        Ok(left)
    }

    fn hear_rates(&mut self, payload: &[u8]) {
        match decode::<Rates>(payload) {
            Ok(rates) => self.timetable.learn(rates),
            Err(error) => self.ignored.add(error),
        }
    }

    /// Answers a tick. Returns the reason to leave if the tick closes the run.
    fn hear_tick(&mut self, payload: &[u8]) -> Result<Option<Left>, Failure> {
        let mut observe = std::mem::take(&mut self.round.observe);
        let decoded = timed(&mut self.seconds.encode, || observe.decode(payload));
        let result = match decoded {
            Ok(()) => self.take_tick(&observe),
            Err(error) => {
                self.ignored.add(error);
                Ok(None)
            }
        };
        self.round.observe = observe;
        result
    }

    fn take_tick(&mut self, observe: &Observe) -> Result<Option<Left>, Failure> {
        let id = observe.id();
        if self.round.answered == Some(id) {
            // The env-server has not received the answer: send it again.
            self.send_reply()?;
            return Ok(None);
        }
        if id.mode.closes_the_run() && id.epoch == self.seat.epoch {
            self.reply(id, |_, _| ())?;
            return Ok(Some(if id.mode == Mode::Finished { Left::Finished } else { Left::Stopped }));
        }
        if !self.is_next(&id) || !self.fits(observe) {
            self.ignored.add(format_args!("{id} is not the next tick, or has other sizes than agreed"));
            return Ok(None);
        }

        let learning = id.mode == Mode::Train;
        if id.tick == 0 {
            self.learner.begin_round(observe.rows(), learning);
            let purpose = if learning { "actions" } else { "test-actions" };
            self.round.rng = Some(stream(self.role.config.seed, &owner(self.id), purpose, &[id.round]));
        }
        let over = observe.running().next().is_none();
        self.reply(id, |agent, actions| {
            let rng = agent.round.rng.as_mut().expect("the round has begun");
            let chosen = timed(&mut agent.seconds.inference, || agent.learner.tick(observe, learning, rng));
            actions.extend_from_slice(chosen);
        })?;
        // A failure of the device must surface before the round counts.
        self.learner.check_device()?;
        if over && learning {
            self.learn(observe.t_env)?;
        }
        Ok(None)
    }

    /// Whether a tick follows the last answer: the next in its round, or the start of one.
    fn is_next(&self, id: &TickId) -> bool {
        let round_is_ours = id.epoch == self.seat.epoch && id.round == self.learner.rounds();
        round_is_ours
            && match self.round.answered {
                _ if id.tick == 0 => true,
                Some(last) => *id == TickId { tick: last.tick.wrapping_add(1), ..last },
                None => false,
            }
    }

    /// Whether a tick has the sizes of this agent's seat.
    fn fits(&self, observe: &Observe) -> bool {
        let copies = if observe.mode == Mode::Test { self.seat.test_episodes } else { self.seat.copies };
        let sizes = (self.seat.obs_size as usize, self.seat.n_actions as usize);
        (observe.obs_size, observe.n_actions) == sizes
            && observe.copies.iter().all(|&copy| u32::from(copy) < copies)
            && (observe.tick > 0 || observe.rows() == copies as usize)
    }

    /// Makes an answer to `id` and sends it.
    fn reply(&mut self, id: TickId, fill: impl FnOnce(&mut Self, &mut Vec<u16>)) -> Result<(), Failure> {
        let mut reply = std::mem::take(&mut self.round.reply);
        (reply.mode, reply.epoch, reply.round, reply.tick) = (id.mode, id.epoch, id.round, id.tick);
        reply.actions.clear();
        fill(self, &mut reply.actions);
        timed(&mut self.seconds.encode, || reply.encode(&mut self.round.reply_bytes));
        self.round.reply = reply;
        self.round.answered = Some(id);
        self.send_reply()
    }

    fn send_reply(&mut self) -> Result<(), Failure> {
        Ok(timed(&mut self.seconds.send, || self.act.send(&self.round.reply_bytes))?)
    }

    /// The update calls at the end of a round.
    fn learn(&mut self, t_env_before: u64) -> Result<(), Failure> {
        let first = self.learner.update_calls();
        for update_call in first..first + self.learner.updates_due() {
            if let Err(failure) = self.rates(update_call) {
                // Nothing has been learned from this round, so the state is that after the round before.
                self.save()?;
                return Err(failure);
            }
        }
        let t_env = t_env_before + self.learner.steps();
        for lesson in 0..self.learner.lessons() {
            self.lesson(lesson, t_env_before, t_env)?;
        }
        self.learner.end_round();
        self.timetable.forget_before(self.learner.update_calls());
        if self.learner.rounds().is_multiple_of(self.role.config.save.interval) {
            self.save()?;
        }
        Ok(())
    }

    fn lesson(&mut self, lesson: usize, t_env_before: u64, t_env: u64) -> Result<(), Failure> {
        // `None` in a lesson without an update call.
        let rates = self.timetable.covering(self.learner.update_calls());
        let lr = rates.map_or(Some(0.0), |rates| rates.rate_of(self.id)).ok_or_else(|| {
            let text = format!("the schedule has no agent with id {}", self.id);
            Failure::new(exit::CONFIG, text)
        })?;
        let learned = timed(&mut self.seconds.update, || self.learner.learn(lesson, t_env_before, lr))?;
        let (Some(scalars), Some(rates)) = (learned, rates) else { return Ok(()) };
        let update_calls = self.learner.update_calls();
        report(&mut self.progress, update_calls, false)?;
        self.display.show(false, || metrics(&scalars, rates, t_env, update_calls));
        if let Some(row) = self.unlogged.add(&scalars, t_env, update_calls, self.role.config.log.interval) {
            let mut disk = 0.0;
            timed(&mut disk, || self.metrics.append(&row))?;
            self.seconds.disk += disk;
        }
        Ok(())
    }

    /// The rates of an update call. Waits for the schedule: no update call is made without one.
    fn rates(&mut self, update_call: u64) -> Result<Rates, Failure> {
        // The schedule may be among the events that have arrived. Other events are dropped here: the env-server repeats
        // a tick, and the loss of its token is noticed by its silence.
        let deadline = Instant::now() + self.role.wait;
        let question = encode(&RatesQuery { update_call }).map_err(|error| Failure::new(exit::BUG, error))?;
        loop {
            if let Some(rates) = self.timetable.covering(update_call) {
                return Ok(rates.clone());
            }
            if let Some(reply) = self.role.bus.ask(&self.role.keys.schedule(), &question, ASK_AGAIN)? {
                self.hear_rates(&reply);
                continue;
            }
            if Instant::now() >= deadline {
                return Err(Failure::new(
                    exit::AGAIN,
                    format!(
                        "no schedule covers update call {update_call}: the coordinator did not answer on `{}` within \
                         {:?}\nhint: is it running, and its endpoint among the `--connect`?",
                        self.role.keys.schedule(),
                        self.role.wait
                    ),
                ));
            }
            match self.role.events.recv_timeout(Duration::from_millis(50)) {
                Ok(Event::Stop) | Err(RecvTimeoutError::Disconnected) => {
                    let text = format!("agent {} was stopped while it waited for a schedule", self.id);
                    return Err(Failure::new(exit::AGAIN, text));
                }
                Ok(Event::Message { key, payload }) if self.role.keys.parse(&key) == Some(Key::Schedule) => {
                    self.hear_rates(&payload);
                }
                _ => {}
            }
        }
    }

    /// Saves the state after the last complete round, unless it is already saved.
    fn save(&mut self) -> Result<(), Failure> {
        let round = self.learner.rounds();
        if self.saved == Some(round) || round == 0 {
            return Ok(());
        }
        let start = Instant::now();
        let position = self.metrics.sync()?;
        self.role.folder.checkpoints().save(&self.learner.checkpoint(&self.unlogged, position)?)?;
        self.learner.saved()?;
        self.seconds.disk += start.elapsed().as_secs_f64();
        self.saved = Some(round);
        Ok(())
    }

    fn abandoned(&self, world_gone: bool) -> Failure {
        let round = self.learner.rounds();
        let saved = if round > 0 { "its checkpoint is saved" } else { "there is nothing to save yet" };
        let what = if world_gone {
            format!("it left run `{}` in round {round}", self.role.config.run)
        } else {
            format!("no message for {:?} in round {round}", self.role.wait)
        };
        let hint = "start the env-server again, then this agent with the same arguments";
        Failure::new(
            exit::AGAIN,
            format!("agent {} lost the env-server: {what}; {saved}\nhint: {hint}", self.id),
        )
    }
}
