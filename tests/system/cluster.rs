//! The processes of one test: started in a temporary folder, awaited with deadlines, killed at the end of the test.

use std::collections::BTreeSet;
use std::ffi::OsStr;
use std::fs;
use std::io::{BufRead, BufReader, Read};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::sync::{Arc, Mutex, OnceLock, PoisonError};
use std::thread::{self, JoinHandle};
use std::time::{Duration, Instant};

use nix::sys::signal::{kill, Signal};
use nix::unistd::Pid;
use tempfile::TempDir;

/// Ten times longer than any wait of these tests takes on an idle machine.
pub const DEADLINE: Duration = Duration::from_secs(60);

/// Pause between two checks of a condition.
const LOOK_AGAIN: Duration = Duration::from_millis(2);

/// Waits until `condition` holds.
pub fn wait_until(what: &str, mut condition: impl FnMut() -> bool) {
    let deadline = Instant::now() + DEADLINE;
    while !condition() {
        assert!(Instant::now() < deadline, "waited {DEADLINE:?} for {what}");
        thread::sleep(LOOK_AGAIN);
    }
}

/// An experiment as the words of a command line: two agents, small networks, short periods, a checkpoint every few
/// rounds. Metric rows cover two or three rounds, so that a checkpoint between two rows has unlogged sums.
pub fn experiment(seed: u64, t_max: u64) -> Vec<String> {
    let words = [
        "lbf-5x5-2p-1f".to_owned(),
        format!("--seed={seed}"),
        format!("--t-max={t_max}"),
        "--switch-period=3".to_owned(),
        "--test-interval=2500".to_owned(),
        "--test-episodes=20".to_owned(),
        "--set=algo.hidden=16".to_owned(),
        "--set=save.interval=4".to_owned(),
        "--set=log.interval=700".to_owned(),
    ];
    words.into()
}

/// The experiment of most tests, about 30 rounds.
pub fn short() -> Vec<String> {
    experiment(1, 9_000)
}

/// The digest line of [`short`] without a disturbance; computed once for all tests.
pub fn undisturbed() -> &'static str {
    static DIGEST: OnceLock<String> = OnceLock::new();
    DIGEST.get_or_init(|| {
        let cluster = Cluster::new();
        cluster.train("undisturbed", short(), ["--in-process"]).succeeds();
        cluster.digest("undisturbed")
    })
}

/// A temporary folder and the processes in it.
pub struct Cluster {
    folder: TempDir,
}

impl Cluster {
    pub fn new() -> Self {
        Self { folder: tempfile::Builder::new().prefix("rondo-").tempdir().expect("a temporary folder") }
    }

    /// A path in the folder.
    pub fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    /// Starts `rondo train` with run folder `run`.
    pub fn train<W: AsRef<OsStr>>(
        &self,
        run: &str,
        experiment: Vec<String>,
        more: impl IntoIterator<Item = W>,
    ) -> Process {
        let mut command = rondo();
        command.arg("train").args(experiment).arg("--quiet").arg("--out").arg(self.path(run)).args(more);
        Process::start(command)
    }

    /// Starts `rondo resume` on run folder `run`.
    pub fn resume(&self, run: &str) -> Process {
        self.resume_with(run, [""; 0])
    }

    /// Starts `rondo resume` with further arguments.
    pub fn resume_with<W: AsRef<OsStr>>(&self, run: &str, more: impl IntoIterator<Item = W>) -> Process {
        let mut command = rondo();
        command.arg("resume").arg(self.path(run)).arg("--quiet").args(more);
        Process::start(command)
    }

    /// The present content of run folder `run`.
    pub fn run(&self, run: &str) -> RunFolder {
        RunFolder { path: self.path(run) }
    }

    /// The line that `rondo digest --json` prints.
    pub fn digest(&self, run: &str) -> String {
        let mut command = rondo();
        command.arg("digest").arg(self.path(run)).arg("--json");
        Process::start(command).succeeds().stdout
    }
}

/// The user's command.
pub fn rondo() -> Command {
    Command::new(env!("CARGO_BIN_EXE_rondo"))
}

/// The program of one role, which lies beside the user's command.
pub fn role(program: &str) -> Command {
    let path = Path::new(env!("CARGO_BIN_EXE_rondo")).with_file_name(program);
    assert!(path.exists(), "{} is not there; run `cargo test --workspace`", path.display());
    Command::new(path)
}

/// A zenoh session that is not a role; cargo builds it with the tests of the workspace.
pub fn outsider() -> Command {
    role("examples/outsider")
}

/// The exit code and output of a process.
#[derive(Debug)]
pub struct Ended {
    /// `None` if a signal ended it.
    pub code: Option<i32>,
    pub stdout: String,
    pub stderr: String,
}

impl Ended {
    /// Expects an exit code, and each of `parts` on stderr.
    #[track_caller]
    pub fn fails_with(&self, code: u8, parts: &[&str]) {
        assert_eq!(self.code, Some(code.into()), "{self:#?}");
        for part in parts {
            assert!(self.stderr.contains(part), "`{part}` is missing in {self:#?}");
        }
        assert!(!self.stderr.contains("panicked"), "{self:#?}");
    }
}

