//! `rondo render`: episodes of a trained team as a film, as pictures, or live in the terminal.

use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::Arc;
use std::thread::sleep;
use std::time::Duration;

use console::Term;
use env_server::Copies;
use monitor::picture::{self, Colours, Frame, Terminal};
use process::Failure;
use proto::exit;

use crate::eval::Playing;
use crate::look::unusable;
use crate::team::Team;

/// Factor of the time that the end of an episode stays in the terminal.
const AT_THE_END: u32 = 5;

/// Draw episodes of the trained agents of a run
#[derive(Debug, Clone, clap::Args)]
pub struct Render {
    /// The run folder
    run: PathBuf,
    /// FILE.gif for a film, FILE.png or FILE.svg for numbered pictures; without it, live in the terminal
    #[arg(long, value_name = "FILE")]
    out: Option<PathBuf>,
    /// Episodes to draw, one after the other
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = clap::value_parser!(u32).range(1..=1_000))]
    episodes: u32,
    #[command(flatten)]
    playing: Playing,
    /// Width of the pictures in pixels
    #[arg(long, value_name = "PIXELS", default_value_t = 420)]
    width: u32,
    /// Steps per second
    #[arg(long, value_name = "N", default_value_t = 5, value_parser = clap::value_parser!(u32).range(1..=50))]
    fps: u32,
}

impl Render {
    pub fn run(&self) -> Result<(), Failure> {
        process::start_logs(None);
        if let Some(extension) = self.out.as_ref().map(|out| out.extension().and_then(|e| e.to_str())) {
            if !matches!(extension, Some("gif" | "png" | "svg")) {
                let text = "`--out`: expected a name that ends with .gif, .png or .svg";
                return Err(Failure::new(exit::USAGE, text));
            }
        }
        let mut team = Team::open(&self.run)?;
        self.playing.prepare(&mut team)?;
        let delay = Duration::from_secs(1) / self.fps;
        let Some(out) = &self.out else { return self.live(&mut team, delay) };
        let mut frames = Vec::new();
        self.play(&mut team, |frame| {
            frames.push(frame);
            Ok(())
        })?;
        if out.extension().is_some_and(|e| e == "gif") {
            picture::write_gif(frames, self.width, delay, out).map_err(unusable)?;
            println!("{}", out.display());
            return Ok(());
        }
        for (number, frame) in (1..).zip(&frames) {
            picture::write_still(frame, self.width, &numbered(out, number)).map_err(unusable)?;
        }
        println!("{} to {}", numbered(out, 1).display(), numbered(out, frames.len()).display());
        Ok(())
    }

    fn live(&self, team: &mut Team, delay: Duration) -> Result<(), Failure> {
        let (rows, columns) = Term::stdout().size();
        let colours = Colours::of(std::env::var("COLORTERM").ok().as_deref());
        let mut terminal = Terminal::new(std::io::stdout().lock(), columns, rows, colours);
        // Dropping the terminal restores the cursor. A signal alone would prevent that.
        let stop = Arc::new(AtomicBool::new(false));
        for signal in process::stop_signals() {
            signal_hook::flag::register(signal, Arc::clone(&stop)).map_err(|e| Failure::new(exit::IO, e))?;
        }
        self.play(team, |frame| {
            if stop.load(Ordering::Relaxed) {
                return Err(Failure::new(exit::AGAIN, "stopped before the end of the episodes"));
            }
            terminal.show(&frame).map_err(unusable)?;
            sleep(if frame.outcome { delay * AT_THE_END } else { delay });
            Ok(())
        })
    }

    /// Plays the episodes, each from another seed, and shows every step.
    fn play(
        &self,
        team: &mut Team,
        mut show: impl FnMut(Frame) -> Result<(), Failure>,
    ) -> Result<(), Failure> {
        for episode in 1..=self.episodes {
            let seed = self.playing.seed.wrapping_add(u64::from(episode) - 1);
            team.play(1, seed, |worlds, actions| show(frame(worlds, actions, episode)))?;
        }
        Ok(())
    }
}

fn frame(worlds: &Copies, actions: &[Vec<u16>], episode: u32) -> Frame {
    let mut frame = Frame::new(worlds.scene(0));
    let played = worlds.played().next().expect("there is one copy");
    frame.lines =
        vec![format!("episode {episode}, t {}, return {:.2}", played.length, played.episode_return)];
    let taken: Vec<_> = actions.iter().filter_map(|of_agent| of_agent.first()).map(u16::to_string).collect();
    if !taken.is_empty() {
        frame.lines.push(format!("actions {}", taken.join(" ")));
    }
    frame.outcome = worlds.running() == 0;
    frame
}

/// `FILE-0001.png` of `FILE.png`.
fn numbered(out: &Path, number: usize) -> PathBuf {
    let mut name = out.file_stem().unwrap_or_default().to_owned();
    name.push(format!("-{number:04}."));
    name.push(out.extension().unwrap_or_default());
    out.with_file_name(name)
}

#[cfg(test)]
mod tests {
    use std::ffi::OsStr;
    use std::os::unix::ffi::OsStrExt;

    use super::*;

    #[test]
    fn pictures_are_numbered_before_their_extension() {
        assert_eq!(numbered(Path::new("a/film.png"), 7), Path::new("a/film-0007.png"));
        let [not_text, its_seventh] = [&b"a/caf\xe9.png"[..], b"a/caf\xe9-0007.png"].map(OsStr::from_bytes);
        assert_eq!(numbered(Path::new(not_text), 7), Path::new(its_seventh));
    }
}
