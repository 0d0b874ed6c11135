//! The output during a run: a live display on a terminal, plain lines elsewhere.

use std::time::{Duration, Instant};

use console::Term;
use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use proto::config::Config;
use proto::control::Metrics;

use crate::summary::fact;

/// Time between plain lines without a new test result.
const BETWEEN_LINES: Duration = Duration::from_secs(10);

/// A terminal with fewer columns shows the progress only: the rest would take too many rows.
const NARROW: usize = 60;
/// Scalars of an agent that are shown in a separate part.
const SHOWN_APART: [&str; 2] = ["fast_agent", "lr"];

/// What to show during a run.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Show {
    /// A live display on a terminal that can be drawn on, plain lines elsewhere.
    Best,
    /// Plain lines with the name of the run.
    Lines,
    Nothing,
}

/// The state of a run, from its published scalars.
pub struct Display {
    t_max: u64,
    algo: String,
    rates: Vec<f64>,
    start: Instant,
    /// Environment steps at the first message, for the rate.
    first: Option<(u64, Instant)>,
    t_env: u64,
    test_return_mean: Option<f64>,
    /// What the world reports of the last test, by name.
    test_facts: Vec<(String, f64)>,
    scalars: Vec<Option<Metrics>>,
    bar: Option<ProgressBar>,
    show: Show,
    run: String,
    last_line: Option<Instant>,
}

impl Display {
    /// For a run with this configuration.
    pub fn new(config: &Config, show: Show) -> Self {
        let bar = (show == Show::Best).then(|| {
            // Hidden if nothing can be drawn: stderr is not a terminal, or TERM is `dumb` or not set.
            let bar =
                ProgressBar::with_draw_target(Some(config.t_max), ProgressDrawTarget::stderr_with_hz(8));
            let template = match columns() {
                0..NARROW => "{percent:>3} %\n{msg}",
                _ => "{prefix:.bold} {wide_bar} {percent:>3} %\n{msg}",
            };
            bar.set_style(
                ProgressStyle::with_template(template).unwrap_or_else(|_| ProgressStyle::default_bar()),
            );
            bar.set_prefix(format!("{} · {} · seed {}", config.world.task, config.algo.name, config.seed));
            bar
        });
        // A hidden bar shows nothing, so lines replace it.
        let bar = bar.filter(|bar| !bar.is_hidden());
        Self {
            t_max: config.t_max,
            algo: config.algo.name.to_string(),
            rates: config.schedule.rates.clone(),
            start: Instant::now(),
            first: None,
            t_env: 0,
            test_return_mean: None,
            test_facts: vec![],
            scalars: vec![None; config.world.agents as usize],
            bar,
            show,
            run: config.run.clone(),
            last_line: None,
        }
    }

    /// Adds scalars of the env-server (no agent) or of one agent.
    pub fn hear(&mut self, agent: Option<u32>, metrics: &Metrics) {
        let mut new_test = false;
        match agent {
            Some(agent) => {
                if let Some(place) = self.scalars.get_mut(agent as usize) {
                    *place = Some(metrics.clone());
                }
            }
            None => {
                self.t_env = metrics.t_env;
                self.first.get_or_insert((metrics.t_env, Instant::now()));
                let test = find(metrics, "test_return_mean");
                new_test = test.is_some() && test != self.test_return_mean;
                self.test_return_mean = test.or(self.test_return_mean);
                let facts = metrics.scalars.iter().filter(|(name, _)| name != "test_return_mean");
                self.test_facts = facts.cloned().collect();
            }
        }
        match &self.bar {
            Some(bar) => {
                bar.set_position(self.t_env.min(self.t_max));
                bar.set_message(self.drawn());
            }
            None if self.show == Show::Nothing => {}
            None => {
                if new_test || self.last_line.is_none_or(|last| last.elapsed() >= BETWEEN_LINES) {
                    self.last_line = Some(Instant::now());
                    let run =
                        if self.show == Show::Lines { format!("{}: ", self.run) } else { String::new() };
                    eprintln!("{run}{}", self.parts().join(SEPARATOR));
                }
            }
        }
    }