/// A process, its output, and its own processes; all of them are killed when this is dropped.
pub struct Process {
    child: Child,
    stdout: Arc<Mutex<String>>,
    stderr: Arc<Mutex<String>>,
    readers: Vec<JoinHandle<()>>,
    family: BTreeSet<Member>,
}

impl Process {
    pub fn start(mut command: Command) -> Self {
        command.stdin(Stdio::null()).stdout(Stdio::piped()).stderr(Stdio::piped());
        let mut child = command.spawn().unwrap_or_else(|error| panic!("{command:?}: {error}"));
        let (stdout, stderr) = (Arc::default(), Arc::default());
        let readers = vec![
            collect(child.stdout.take().expect("it was asked for"), &stdout),
            collect(child.stderr.take().expect("it was asked for"), &stderr),
        ];
        Self { child, stdout, stderr, readers, family: BTreeSet::new() }
    }

    /// Its stderr so far.
    pub fn stderr(&self) -> String {
        self.stderr.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }

    /// Its stdout so far.
    pub fn stdout(&self) -> String {
        self.stdout.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }

    /// The rest of the first line on stdout that begins with `listening `.
    pub fn endpoint(&self) -> String {
        let mut found = None;
        wait_until("a role that listens", || {
            found = self.stdout().lines().find_map(|line| line.strip_prefix("listening ")).map(str::to_owned);
            found.is_some() || !self.is_alive()
        });
        found.unwrap_or_else(|| panic!("it ended: {}", self.stderr()))
    }

    fn member(&self) -> Option<Member> {
        Member::of(self.child.id())
    }

    /// Whether it still runs.
    pub fn is_alive(&self) -> bool {
        self.member().is_some()
    }

    /// Its children that still run.
    pub fn children(&mut self) -> Vec<Member> {
        let children = Member::children_of(self.child.id());
        self.family.extend(children.iter().cloned());
        children
    }

    /// Its descendants that still run.
    pub fn descendants(&mut self) -> Vec<Member> {
        let mut found = self.children();
        let mut next = 0;
        while let Some(member) = found.get(next) {
            found.extend(Member::children_of(member.pid));
            next += 1;
        }
        self.family.extend(found.iter().cloned());
        found
    }

    /// The process of one role, when it has started: `env-server`, `coordinator` or `agent-0`.
    pub fn child(&mut self, role: &str) -> Member {
        let mut found = None;
        wait_until(role, || {
            found = self.children().into_iter().find(|child| child.role().as_deref() == Some(role));
            found.is_some()
        });
        found.expect("it has been waited for")
    }

    /// Sends a signal to this process only.
    pub fn signal(&self, signal: Signal) {
        // It has not been waited for, so the process id is still its own.
        kill(Pid::from_raw(self.child.id() as i32), signal).expect("its parent may signal it");
    }

    /// Kills this process and its descendants, so fast that none notices the end of another.
    #[track_caller]
    pub fn kill_all(mut self) {
        // From now on it starts no process and sends no message.
        self.signal(Signal::SIGSTOP);
        let children = self.children();
        children.iter().for_each(|child| child.signal(Signal::SIGSTOP));
        children.iter().for_each(|child| child.signal(Signal::SIGKILL));
        self.signal(Signal::SIGKILL);
        let ended = self.wait();
        assert_eq!(ended.code, None, "it was to be killed while it ran: {ended:#?}");
        wait_until("the killed processes to be gone", || !children.iter().any(Member::is_alive));
    }

    /// Waits for its end.
    #[track_caller]
    pub fn wait(mut self) -> Ended {
        let mut status = None;
        wait_until("a process to end", || {
            status = self.child.try_wait().expect("it is our child");
            status.is_some()
        });
        for reader in self.readers.drain(..) {
            reader.join().expect("reading does not panic");
        }
        let text = |text: &Mutex<String>| text.lock().unwrap_or_else(PoisonError::into_inner).clone();
        let code = status.and_then(|status| status.code());
        Ended { code, stdout: text(&self.stdout), stderr: text(&self.stderr) }
    }

    /// Waits for its end and expects exit code 0.
    #[track_caller]
    pub fn succeeds(self) -> Ended {
        let ended = self.wait();
        assert_eq!(ended.code, Some(0), "{ended:#?}");
        ended
    }
}

impl Drop for Process {
    fn drop(&mut self) {
        if matches!(self.child.try_wait(), Ok(None)) {
            self.children();
            // Both may fail only because it has just ended.
            let _ = self.child.kill();
            let _ = self.child.wait();
        }
        for member in self.family.iter().filter(|member| member.is_alive()) {
            member.signal(Signal::SIGKILL);
        }
    }
}

/// Reads a stream to its end, line by line.
fn collect(stream: impl Read + Send + 'static, text: &Arc<Mutex<String>>) -> JoinHandle<()> {
    let text = text.clone();
    thread::spawn(move || {
        for line in BufReader::new(stream).lines().map_while(Result::ok) {
            let mut text = text.lock().unwrap_or_else(PoisonError::into_inner);
            text.push_str(&line);
            text.push('\n');
        }
    })
}

