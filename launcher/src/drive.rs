//! One run from its start to its summary, in several processes or in one.

use std::path::Path;
use std::sync::mpsc::{channel, Receiver, RecvTimeoutError};
use std::thread::available_parallelism;
use std::time::{Duration, Instant, SystemTime};

use agent::Machine;
use algos::device::DeviceName;
use process::{Failure, StopRequest};
use proto::config::Config;
use proto::exit;
use store::RunFolder;

use crate::child_processes::ChildProcesses;
use crate::display::{Display, Show};
use crate::in_process::InProcess;
use crate::one_at_a_time;
use crate::roles::{Ended, News, Roles, Transport};
use crate::summary::{self, Summary};

/// How the roles run.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Place {
    /// Each in a process of its own, on this kind of link; none: whatever works here.
    Processes(Option<Transport>),
    /// All as threads of this process, on a bus in memory.
    InProcess,
}

/// Options of a run.
#[derive(Debug, Clone, Copy)]
pub struct Options {
    pub place: Place,
    /// The agents' device.
    pub device: DeviceName,
    /// How long roles wait for each other.
    pub wait: Duration,
    pub show: Show,
    /// Start from the beginning if no round is held by every role; the old state is set aside.
    pub start_over: bool,
    /// A sweep started this run and holds the other end of stdin.
    pub with_launcher: bool,
    /// Number of teams that train on this machine at the same time, with this one.
    pub teams: u32,
}

/// After the failure of one role, the others get this long to save and leave.
const AFTER_FAILURE: Duration = Duration::from_millis(1500);

/// Runs or resumes the run in `folder`.
///
/// # Errors
/// The first failure of a role.
pub fn drive(folder: &RunFolder, config: &Config, options: Options) -> Result<(Ended, Summary), Failure> {
    let _held = one_at_a_time::hold(folder.path())?;
    let (sender, news) = channel();
    let requests = sender.clone();
    // The receiver is gone only if the run has ended.
    process::on_stop_request(move |request| drop(requests.send(News::StopRequest(request))))?;
    if options.with_launcher {
        let requests = sender.clone();
        process::when_stdin_closes(move || {
            drop(requests.send(News::StopRequest(StopRequest::AfterThisRound)))
        });
    }
    let start = SystemTime::now();
    let mut display = Display::new(config, options.show);
    let processors = available_parallelism().map_or(1, usize::from);
    let agents = options.teams.saturating_mul(config.world.agents) as usize;
    let machine = Machine { device: options.device, threads: threads_to_learn(agents, processors) };
    let mut roles: Box<dyn Roles> = match options.place {
        Place::InProcess => Box::new(InProcess::start(folder, config, &options, machine, &sender)?),
        Place::Processes(transport) => {
            Box::new(ChildProcesses::start(folder, config, &options, machine, transport, &sender)?)
        }
    };
    let count = config.world.agents as usize + 2;
    let outcome = follow(&mut *roles, &news, &mut display, count, folder.path());
    roles.abandon();
    display.finish();
    drop(roles);
    let ended = outcome?;
    let summary = summary::collect(folder, config, start)?;
    folder.write_result(&summary)?;
    Ok((ended, summary))
}

/// Threads for the update calls of each of `agents` agents, 1 or 2, so that the last agent is done soonest. Actor and
/// critic learn in parallel only if processors would be idle otherwise.
fn threads_to_learn(agents: usize, processors: usize) -> usize {
    let (halves_in_turn, wholes_in_turn) = ((2 * agents).div_ceil(processors), agents.div_ceil(processors));
    if halves_in_turn < 2 * wholes_in_turn {
        2
    } else {
        1
    }
}

/// Receives news until all roles have ended.
fn follow(
    roles: &mut dyn Roles,
    news: &Receiver<News>,
    display: &mut Display,
    count: usize,
    path: &Path,
) -> Result<Ended, Failure> {
    let (mut left, mut ended) = (count, Ended::Finished);
    let mut failed: Option<(Failure, Instant)> = None;
    while left > 0 {
        let wait = match &failed {
            Some((_, deadline)) => deadline.saturating_duration_since(Instant::now()),
            None => Duration::from_secs(1),
        };
        match news.recv_timeout(wait) {
            Ok(News::Scalars { agent, metrics }) => display.hear(agent, &metrics),
            Ok(News::Said { role, line }) => display.say(&format!("{role}: {line}")),
            Ok(News::Ended { role, result }) => {
                left -= 1;
                match result {
                    Ok(how) if role == "world" => ended = how,
                    Ok(_) => {}
                    Err(failure) if failed.is_none() => {
                        let hint = if failure.code == exit::AGAIN {
                            format!("\nhint: continue with `rondo resume {}`", path.display())
                        } else {
                            String::new()
                        };
                        let failure = Failure::new(failure.code, format!("{role}: {failure}{hint}"));
                        failed = Some((failure, Instant::now() + AFTER_FAILURE));
                        // The first request waits for the end of the round, which may never come; the second does not
                        // wait.
                        roles.stop();
                        roles.stop();
                    }
                    Err(_) => {}
                }
            }
            Ok(News::StopRequest(request)) => match request {
                StopRequest::AfterThisRound => {
                    display.say("stopping after this round; press Ctrl-C again to stop now");
                    roles.stop();
                }
                StopRequest::Now => {
                    roles.stop();
                    roles.stop();
                }
                StopRequest::Abort => roles.abandon(),
            },
            Err(RecvTimeoutError::Timeout) if failed.is_some() => break,
            Err(RecvTimeoutError::Timeout) => display.refresh(),
            Err(RecvTimeoutError::Disconnected) => break,
        }
    }
    match failed {
        Some((failure, _)) => Err(failure),
        None => Ok(ended),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn agents_learn_in_halves_where_whole_update_calls_would_leave_processors_idle() {
        for (agents, processors) in [(1, 2), (3, 2), (2, 4), (5, 4), (1, 64)] {
            assert_eq!(threads_to_learn(agents, processors), 2, "{agents} on {processors}");
        }
        for (agents, processors) in [(1, 1), (3, 1), (2, 2), (4, 2), (3, 4), (4, 4), (8, 4)] {
            assert_eq!(threads_to_learn(agents, processors), 1, "{agents} on {processors}");
        }
    }
}
