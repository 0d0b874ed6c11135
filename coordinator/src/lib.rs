//! Role: publishes which agent has which learning rate, and nothing else.
//!
//! It publishes the schedule ahead of the agents and answers queries for it. It has no state: a coordinator that is
//! started again publishes the same schedule. It receives no observation, no action and no weight.

pub mod schedule;

use std::process::ExitCode;
use std::sync::mpsc::RecvTimeoutError;
use std::time::{Duration, Instant};

use bus::Event;
use process::{Failure, Ignored, Role};
use proto::codec::{decode, encode, WireError};
use proto::config::Config;
use proto::control::{Progress, Rates, RatesQuery};
use proto::exit;
use proto::keys::Key;

/// The schedule is published this many update calls ahead of the foremost agent, so that no agent waits for it.
const AHEAD: u64 = 64;

/// Arguments of the role's process.
#[derive(Debug, Clone, clap::Args)]
pub struct Arguments {
    #[command(flatten)]
    pub common: process::Common,
    /// Endpoint to listen on, for example `tcp/192.0.2.7:7448`
    #[arg(long, value_name = "ENDPOINT", required = true)]
    pub listen: Vec<String>,
}

/// The whole process: opens configuration, folder and bus, and runs until the agents have left.
pub fn main(arguments: &Arguments) -> ExitCode {
    let attempt = || run(arguments.common.open("coordinator", arguments.listen.clone(), vec![])?);
    match attempt() {
        Ok(Left::Finished) => ExitCode::from(exit::DONE),
        Ok(Left::Stopped) => ExitCode::from(exit::AGAIN),
        Err(failure) => process::report(&failure),
    }
}

/// Why the coordinator left without an error.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Left {
    /// All agents have left a finished run.
    Finished,
    /// It was stopped, or agents have left a run that is not finished; start it again.
    Stopped,
}

/// The content of the role's result.json.
#[derive(serde::Serialize)]
struct Report {
    role: &'static str,
    traffic: Vec<(String, u64, u64)>,
}

/// How long the last reports of agents may come after their tokens are gone.
const GRACE: Duration = Duration::from_secs(1);

/// Publishes the learning rates of a run until all agents have joined and left, or until [`Event::Stop`].
///
/// # Errors
/// If agents do not join within `role.wait` (the error names them), or the bus or the disk fails.
pub fn run(role: Role) -> Result<Left, Failure> {
    let Role { ref bus, ref config, ref keys, ref events, wait, .. } = role;
    let publisher = bus.publisher(&keys.schedule())?;
    let _served = bus.serve(&keys.schedule(), role.inbox.clone())?;
    let _progress = bus.subscribe(&keys.any_progress(), role.inbox.clone())?;
    let _agents = bus.watch(&keys.any_alive(), role.inbox.clone())?;
    let _token = bus.announce(&keys.alive_coordinator())?;

    let mut team = Team::new(config.world.agents);
    let mut ignored = Ignored::default();
    // Highest update call reached, and the first that is not yet published.
    let (mut foremost, mut published) = (0, 0);
    let deadline = Instant::now() + wait;
    let mut left = Left::Finished;
    // Set while all agents are gone and not all of them have reported a finished run.
    let mut gone: Option<Instant> = None;
    loop {
        gone = team.has_left().then(|| gone.unwrap_or_else(|| Instant::now() + GRACE));
        if gone.is_some() && team.has_finished() {
            break;
        }
        let event = match gone.or((!team.missing().is_empty()).then_some(deadline)) {
            Some(until) => events.recv_timeout(until.saturating_duration_since(Instant::now())),
            None => events.recv().map_err(|_| RecvTimeoutError::Disconnected),
        };
        let reached = match event {
            Ok(Event::Message { key, payload }) => match (keys.parse(&key), decode::<Progress>(&payload)) {
                (Some(Key::Progress(agent)), Ok(progress)) => {
                    team.reports(agent, progress.finished);
                    Some(progress.update_calls)
                }
                (_, Ok(_)) => {
                    ignored.add(format_args!("progress on `{key}`, which is no agent's key for it"));
                    None
                }
                (_, Err(error)) => {
                    ignored.add(format_args!("no progress on `{key}`: {error}"));
                    None
                }
            },
            Ok(Event::Query(query)) => match decode::<RatesQuery>(&query.payload) {
                Ok(asked) => match message(config, asked.update_call) {
                    Ok((_, bytes)) => {
                        query.reply(&bytes);
                        Some(asked.update_call)
                    }
                    // The largest number has no schedule; no run reaches it.
                    Err(error) => {
                        ignored.add(format_args!("a query for a schedule that does not exist: {error}"));
                        None
                    }
                },
                Err(error) => {
                    ignored.add(format_args!("a query on `{}`: {error}", query.key));
                    None
                }
            },
            Ok(Event::Alive { key }) => keys.parse(&key).filter(|key| team.came(key)).map(|_| {
                // Publish again: a new agent missed the earlier messages.
                published = foremost;
                foremost
            }),
            Ok(Event::Gone { key }) => {
                if let Some(key) = keys.parse(&key) {
                    team.went(&key);
                }
                None
            }
            Ok(Event::Stop) => {
                left = Left::Stopped;
                break;
            }
            Err(RecvTimeoutError::Timeout) if gone.is_some() => {
                tracing::info!("all agents have left, and the run is not finished");
                left = Left::Stopped;
                break;
            }
            Err(RecvTimeoutError::Timeout) => return Err(team.did_not_come(wait, &config.run)),
            Err(RecvTimeoutError::Disconnected) => break,
        };
        if let Some(reached) = reached {
            // A peer may claim any progress; each claim leads to at most a few messages.
            foremost = foremost.max(reached);
            let until = foremost.saturating_add(AHEAD);
            published = published.max(foremost);
            while published < until && published != Rates::FOR_EVER {
                let (next, message) =
                    message(config, published).map_err(|error| Failure::new(exit::BUG, error))?;
                publisher.send(&message)?;
                published = next;
            }
        }
    }
    role.folder.write_result(&Report { role: "coordinator", traffic: role.traffic() })?;
    Ok(left)
}

