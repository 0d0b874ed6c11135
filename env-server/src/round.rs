//! One round: episodes in all copies, tick by tick, in lock-step with the agents.

use std::sync::mpsc::RecvTimeoutError;
use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};

use bus::{Event, Events, Publisher};
use process::{Failure, Ignored};
use proto::exit;
use proto::keys::{Key, Keys};
use proto::tick::{Mode, TickId};
use proto::{Act, Observe};

use crate::convert::{check_numbers, Copies};
use crate::record::Seconds;
use crate::seats::Seats;

/// A tick without an answer is sent again after this time: the tick or the answer may have been lost with a
/// connection.
const SEND_AGAIN: Duration = Duration::from_secs(1);

/// An agent whose connection is lost may come back within this time.
pub const GRACE: Duration = Duration::from_secs(5);

/// Why a round has not ended.
#[derive(Debug)]
pub enum Interrupted {
    /// An agent is lost or does not answer, or the bus fails.
    Failed(Failure),
    /// A second request to stop.
    Aborted,
}

impl<E: Into<Failure>> From<E> for Interrupted {
    fn from(error: E) -> Self {
        Self::Failed(error.into())
    }
}

/// The connections to the agents, and their answers.
pub struct Team<'a> {
    pub keys: Keys,
    pub seats: Seats,
    pub observe: Vec<Publisher>,
    pub events: &'a Events,
    /// Longest time without an answer of an agent before the run ends.
    pub patience: Duration,
    /// [`Event::Stop`] has arrived: stop after the present round.
    pub stop: bool,
    pub seconds: Seconds,
    pub ticks: u64,
    /// In seconds since 1970; for the report only.
    pub first_step_at: Option<f64>,
    pub ignored: Ignored,
    messages: Vec<Vec<u8>>,
    answers: Vec<Vec<u16>>,
    answered: Vec<bool>,
    /// Reason of the last rejected message, per agent.
    complaints: Vec<Option<String>>,
    observation: Observe,
    act: Act,
}

impl<'a> Team<'a> {
    /// A complete team; `observe[i]` reaches agent `i`.
    pub fn new(
        keys: Keys,
        seats: Seats,
        observe: Vec<Publisher>,
        events: &'a Events,
        patience: Duration,
    ) -> Self {
        let agents = observe.len();
        Self {
            keys,
            seats,
            observe,
            events,
            patience,
            stop: false,
            seconds: Seconds::default(),
            ticks: 0,
            first_step_at: None,
            ignored: Ignored::default(),
            messages: vec![Vec::new(); agents],
            answers: vec![Vec::new(); agents],
            answered: vec![false; agents],
            complaints: vec![None; agents],
            observation: Observe::default(),
            act: Act::default(),
        }
    }

    /// Plays `copies` to the end of all their episodes. `first` names tick 0; `t_env` are the environment
    /// steps counted before.
    ///
    /// # Errors
    /// If an agent is lost or does not answer for too long.
    pub fn play(
        &mut self,
        copies: &mut Copies,
        first: TickId,
        t_env: u64,
        seed: u64,
    ) -> Result<(), Interrupted> {
        let start = Instant::now();
        copies.reset(seed, if first.mode == Mode::Test { "test-episode" } else { "episode" }, first.round);
        self.seconds.world += start.elapsed().as_secs_f64();
        let mut id = first;
        loop {
            for agent in 0..self.observe.len() {
                let start = Instant::now();
                let observation = &mut self.observation;
                (observation.mode, observation.epoch) = (id.mode, id.epoch);
                (observation.round, observation.tick, observation.t_env) = (id.round, id.tick, t_env);
                copies.show(agent, observation);
                check_numbers(agent, observation)?;
                observation.encode(&mut self.messages[agent]);
                let encoded = Instant::now();
                self.observe[agent].send(&self.messages[agent])?;
                self.seconds.encode += (encoded - start).as_secs_f64();
                self.seconds.send += encoded.elapsed().as_secs_f64();
            }
            let start = Instant::now();
            copies.think_ahead();
            let sent = Instant::now();
            self.seconds.world += (sent - start).as_secs_f64();
            self.wait_for_answers(id, Some(copies))?;
            let waited = sent.elapsed().as_secs_f64();
            let over = copies.running() == 0;
            // After the last tick the agents learn, some before others have answered it. They answer tick 0 when they
            // are done.
            let learning = over || id.tick == 0;
            *(if learning { &mut self.seconds.updates } else { &mut self.seconds.actions }) += waited;
            self.ticks += 1;
            if over {
                return Ok(());
            }
            let start = Instant::now();
            if self.first_step_at.is_none() {
                self.first_step_at =
                    SystemTime::now().duration_since(UNIX_EPOCH).ok().map(|t| t.as_secs_f64());
            }
            copies.step(&self.answers);
            self.seconds.world += start.elapsed().as_secs_f64();
            id.tick += 1;
        }
    }

