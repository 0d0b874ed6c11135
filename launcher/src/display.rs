//! What a person sees while a run goes on: one live display on a terminal, plain lines elsewhere.

use std::io::IsTerminal;
use std::time::{Duration, Instant};

use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use proto::config::Config;
use proto::control::Metrics;

/// Between plain lines, when there is no new test result.
const BETWEEN_LINES: Duration = Duration::from_secs(10);

/// How much to show while a run goes on.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Show {
    /// A live display on a terminal, plain lines elsewhere.
    Best,
    /// Plain lines with the name of the run.
    Lines,
    Nothing,
}

/// The state of a run as far as it can be seen.
pub struct Display {
    t_max: u64,
    algo: String,
    rates: Vec<f64>,
    start: Instant,
    /// Environment steps when this process began to look, for the rate.
    first: Option<(u64, Instant)>,
    t_env: u64,
    test_return_mean: Option<f64>,
    scalars: Vec<Option<Metrics>>,
    bar: Option<ProgressBar>,
    show: Show,
    run: String,
    last_line: Option<Instant>,
}

impl Display {
    /// For a run with this configuration.
    pub fn new(config: &Config, show: Show) -> Self {
        let live = show == Show::Best && std::io::stderr().is_terminal();
        let bar = live.then(|| {
            let bar =
                ProgressBar::with_draw_target(Some(config.t_max), ProgressDrawTarget::stderr_with_hz(8));
            let template = "{prefix:.bold} {wide_bar} {percent:>3} %\n{msg}";
            bar.set_style(
                ProgressStyle::with_template(template).unwrap_or_else(|_| ProgressStyle::default_bar()),
            );
            bar.set_prefix(format!("{} · {} · seed {}", config.world.task, config.algo.name, config.seed));
            bar
        });
        Self {
            t_max: config.t_max,
            algo: config.algo.name.to_string(),
            rates: config.schedule.rates.clone(),
            start: Instant::now(),
            first: None,
            t_env: 0,
            test_return_mean: None,
            scalars: vec![None; config.world.agents as usize],
            bar,
            show,
            run: config.run.clone(),
            last_line: None,
        }
    }

    /// Takes in scalars of the env-server (no agent) or of one agent.
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
            }
        }
        match &self.bar {
            Some(bar) => {
                bar.set_position(self.t_env.min(self.t_max));
                bar.set_message(self.text());
            }
            None if self.show == Show::Nothing => {}
            None => {
                if new_test || self.last_line.is_none_or(|last| last.elapsed() >= BETWEEN_LINES) {
                    self.last_line = Some(Instant::now());
                    let run =
                        if self.show == Show::Lines { format!("{}: ", self.run) } else { String::new() };
                    eprintln!("{run}{}", self.text().replace('\n', " · "));
                }
            }
        }
    }

    /// Redraws the clock.
    pub fn refresh(&self) {
        if let Some(bar) = &self.bar {
            bar.set_message(self.text());
        }
    }

    /// A line for the person who watches.
    pub fn say(&self, text: &str) {
        match &self.bar {
            Some(bar) => bar.println(text),
            None => eprintln!("{text}"),
        }
    }

    /// Takes the live display away.
    pub fn finish(&self) {
        if let Some(bar) = &self.bar {
            bar.finish_and_clear();
        }
    }

    fn text(&self) -> String {
        let rate = self.first.map_or(0.0, |(t, since)| {
            (self.t_env - t.min(self.t_env)) as f64 / since.elapsed().as_secs_f64().max(1e-3)
        });
        let left = if rate > 0.0 {
            duration((self.t_max.saturating_sub(self.t_env)) as f64 / rate)
        } else {
            "?".to_owned()
        };
        let test = self.test_return_mean.map_or("–".to_owned(), |mean| format!("{mean:.3}"));
        let mean = |name: &str| {
            let values: Vec<f64> = self.scalars.iter().flatten().filter_map(|m| find(m, name)).collect();
            match values.len() {
                0 => "–".to_owned(),
                n => format!("{:.4}", values.iter().sum::<f64>() / n as f64),
            }
        };
        let fast = self.scalars.iter().flatten().next().and_then(|m| find(m, "fast_agent"));
        let fast = fast.map_or("–".to_owned(), |agent| format!("{agent:.0}"));
        let rates: Vec<String> = self.rates.iter().map(|rate| format!("{rate:e}")).collect();
        format!(
            "{} of {} steps · {:.0}/s · {} left · {} so far · test return {test}\n\
             {} · actor loss {} · critic loss {} · entropy {} · fast agent {fast} · rates {}",
            thousands(self.t_env),
            thousands(self.t_max),
            rate,
            left,
            duration(self.start.elapsed().as_secs_f64()),
            self.algo,
            mean("actor_loss"),
            mean("critic_loss"),
            mean("entropy"),
            rates.join(" / "),
        )
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

    #[test]
    fn numbers_and_durations_read_well() {
        assert_eq!([0, 999, 1000, 20_000_000].map(thousands), ["0", "999", "1,000", "20,000,000"]);
        assert_eq!([5.4, 65.0, 7260.0].map(duration), ["5 s", "1 min 05 s", "2 h 01 min"]);
    }
}
