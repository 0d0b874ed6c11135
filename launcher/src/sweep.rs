//! Several seeds of one experiment, one after another or side by side, each a `rondo train` of its own.

use std::os::unix::process::CommandExt;
use std::path::Path;
use std::process::{Child, Command, ExitCode, Stdio};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::Arc;
use std::time::Duration;

use nix::sys::signal::{kill, Signal};
use nix::unistd::Pid;
use process::Failure;
use proto::exit;

/// Trains these seeds below `out`, `jobs` of them side by side; the first failure stops the rest.
///
/// # Errors
/// If a seed fails or cannot be started.
pub fn run(seeds: &[u64], jobs: usize, out: &Path) -> Result<ExitCode, Failure> {
    let io = |error: std::io::Error| Failure::new(exit::IO, format!("cannot start a seed: {error}"));
    let stop = Arc::new(AtomicBool::new(false));
    for signal in [signal_hook::consts::SIGINT, signal_hook::consts::SIGTERM] {
        signal_hook::flag::register(signal, stop.clone()).map_err(io)?;
    }
    let mut waiting: Vec<u64> = seeds.iter().rev().copied().collect();
    let mut running: Vec<(u64, Child)> = Vec::new();
    let mut worst = exit::DONE;
    loop {
        while worst == exit::DONE && running.len() < jobs {
            let Some(seed) = waiting.pop() else { break };
            eprintln!("seed {seed}: {}", out.join(format!("seed-{seed}")).display());
            running.push((seed, start(seed, out).map_err(io)?));
        }
        if running.is_empty() {
            break;
        }
        if stop.swap(false, Ordering::Relaxed) {
            worst = exit::AGAIN;
            for (_, child) in &running {
                // One that has just ended needs no telling.
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
        std::thread::sleep(Duration::from_millis(50));
    }
    Ok(ExitCode::from(worst))
}

/// The same command line with another seed and folder.
fn start(seed: u64, out: &Path) -> std::io::Result<Child> {
    let mut arguments = Vec::new();
    let mut given = std::env::args_os().skip(1);
    while let Some(argument) = given.next() {
        let text = argument.to_string_lossy().into_owned();
        // `--jobs` stays: it says how many share this machine.
        let replaced = ["--seed", "--seeds", "--out"];
        if replaced.contains(&text.as_str()) {
            given.next();
        } else if !replaced.iter().any(|option| text.starts_with(&format!("{option}="))) {
            arguments.push(argument);
        }
    }
    Command::new(std::env::current_exe()?)
        .args(arguments)
        .arg(format!("--seed={seed}"))
        .arg(format!("--out={}", out.join(format!("seed-{seed}")).display()))
        .arg("--with-launcher")
        .stdin(Stdio::piped())
        // Ctrl-C in a terminal reaches this process alone, which then tells each seed once.
        .process_group(0)
        .spawn()
}
