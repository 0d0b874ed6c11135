//! One run from its start to its summary, in processes or in one.

use std::path::Path;
use std::sync::mpsc::{channel, Receiver, RecvTimeoutError, Sender};
use std::time::{Duration, Instant, SystemTime};

use algos::device::DeviceName;
use process::Failure;
use proto::config::Config;
use proto::exit;
use signal_hook::consts::{SIGHUP, SIGINT, SIGTERM};
use signal_hook::iterator::Signals;
use store::RunFolder;

use crate::child_processes::ChildProcesses;
use crate::display::{Display, Show};
use crate::in_process::InProcess;
use crate::one_at_a_time;
use crate::roles::{Ended, News, Roles, Transport};
use crate::summary::{self, Summary};

/// Where the roles run.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Place {
    /// Each in a process of its own, on this kind of link.
    Processes(Transport),
    /// All as threads of this process, on a bus in memory.
    InProcess,
}

/// How to show and run it.
#[derive(Debug, Clone, Copy)]
pub struct Options {
    pub place: Place,
    /// Where agents compute.
    pub device: DeviceName,
    /// How long roles wait for each other.
    pub wait: Duration,
    pub show: Show,
}

/// After one role has failed the others get this long to save and leave.
const AFTER_FAILURE: Duration = Duration::from_millis(1500);

/// Runs (or goes on with) the run in `folder`.
///
/// # Errors
/// The first failure of a role.
pub fn drive(folder: &RunFolder, config: &Config, options: Options) -> Result<(Ended, Summary), Failure> {
    let _held = one_at_a_time::hold(folder.path())?;
    let (sender, news) = channel();
    watch_signals(sender.clone())?;
    let start = SystemTime::now();
    let mut display = Display::new(config, options.show);
    let mut roles: Box<dyn Roles> = match options.place {
        Place::InProcess => {
            Box::new(InProcess::start(folder, config, options.wait, options.device, &sender)?)
        }
        Place::Processes(transport) => {
            Box::new(ChildProcesses::start(folder, config, &options, transport, &sender)?)
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

fn watch_signals(sender: Sender<News>) -> Result<(), Failure> {
    let mut signals = Signals::new([SIGINT, SIGTERM, SIGHUP])
        .map_err(|error| Failure::new(exit::BUG, format!("cannot watch for signals: {error}")))?;
    std::thread::spawn(move || {
        for _ in signals.forever() {
            if sender.send(News::Signal).is_err() {
                break;
            }
        }
    });
    Ok(())
}

/// Follows the roles until all have ended.
fn follow(
    roles: &mut dyn Roles,
    news: &Receiver<News>,
    display: &mut Display,
    count: usize,
    path: &Path,
) -> Result<Ended, Failure> {
    let (mut left, mut ended, mut signals) = (count, Ended::Finished, 0);
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
                            format!("\nhint: go on with `rondo resume {}`", path.display())
                        } else {
                            String::new()
                        };
                        let failure = Failure::new(failure.code, format!("{role}: {failure}{hint}"));
                        failed = Some((failure, Instant::now() + AFTER_FAILURE));
                        // The first asks for a round edge, which may never come; the second does not.
                        roles.stop();
                        roles.stop();
                    }
                    Err(_) => {}
                }
            }
            Ok(News::Signal) => {
                signals += 1;
                match signals {
                    1 => display.say("stopping at the next round edge; once more to leave at once"),
                    2 => {}
                    _ => roles.abandon(),
                }
                roles.stop();
            }
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