    /// Redraws the clock.
    pub fn refresh(&self) {
        if let Some(bar) = &self.bar {
            bar.set_message(self.drawn());
        }
    }

    /// Prints a line for the user.
    pub fn say(&self, text: &str) {
        match &self.bar {
            Some(bar) => bar.println(text),
            None => eprintln!("{text}"),
        }
    }

    /// Removes the live display.
    pub fn finish(&self) {
        if let Some(bar) = &self.bar {
            bar.finish_and_clear();
        }
    }

    /// The text of the live display, as much as the terminal has room for.
    fn drawn(&self) -> String {
        let (columns, mut parts) = (columns(), self.parts());
        if columns < NARROW {
            parts.truncate(PROGRESS);
        }
        wrapped(&parts, columns)
    }

    /// The parts to show: [`PROGRESS`] parts about the progress, then the learners' scalars.
    fn parts(&self) -> Vec<String> {
        let rate = self.first.map_or(0.0, |(t, since)| {
            (self.t_env - t.min(self.t_env)) as f64 / since.elapsed().as_secs_f64().max(1e-3)
        });
        let left = if rate > 0.0 {
            duration((self.t_max.saturating_sub(self.t_env)) as f64 / rate)
        } else {
            "?".to_owned()
        };
        let test = self.test_return_mean.map_or("–".to_owned(), |mean| format!("{mean:.3}"));
        let mut parts = vec![
            format!("{} of {} steps", thousands(self.t_env), thousands(self.t_max)),
            format!("{rate:.0}/s"),
            format!("{left} left"),
            format!("{} so far", duration(self.start.elapsed().as_secs_f64())),
            format!("test return {test}"),
            self.algo.clone(),
        ];
        parts.extend(self.test_facts.iter().map(|(name, mean)| format!("{} {}", fact(name), short(*mean))));
        parts
            .extend(self.learned().map(|(name, mean)| format!("{} {}", name.replace('_', " "), short(mean))));
        let fast = self.scalars.iter().flatten().next().and_then(|m| find(m, "fast_agent"));
        parts.extend(fast.map(|agent| format!("fast agent {agent:.0}")));
        let rates: Vec<String> = self.rates.iter().map(|rate| format!("{rate:e}")).collect();
        parts.push(format!("rates {}", rates.join(" / ")));
        parts
    }

    /// Every scalar that the learners publish, with its mean over the agents.
    fn learned(&self) -> impl Iterator<Item = (&str, f64)> {
        let mut names: Vec<&str> = Vec::new();
        for (name, _) in self.scalars.iter().flatten().flat_map(|metrics| &metrics.scalars) {
            if !SHOWN_APART.contains(&name.as_str()) && !names.contains(&name.as_str()) {
                names.push(name);
            }
        }
        names.into_iter().map(|name| {
            let values: Vec<f64> = self.scalars.iter().flatten().filter_map(|m| find(m, name)).collect();
            (name, values.iter().sum::<f64>() / values.len() as f64)
        })
    }
}

/// Number of parts about the progress.
const PROGRESS: usize = 5;
const SEPARATOR: &str = " · ";

/// Columns of the terminal.
fn columns() -> usize {
    usize::from(Term::stderr().size().1)
}

/// Parts on lines of at most `columns` letters; a longer part has a separate line.
fn wrapped(parts: &[String], columns: usize) -> String {
    let (mut text, mut used) = (String::new(), 0);
    for part in parts {
        let length = part.chars().count();
        if used > 0 && used + SEPARATOR.chars().count() + length > columns {
            text.push('\n');
            used = 0;
        } else if used > 0 {
            text.push_str(SEPARATOR);
            used += SEPARATOR.chars().count();
        }
        text.push_str(part);
        used += length;
    }
    text
}