/// A process by id and start time, because ids are reused.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord)]
pub struct Member {
    pid: u32,
    started: u64,
}

impl Member {
    fn of(pid: u32) -> Option<Self> {
        stat(pid).map(|(_, started)| Self { pid, started })
    }

    fn children_of(parent: u32) -> Vec<Self> {
        let entries = fs::read_dir("/proc").expect("/proc is there").map_while(Result::ok);
        let pids = entries.filter_map(|entry| entry.file_name().to_str()?.parse::<u32>().ok());
        pids.filter(|&pid| stat(pid).is_some_and(|(of, _)| of == parent)).filter_map(Self::of).collect()
    }

    /// Whether it still runs; one that has ended and waits for its parent does not.
    pub fn is_alive(&self) -> bool {
        stat(self.pid).is_some_and(|(_, started)| started == self.started)
    }

    /// Sends it a signal, if it still runs.
    pub fn signal(&self, signal: Signal) {
        if self.is_alive() {
            // It may end in this very moment.
            let _ = kill(Pid::from_raw(self.pid as i32), signal);
        }
    }

    /// Whether all of its threads have stopped; SIGSTOP takes effect after a short time.
    pub fn has_stopped(&self) -> bool {
        let Ok(threads) = fs::read_dir(format!("/proc/{}/task", self.pid)) else { return false };
        let stats =
            threads.map_while(Result::ok).map(|thread| fs::read_to_string(thread.path().join("stat")));
        // The state follows the name in parentheses.
        stats
            .into_iter()
            .all(|stat| stat.is_ok_and(|text| text.rsplit(')').next().is_some_and(|t| t.starts_with(" T"))))
    }

    /// Which role it was started as.
    fn role(&self) -> Option<String> {
        let line = fs::read_to_string(format!("/proc/{}/cmdline", self.pid)).ok()?;
        let mut words = line.split('\0');
        match words.nth(1)? {
            "agent" => words.find_map(|word| word.strip_prefix("--id=")).map(|id| format!("agent-{id}")),
            role => Some(role.to_owned()),
        }
    }
}

/// Parent and start time of a process that runs.
fn stat(pid: u32) -> Option<(u32, u64)> {
    let text = fs::read_to_string(format!("/proc/{pid}/stat")).ok()?;
    // The name in parentheses may hold anything; state, parent, … follow it.
    let fields: Vec<&str> = text[text.rfind(')')? + 1..].split_whitespace().collect();
    let runs = !matches!(*fields.first()?, "Z" | "X");
    runs.then_some((fields.get(1)?.parse().ok()?, fields.get(19)?.parse().ok()?))
}

/// A run, seen through its folder.
pub struct RunFolder {
    pub path: PathBuf,
}

impl RunFolder {
    /// The complete lines of a role's metrics.
    pub fn rows(&self, role: &str) -> Vec<serde_json::Value> {
        let text = fs::read_to_string(self.path.join(role).join("metrics.jsonl")).unwrap_or_default();
        let complete = text.rfind('\n').map_or("", |end| &text[..end]);
        complete.lines().map(|line| serde_json::from_str(line).expect("a row is JSON")).collect()
    }

    /// Environment steps at the env-server's last row of training.
    pub fn t_env(&self) -> u64 {
        let rows = self.rows("world");
        rows.iter()
            .filter(|row| row["test_return_mean"].is_null())
            .filter_map(|row| row["t_env"].as_u64())
            .max()
            .unwrap_or(0)
    }

    /// The rounds of which a role has a checkpoint, ascending.
    pub fn checkpoints(&self, role: &str) -> Vec<u64> {
        let Ok(entries) = fs::read_dir(self.path.join(role).join("checkpoints")) else { return vec![] };
        let names = entries.map_while(Result::ok).filter_map(|entry| entry.file_name().into_string().ok());
        let mut rounds: Vec<u64> =
            names.filter_map(|name| name.strip_prefix("round-")?.parse().ok()).collect();
        rounds.sort_unstable();
        rounds
    }

    /// The folder of a role's checkpoint.
    pub fn checkpoint(&self, role: &str, round: u64) -> PathBuf {
        self.path.join(role).join("checkpoints").join(format!("round-{round:012}"))
    }

    /// Waits until the run has counted so many environment steps.
    pub fn reaches(&self, t_env: u64) {
        wait_until(&format!("{t_env} environment steps"), || self.t_env() >= t_env);
    }
}

/// Copies a folder into another, as a user who merges the folders of several hosts.
pub fn copy_into(from: &Path, to: &Path) {
    fs::create_dir_all(to).expect("a folder");
    for entry in fs::read_dir(from).expect("a folder") {
        let entry = entry.expect("a name");
        let (from, to) = (entry.path(), to.join(entry.file_name()));
        if from.is_dir() {
            copy_into(&from, &to);
        } else {
            fs::copy(&from, &to).expect("a copy");
        }
    }
}
