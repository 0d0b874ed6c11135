//! Other work on the machine while a run is measured, and the remaining speed.

use std::process::{Child, Command, Stdio};

use process::Failure;
use proto::exit;

use super::cases::Beside;
use super::{stay_on, Measured};

/// A shell loop that runs until this process has ended.
const LOOP: &str = r#"while kill -0 "$PPID"; do i=0; while [ $i -lt 100000 ]; do i=$((i + 1)); done; done"#;

/// The loops beside a run. Killed when dropped.
pub struct Loops(Vec<Child>);

impl Loops {
    /// One on each core, if that is what the run has beside it.
    ///
    /// # Errors
    /// If a loop cannot be started or kept on its core.
    pub fn start(beside: Beside, cores: usize) -> Result<Self, Failure> {
        let mut loops = Self(Vec::new());
        if let Beside::Loops { nice } = beside {
            for core in 0..cores {
                loops.0.push(one(nice, core)?);
            }
        }
        Ok(loops)
    }
}

/// Starts a loop from a thread that stays on the core, which the child inherits.
fn one(nice: u8, core: usize) -> Result<Child, Failure> {
    let start = move || {
        stay_on(core)?;
        let mut command = Command::new("nice");
        command.args(["-n", &nice.to_string(), "sh", "-c", LOOP]);
        command.stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::null());
        command.spawn().map_err(|e| Failure::new(exit::IO, format!("cannot start `nice` for a loop: {e}")))
    };
    std::thread::spawn(start).join().expect("starting a process does not panic")
}

impl Drop for Loops {
    fn drop(&mut self) {
        for child in &mut self.0 {
            // It may have ended already.
            let _ = child.kill();
            let _ = child.wait();
        }
    }
}

/// The speed of every measurement beside other work, relative to the same case on the idle machine.
pub fn ratios(cases: &[Measured]) -> String {
    let mut text = String::new();
    for busy in cases {
        let Some(beside) = &busy.beside else { continue };
        let same = |idle: &&Measured| idle.beside.is_none() && idle.case() == busy.case();
        let Some(idle) = cases.iter().find(same) else { continue };
        text += &format!(
            "{:<28} {:<6} {:>6} {:<12} {:<24} {:>5.2}\n",
            busy.task,
            busy.algo,
            busy.copies,
            busy.place,
            beside,
            busy.env_steps_per_second.median / idle.env_steps_per_second.median
        );
    }
    if !text.is_empty() {
        text = format!("\nspeed of one run beside other work, over that on the idle machine\n{text}");
    }
    text
}

#[cfg(test)]
mod tests {
    use std::time::{Duration, Instant};

    use super::*;

    #[test]
    fn a_loop_works_until_it_is_dropped() {
        let loops = Loops::start(Beside::Loops { nice: 19 }, 1).unwrap();
        let id = loops.0[0].id();
        let stat = || std::fs::read_to_string(format!("/proc/{id}/stat")).ok();
        // User time and nice value: the 14th and the 19th field, the 12th and 17th after the name.
        let field = |at: usize| -> Option<i64> {
            let stat = stat()?;
            stat.rsplit_once(')')?.1.split_whitespace().nth(at - 3)?.parse().ok()
        };
        let start = Instant::now();
        while field(14) < Some(2) || field(19) != Some(19) {
            assert!(start.elapsed() < Duration::from_secs(60), "{:?}", stat());
        }
        drop(loops);
        assert_eq!(stat(), None);
        assert!(Loops::start(Beside::ARun, 4).unwrap().0.is_empty());
    }
}