/// The encoded schedule of an update call, and the first call that it does not cover.
fn message(config: &Config, update_call: u64) -> Result<(u64, Vec<u8>), WireError> {
    let rates = schedule::rates(config, update_call);
    Ok((rates.until, encode(&rates)?))
}

/// The agents that have joined, those that are present, and those that have reported a finished run.
struct Team {
    came: Vec<bool>,
    present: Vec<bool>,
    finished: Vec<bool>,
}

impl Team {
    fn new(agents: u32) -> Self {
        let none = vec![false; agents as usize];
        Self { came: none.clone(), present: none.clone(), finished: none }
    }

    fn seat(&self, key: &Key) -> Option<usize> {
        match key {
            Key::AliveAgent(agent) => Some(*agent as usize).filter(|agent| *agent < self.came.len()),
            _ => None,
        }
    }

    /// Whether the token is that of an agent of this team; if so, it is present.
    fn came(&mut self, key: &Key) -> bool {
        let seat = self.seat(key);
        if let Some(seat) = seat {
            (self.came[seat], self.present[seat]) = (true, true);
        }
        seat.is_some()
    }

    fn went(&mut self, key: &Key) {
        if let Some(seat) = self.seat(key) {
            self.present[seat] = false;
        }
    }

    fn reports(&mut self, agent: u32, finished: bool) {
        if let Some(of_agent) = self.finished.get_mut(agent as usize) {
            *of_agent = finished;
        }
    }

    fn has_finished(&self) -> bool {
        !self.finished.contains(&false)
    }

    fn missing(&self) -> Vec<usize> {
        (0..self.came.len()).filter(|&agent| !self.came[agent]).collect()
    }

    fn has_left(&self) -> bool {
        self.missing().is_empty() && !self.present.contains(&true)
    }

    fn did_not_come(&self, wait: Duration, run: &str) -> Failure {
        let missing: Vec<_> = self.missing().iter().map(usize::to_string).collect();
        Failure::new(
            exit::AGAIN,
            format!(
                "agent{} {} of run `{run}` did not join within {wait:?}\nhint: start them with the coordinator's \
                 endpoint among their `--connect`, or give them longer with `--wait`",
                if missing.len() == 1 { "" } else { "s" },
                missing.join(", ")
            ),
        )
    }
}