/// A number in a few letters.
fn short(value: f64) -> String {
    if value != 0.0 && !(1e-3..1e6).contains(&value.abs()) {
        format!("{value:.2e}")
    } else {
        format!("{value:.4}")
    }
}

fn find(metrics: &Metrics, name: &str) -> Option<f64> {
    metrics.scalars.iter().find(|(n, _)| n == name).map(|(_, value)| *value)
}

/// `1234567` as `1,234,567`.
pub fn thousands(n: u64) -> String {
    let digits = n.to_string();
    let mut out = String::new();
    for (i, digit) in digits.chars().enumerate() {
        if i > 0 && (digits.len() - i).is_multiple_of(3) {
            out.push(',');
        }
        out.push(digit);
    }
    out
}

fn duration(seconds: f64) -> String {
    let s = seconds.round() as u64;
    match (s / 3600, s / 60 % 60, s % 60) {
        (0, 0, s) => format!("{s} s"),
        (0, m, s) => format!("{m} min {s:02} s"),
        (h, m, _) => format!("{h} h {m:02} min"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn display(agents: usize) -> Display {
        Display {
            t_max: 2_000,
            algo: "mtql".to_owned(),
            rates: vec![6e-4, 2e-4],
            start: Instant::now(),
            first: None,
            t_env: 0,
            test_return_mean: None,
            test_facts: vec![],
            scalars: vec![None; agents],
            bar: None,
            show: Show::Nothing,
            run: "r".to_owned(),
            last_line: None,
        }
    }

    fn metrics(scalars: &[(&str, f64)]) -> Metrics {
        let scalars = scalars.iter().map(|&(name, value)| (name.to_owned(), value)).collect();
        Metrics { t_env: 1_000, update_calls: 3, scalars }
    }

    #[test]
    fn whatever_a_learner_publishes_is_shown_as_the_mean_over_the_agents() {
        let mut display = display(2);
        display.hear(None, &metrics(&[("test_return_mean", 0.25)]));
        display.hear(
            Some(0),
            &metrics(&[("loss", 1.0), ("q_taken_mean", 3e-5), ("lr", 6e-4), ("fast_agent", 0.0)]),
        );
        display
            .hear(Some(1), &metrics(&[("loss", 2.0), ("epsilon", 0.5), ("lr", 2e-4), ("fast_agent", 0.0)]));
        let parts = display.parts();
        assert_eq!((&*parts[0], &*parts[4]), ("1,000 of 2,000 steps", "test return 0.250"));
        let expected = [
            "mtql",
            "loss 1.5000",
            "q taken mean 3.00e-5",
            "epsilon 0.5000",
            "fast agent 0",
            "rates 6e-4 / 2e-4",
        ];
        assert_eq!(parts[PROGRESS..], expected);
    }

    #[test]
    fn nothing_stands_for_scalars_that_nobody_has_published() {
        assert_eq!(display(1).parts()[PROGRESS..], ["mtql", "rates 6e-4 / 2e-4"]);
    }

    #[test]
    fn parts_are_wrapped_whole() {
        let parts = ["1,000 of 2,000 steps", "20/s", "1 s left"].map(str::to_owned);
        assert_eq!(wrapped(&parts, 80), "1,000 of 2,000 steps · 20/s · 1 s left");
        assert_eq!(wrapped(&parts, 27), "1,000 of 2,000 steps · 20/s\n1 s left");
        assert_eq!(wrapped(&parts, 10), "1,000 of 2,000 steps\n20/s\n1 s left");
    }

    #[test]
    fn numbers_and_durations_read_well() {
        assert_eq!([0, 999, 1000, 20_000_000].map(thousands), ["0", "999", "1,000", "20,000,000"]);
        assert_eq!([5.4, 65.0, 7260.0].map(duration), ["5 s", "1 min 05 s", "2 h 01 min"]);
    }
}