    /// Sends the closing tick and waits for every answer.
    ///
    /// # Errors
    /// If an agent is lost or does not answer for too long.
    pub fn close(&mut self, id: TickId, t_env: u64) -> Result<(), Interrupted> {
        self.seats.close();
        let message =
            Observe { mode: id.mode, epoch: id.epoch, round: id.round, t_env, ..Observe::default() };
        for (publisher, bytes) in self.observe.iter().zip(&mut self.messages) {
            message.encode(bytes);
            publisher.send(bytes)?;
        }
        self.wait_for_answers(id, None)
    }

    /// Waits until every agent has answered tick `id`. With `copies`, the answers must be actions for their running
    /// rows.
    fn wait_for_answers(&mut self, id: TickId, copies: Option<&Copies>) -> Result<(), Interrupted> {
        self.answered.fill(false);
        let mut send_again = Instant::now() + SEND_AGAIN;
        // The time without an answer is counted in repetitions, not by the clock: while this process is suspended, or
        // its host is, no agent can answer.
        let mut repetitions = 0;
        while self.answered.contains(&false) {
            // An agent that has answered may leave.
            let loss = self.seats.next_loss(GRACE, |agent| !self.answered[agent]);
            let next = loss.map_or(send_again, |(_, when)| when.min(send_again));
            // There is nothing to do before the last answer.
            let missing = self.answered.iter().filter(|&&answered| !answered).count();
            let time = next.saturating_duration_since(Instant::now());
            let event = self.events.recv_together(missing, time);
            match event.map(|event| self.seats.hear(&self.keys, event)) {
                Ok(Some(Event::Message { key, payload })) => match self.keys.parse(&key) {
                    Some(Key::Act(agent)) => self.hear(agent, &payload, id, copies),
                    _ => self.ignored.add(format_args!("nothing is expected on `{key}`")),
                },
                Ok(Some(Event::Query(query))) => {
                    self.ignored.add(format_args!("no query is expected on `{}`", query.key));
                }
                Ok(Some(Event::Stop)) if self.stop => return Err(Interrupted::Aborted),
                Ok(Some(Event::Stop)) => self.stop = true,
                Ok(_) => {}
                Err(RecvTimeoutError::Timeout) => {
                    if let Some((agent, _)) = loss.filter(|(_, when)| Instant::now() >= *when) {
                        return Err(Interrupted::Failed(self.has_left(agent, id)));
                    }
                    if Instant::now() >= send_again {
                        repetitions += 1;
                        if SEND_AGAIN * repetitions >= self.patience {
                            return Err(Interrupted::Failed(self.is_silent(id)));
                        }
                        send_again = Instant::now() + SEND_AGAIN;
                        for agent in (0..self.answered.len()).filter(|&agent| !self.answered[agent]) {
                            self.observe[agent].send(&self.messages[agent])?;
                        }
                    }
                }
                Err(RecvTimeoutError::Disconnected) => return Err(Interrupted::Aborted),
            }
        }
        Ok(())
    }

    /// Processes one answer. Old ones are repetitions and are skipped; wrong ones are counted and dropped.
    fn hear(&mut self, agent: u32, payload: &[u8], id: TickId, copies: Option<&Copies>) {
        let agent = agent as usize;
        if agent >= self.answered.len() {
            self.ignored.add(format_args!("there is no agent {agent}"));
            return;
        }
        let complaint = match self.act.decode(payload) {
            Err(error) => Some(error.to_string()),
            Ok(()) if self.act.id() != id || self.answered[agent] => {
                tracing::debug!(agent, found = %self.act.id(), "ignored an answer to another tick");
                return;
            }
            Ok(()) => {
                let (found, expected) = (self.act.actions.len(), copies.map_or(0, Copies::running));
                let unavailable = copies.and_then(|copies| copies.check(agent, &self.act.actions).err());
                match unavailable {
                    _ if found != expected => Some(format!("{found} actions for {expected} running copies")),
                    Some((copy, action)) => Some(format!("action {action} is not available in copy {copy}")),
                    None => None,
                }
            }
        };
        if let Some(complaint) = complaint {
            self.ignored.add(format_args!("agent {agent}: {complaint}"));
            self.complaints[agent] = Some(complaint);
            return;
        }
        std::mem::swap(&mut self.answers[agent], &mut self.act.actions);
        self.answered[agent] = true;
    }

    fn has_left(&self, agent: usize, id: TickId) -> Failure {
        let run = format!("agent {agent} left the run and did not come back within {GRACE:?} ({id})");
        Failure::new(
            exit::AGAIN,
            format!("{run}\nhint: all others have saved; start the same commands again"),
        )
    }

    fn is_silent(&self, id: TickId) -> Failure {
        let silent = (0..self.answered.len()).filter(|&agent| !self.answered[agent]).map(|agent| {
            let complaint =
                self.complaints[agent].as_ref().map(|text| format!(" (last ignored answer: {text})"));
            format!("agent {agent}{}", complaint.unwrap_or_default())
        });
        let silent: Vec<_> = silent.collect();
        let text = format!("no answer within {:?} to {id} from {}", self.patience, silent.join(", "));
        Failure::new(
            exit::AGAIN,
            format!("{text}\nhint: look at its log, then start the same commands again"),
        )
    }
}
