//! Each role as a child process of this one: the same program, started with the role's name.

use std::collections::VecDeque;
use std::ffi::OsString;
use std::io::{BufRead, BufReader, Read, Write};
use std::os::unix::process::{CommandExt, ExitStatusExt};
use std::path::Path;
use std::process::{Child, ChildStdin, Command, ExitStatus, Stdio};
use std::sync::mpsc::{channel, RecvTimeoutError, Sender};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread;
use std::time::{Duration, Instant};

use agent::Machine;
use nix::sys::signal::{kill, Signal};
use nix::unistd::Pid;
use process::{Failure, LEAVE_NOW, LISTENING};
use proto::config::Config;
use proto::exit;
use store::RunFolder;

use crate::drive::Options;
use crate::meeting::Meeting;
use crate::roles::{listen, Ended, News, Roles, Transport};

/// Lines of stderr kept for the error message.
const LAST_WORDS: usize = 8;

/// Prefix of the line in which a child reports why it ends ([`process::report`]).
const REPORT: &str = "error: ";

/// A child that does not leave on request is killed after this time.
const PATIENCE: Duration = Duration::from_millis(1500);

/// Pause between two checks of children that are about to listen or to end.
const LOOK_AGAIN: Duration = Duration::from_millis(5);

/// The children of this process.
pub struct ChildProcesses {
    children: Vec<RunningChild>,
    /// Receives the scalars while it exists.
    _monitor: Arc<dyn bus::Bus>,
    _meeting: Meeting,
    stops: u32,
}

struct RunningChild {
    pid: Pid,
    /// Closed when this process ends for any reason; the child then saves and leaves.
    stdin: ChildStdin,
    ended: Arc<Mutex<bool>>,
}

