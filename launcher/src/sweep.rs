//! Several seeds of one experiment, one after another or side by side, each as a `rondo` process.

use std::ffi::OsString;
use std::os::unix::process::CommandExt;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, ExitCode, Stdio};
use std::sync::mpsc::channel;
use std::time::Duration;

use nix::sys::signal::{kill, Signal};
use nix::unistd::Pid;
use process::Failure;
use proto::exit;

/// Pause between two checks of the running seeds.
const LOOK_AGAIN: Duration = Duration::from_millis(50);

/// One seed: its folder and how to train it.
pub struct Part {
    seed: u64,
    folder: PathBuf,
    arguments: Vec<OsString>,
}

impl Part {
    /// The command line of this process with another seed and folder.
    pub fn train(seed: u64, out: &Path) -> Self {
        let folder = out.join(format!("seed-{seed}"));
        let mut arguments = Vec::new();
        let mut given = std::env::args_os().skip(1);
        while let Some(argument) = given.next() {
            let text = argument.to_string_lossy().into_owned();
            // `--jobs` stays: it is the number of teams on this machine. `--fresh` has chosen the folder.
            let replaced = ["--seed", "--seeds", "--out"];
            if replaced.contains(&text.as_str()) {
                given.next();
            } else if text != "--fresh"
                && !replaced.iter().any(|option| text.starts_with(&format!("{option}=")))
            {
                arguments.push(argument);
            }
        }
        arguments.extend([format!("--seed={seed}").into(), "--out".into(), folder.clone().into()]);
        Self { seed, folder, arguments }
    }

    /// The command line of this process for another run folder.
    pub fn resume(seed: u64, folder: &Path) -> Self {
        let sweep = folder.parent().map(Path::as_os_str).unwrap_or_default();
        let given = std::env::args_os().skip(1);
        let arguments =
            given.map(|given| if is_same(&given, sweep) { folder.into() } else { given }).collect();
        Self { seed, folder: folder.to_owned(), arguments }
    }

    fn start(&self) -> std::io::Result<Child> {
        Command::new(std::env::current_exe()?)
            .args(&self.arguments)
            .arg("--with-launcher")
            .stdin(Stdio::piped())
            // Ctrl-C in a terminal reaches this process only, which then signals each seed once.
            .process_group(0)
            .spawn()
    }
}

/// Whether an argument names a folder, with or without a slash at its end.
fn is_same(argument: &OsString, folder: &std::ffi::OsStr) -> bool {
    Path::new(argument).components().eq(Path::new(folder).components())
}

/// Trains these seeds, `jobs` of them side by side. The first failure stops the rest. Signals are passed on to all
/// running seeds, which save.
///
/// # Errors
/// If a seed cannot be started.
pub fn run(parts: Vec<Part>, jobs: usize) -> Result<ExitCode, Failure> {
    let io = |error: std::io::Error| Failure::new(exit::IO, format!("cannot start a seed: {error}"));
    let (sender, requests) = channel();
    // The receiver is gone only if all seeds have ended.
    process::on_stop_request(move |request| {
        let _ = sender.send(request);
    })?;
    let mut waiting = parts.into_iter();
    let mut running: Vec<(u64, Child)> = Vec::new();
    let mut worst = exit::DONE;
    loop {
        while worst == exit::DONE && running.len() < jobs {
            let Some(part) = waiting.next() else { break };
            eprintln!("seed {}: {}", part.seed, part.folder.display());
            running.push((part.seed, part.start().map_err(io)?));
        }
        if running.is_empty() {
            break;
        }
        // A seed counts signals as this process does, so each is passed on.
        for _request in requests.try_iter() {
            worst = exit::AGAIN;
            for (_, child) in &running {
                // It may have just ended.
                let _ = kill(Pid::from_raw(child.id() as i32), Signal::SIGTERM);
            }
        }
        let mut still = Vec::new();
        for (seed, mut child) in running {
            match child.try_wait().map_err(io)? {
                None => still.push((seed, child)),
                Some(status) if status.success() => {}
                Some(status) => {
                    let code = status.code().and_then(|code| u8::try_from(code).ok()).unwrap_or(exit::AGAIN);
                    eprintln!("seed {seed} ended with exit code {code}");
                    worst = if worst == exit::DONE { code } else { worst };
                }
            }
        }
        running = still;
        std::thread::sleep(LOOK_AGAIN);
    }
    Ok(ExitCode::from(worst))
}
