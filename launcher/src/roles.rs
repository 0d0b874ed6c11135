//! Messages between a run's roles and the launcher, for processes and threads.

use std::sync::mpsc::Sender;

use bus::{Bus, Event};
use process::{Failure, StopRequest};
use proto::codec::decode;
use proto::config::Config;
use proto::control::Metrics;
use proto::exit;
use proto::keys::{Key, Keys};

/// How processes on one machine reach each other.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
pub enum Transport {
    /// Unix sockets in the run folder, or in one for temporary files
    Unix,
    /// TCP on 127.0.0.1
    Tcp,
}

/// How a run ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Ended {
    /// The budget is used.
    Finished,
    /// Stopped by a signal; it can be resumed.
    Stopped,
}

/// What the driver receives while roles run.
pub enum News {
    /// Scalars for the display; `agent` is `None` for the env-server.
    Scalars { agent: Option<u32>, metrics: Metrics },
    /// A role has printed a line, such as a warning.
    Said { role: String, line: String },
    /// A role has ended, with its exit code and message if it failed.
    Ended { role: String, result: Result<Ended, Failure> },
    /// A signal has asked this process to end.
    StopRequest(StopRequest),
}

/// The roles of a run.
pub trait Roles {
    /// Requests the run to stop after the present round.
    fn stop(&mut self);
    /// Ends all remaining roles now.
    fn abandon(&mut self);
}

/// Passes on the scalars that roles publish, while `bus` exists.
///
/// # Errors
/// If the bus refuses the subscriptions.
pub fn listen(bus: &dyn Bus, config: &Config, news: Sender<News>) -> Result<(), Failure> {
    let keys = Keys::new(&config.run).map_err(|error| Failure::new(exit::CONFIG, error))?;
    let (inbox, events) = bus::inbox();
    let guards = [
        bus.subscribe(&keys.any_agent_metrics(), inbox.clone())?,
        bus.subscribe(&keys.world_metrics(), inbox)?,
    ];
    std::thread::spawn(move || {
        let _kept = guards;
        while let Ok(event) = events.recv() {
            let Event::Message { key, payload } = event else { continue };
            let agent = match keys.parse(&key) {
                Some(Key::AgentMetrics(agent)) => Some(agent),
                _ => None,
            };
            // Other messages are not shown; nothing depends on them.
            let Ok(metrics) = decode::<Metrics>(&payload) else { continue };
            if news.send(News::Scalars { agent, metrics }).is_err() {
                break;
            }
        }
    });
    Ok(())
}