impl RunningChild {
    fn has_ended(&self) -> bool {
        *self.ended.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl ChildProcesses {
    /// Starts env-server and coordinator, then, when they listen, the agents.
    ///
    /// # Errors
    /// If a child cannot be started or ends before it can be dialled.
    pub fn start(
        folder: &RunFolder,
        config: &Config,
        options: &Options,
        machine: Machine,
        transport: Option<Transport>,
        news: &Sender<News>,
    ) -> Result<Self, Failure> {
        let meeting = Meeting::at(folder.path(), transport)?;
        let monitor = bus::open(&bus::Options {
            listen: vec![meeting.monitor.clone()],
            low_latency: config.bus.low_latency,
            ..bus::Options::default()
        })?;
        listen(&*monitor, config, news.clone())?;
        let mut common: Vec<OsString> = vec![
            option("--config=", &folder.path().join("config.toml")),
            option("--out=", folder.path()),
            format!("--wait={}", options.wait.as_secs()).into(),
            "--with-launcher".into(),
        ];
        common.extend(monitor.endpoints().iter().map(|endpoint| format!("--monitor={endpoint}").into()));

        let listeners = [
            ("env-server", "world", meeting.world.clone()),
            ("coordinator", "coordinator", meeting.coordinator.clone()),
        ];
        let mut roles = Self { children: vec![], _monitor: monitor, _meeting: meeting, stops: 0 };
        let (listening, endpoints) = channel();
        for (role, name, endpoint) in listeners {
            let mut arguments: Vec<OsString> = vec![format!("--listen={endpoint}").into()];
            if options.start_over && role == "env-server" {
                arguments.push("--start-over".into());
            }
            roles.spawn(role, name, common.iter().chain(&arguments), news, Some(listening.clone()))?;
        }
        drop(listening);
        let mut dial: Vec<OsString> = Vec::new();
        while dial.len() < 2 {
            match endpoints.recv_timeout(LOOK_AGAIN) {
                Ok(endpoint) => dial.push(format!("--connect={endpoint}").into()),
                Err(RecvTimeoutError::Timeout) if !roles.children.iter().any(RunningChild::has_ended) => {}
                // A child has ended before it listened; its own message names the reason.
                Err(_) => return Ok(roles),
            }
        }
        for id in 0..config.world.agents {
            let own = [
                format!("--id={id}").into(),
                format!("--device={}", machine.device).into(),
                format!("--threads={}", machine.threads).into(),
            ];
            let arguments = common.iter().chain(&dial).chain(&own);
            roles.spawn("agent", &format!("agent-{id}"), arguments, news, None)?;
        }
        Ok(roles)
    }

    fn spawn<'a>(
        &mut self,
        role: &str,
        name: &str,
        arguments: impl Iterator<Item = &'a OsString>,
        news: &Sender<News>,
        listening: Option<Sender<String>>,
    ) -> Result<(), Failure> {
        let failed = |error: std::io::Error| Failure::new(exit::IO, format!("cannot start {name}: {error}"));
        let program = std::env::current_exe().map_err(failed)?;
        let mut child = Command::new(program)
            .arg(role)
            .args(arguments)
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            // Ctrl-C in a terminal reaches this process only, which then signals the env-server.
            .process_group(0)
            .spawn()
            .map_err(failed)?;
        let pid = Pid::from_raw(child.id() as i32);
        let stdin = child.stdin.take().expect("it was asked for");
        let ended = Arc::new(Mutex::new(false));
        self.children.push(RunningChild { pid, stdin, ended: ended.clone() });
        let (name, news) = (name.to_owned(), news.clone());
        if let Some(stdout) = child.stdout.take() {
            thread::spawn(move || tell_endpoints(stdout, listening));
        }
        thread::spawn(move || {
            let result = outlive(&mut child, &name, &ended, &news);
            let _ = news.send(News::Ended { role: name, result });
        });
        Ok(())
    }

    /// Requests every child to save its last complete round and leave. Not with a second SIGTERM, which counts as the
    /// same request soon after the first.
    fn leave_now(&mut self) {
        for child in &mut self.children {
            // It may have ended.
            let _ = child.stdin.write_all(LEAVE_NOW);
        }
    }

    fn signal(&self, which: impl Iterator<Item = usize>, signal: Signal) {
        for child in which.filter_map(|index| self.children.get(index)) {
            // Held while sending: a child keeps its process id until it has been waited for.
            let ended = child.ended.lock().unwrap_or_else(PoisonError::into_inner);
            if !*ended {
                // It may have just ended.
                let _ = kill(child.pid, signal);
            }
        }
    }
}

/// An option with a path, which need not be text.
fn option(name: &str, path: &Path) -> OsString {
    let mut option = OsString::from(name);
    option.push(path);
    option
}

/// Reads a child's stdout: the endpoints it listens on.
fn tell_endpoints(stdout: impl Read, listening: Option<Sender<String>>) {
    for line in BufReader::new(stdout).lines().map_while(Result::ok) {
        if let (Some(endpoint), Some(listening)) = (line.strip_prefix(LISTENING), &listening) {
            // The receiver is dropped when it has all endpoints.
            let _ = listening.send(endpoint.trim().to_owned());
        }
    }
}

/// Waits for a child to end. Passes on its lines, and keeps the last ones for the error message: from the line in
/// which it reports why it ends, or the last few of a child that was killed.
fn outlive(
    child: &mut Child,
    name: &str,
    ended: &Mutex<bool>,
    news: &Sender<News>,
) -> Result<Ended, Failure> {
    let (mut last_words, mut reports) = (VecDeque::new(), false);
    if let Some(stderr) = child.stderr.take() {
        for line in BufReader::new(stderr).lines().map_while(Result::ok) {
            if !reports && line.starts_with(REPORT) {
                reports = true;
                last_words.clear();
            }
            if !reports {
                // The receiver is gone only if the run is abandoned.
                let _ = news.send(News::Said { role: name.to_owned(), line: line.clone() });
            }
            last_words.push_back(line);
            if last_words.len() > LAST_WORDS {
                last_words.pop_front();
            }
        }
    }
    let status = {
        // stderr is closed, so it has ended or is about to.
        let mut status = child.try_wait();
        while matches!(status, Ok(None)) {
            thread::sleep(Duration::from_millis(2));
            let mut ended = ended.lock().unwrap_or_else(PoisonError::into_inner);
            status = child.try_wait();
            *ended = !matches!(status, Ok(None));
        }
        *ended.lock().unwrap_or_else(PoisonError::into_inner) = true;
        status
    };
    match status {
        Ok(Some(status)) => verdict(status, reports, &last_words),
        Ok(None) => unreachable!("the loop ends when there is a status"),
        Err(error) => Err(Failure::new(exit::IO, format!("cannot wait for {name}: {error}"))),
    }
}

fn verdict(status: ExitStatus, reports: bool, last_words: &VecDeque<String>) -> Result<Ended, Failure> {
    let words: Vec<&str> = last_words.iter().map(String::as_str).collect();
    let words = words.join("\n");
    match (status.code(), status.signal()) {
        (Some(0), _) => Ok(Ended::Finished),
        // It has stopped on request.
        (Some(code), _) if code == i32::from(exit::AGAIN) && !reports => Ok(Ended::Stopped),
        (Some(code), _) => {
            let words = words.strip_prefix(REPORT).unwrap_or(&words);
            let code = u8::try_from(code).unwrap_or(exit::BUG);
            Err(Failure::new(
                code,
                if words.is_empty() { format!("ended with exit code {code}") } else { words.to_owned() },
            ))
        }
        (None, signal) => {
            let signal = signal.and_then(|s| Signal::try_from(s).ok()).map_or("a signal", Signal::as_str);
            let words = if words.is_empty() { String::new() } else { format!("; its last lines:\n{words}") };
            Err(Failure::new(exit::AGAIN, format!("was ended by {signal}{words}")))
        }
    }
}

impl Roles for ChildProcesses {
    fn stop(&mut self) {
        self.stops += 1;
        if self.stops == 1 {
            self.signal(0..1, Signal::SIGTERM);
        } else {
            self.leave_now();
        }
    }

    fn abandon(&mut self) {
        let all = 0..self.children.len();
        self.leave_now();
        let deadline = Instant::now() + PATIENCE;
        while !self.children.iter().all(RunningChild::has_ended) {
            if Instant::now() >= deadline {
                self.signal(all, Signal::SIGKILL);
                break;
            }
            thread::sleep(LOOK_AGAIN);
        }
    }
}

impl Drop for ChildProcesses {
    fn drop(&mut self) {
        self.abandon();
    }
}
