//! Checks of a configuration that its types cannot express; all mistakes are reported together.

use super::limits::{
    MAX_AGENTS, MAX_BUFFER, MAX_COPIES, MAX_EPOCHS, MAX_HIDDEN, MAX_LEVELS, MAX_MAP, MAX_OPPONENT,
    MAX_TASK_NAME, MAX_TEST_EPISODES,
};
use super::{
    Algo, AlgoName, ClipScope, Config, ConfigError, Learner, Period, Ppo, QLearning, Schedule, SwitchUnit,
    Timescales, World,
};
use crate::keys::check_run_name;
use std::fmt::Display;

impl Config {
    /// Checks that a run can use this configuration.
    ///
    /// # Errors
    /// [`ConfigError::Invalid`] with every mistake, not only the first.
    pub fn validate(&self) -> Result<(), ConfigError> {
        let mut mistakes = Mistakes(Vec::new());
        if let Err(error) = check_run_name(&self.run) {
            mistakes.add(format!("`run`: {error}"));
        }
        mistakes.at_least_one("t_max", self.t_max);
        self.world.judge(&mut mistakes);
        self.algo.judge(&mut mistakes);
        self.judge_learner(&mut mistakes);
        self.schedule.judge(self.world.agents, self.algo.name, &mut mistakes);
        self.judge_period(&mut mistakes);
        mistakes.at_least_one("test.interval", self.test.interval);
        mistakes.within("test.episodes", self.test.episodes, MAX_TEST_EPISODES);
        mistakes.at_least_one("save.interval", self.save.interval);
        mistakes.at_least_one("log.interval", self.log.interval);
        mistakes.into_result()
    }

    /// Rates change between update calls. A period that ends inside one would give some agents more turns than others.
    fn judge_period(&self, mistakes: &mut Mistakes) {
        let (Some(ppo), Period::Every(steps)) = (&self.ppo, self.schedule.switch_period) else { return };
        let epochs = u64::from(ppo.epochs);
        let by_steps = self.schedule.switch_unit == SwitchUnit::GradientStep;
        if by_steps && epochs > 0 && !steps.is_multiple_of(epochs) {
            mistakes.add(format!(
                "`schedule.switch_period` is {steps} gradient steps: expected a multiple of `ppo.epochs` = {epochs}, \
                 because rates change between update calls only; take another period, or \
                 `schedule.switch_unit` = `update_call`"
            ));
        }
    }

    /// Exactly the section of the algorithm's learner must be present: keys of another one would be ignored.
    fn judge_learner(&self, mistakes: &mut Mistakes) {
        let name = self.algo.name;
        let (expected, other) = match name.learner() {
            Learner::Ppo => ("ppo", "q"),
            Learner::Q => ("q", "ppo"),
        };
        let there = |section| if section == "ppo" { self.ppo.is_some() } else { self.q.is_some() };
        if !there(expected) {
            mistakes.add(format!("`{expected}` is missing: `algo.name` = `{name}` needs that section"));
        }
        if there(other) {
            mistakes.add(format!("`{other}` has no meaning for `algo.name` = `{name}`: remove that section"));
        }
        if let Some(ppo) = &self.ppo {
            ppo.judge(mistakes);
        }
        if let Some(q) = &self.q {
            q.judge(mistakes);
        }
    }
}

impl World {
    fn judge(&self, mistakes: &mut Mistakes) {
        if self.task.is_empty() || self.task.len() > MAX_TASK_NAME || self.task.chars().any(char::is_control)
        {
            mistakes.add(format!("`world.task`: expected a name of 1 to {MAX_TASK_NAME} printable bytes"));
        }
        if self.map.as_ref().is_some_and(|map| map.is_empty() || map.len() > MAX_MAP) {
            mistakes.add(format!("`world.map`: expected the text of a map, 1 to {MAX_MAP} bytes"));
        }
        mistakes.within("world.agents", self.agents, MAX_AGENTS);
        mistakes.within("world.copies", self.copies, MAX_COPIES);
        if self.opponent.is_empty() || self.opponent.len() > MAX_OPPONENT {
            mistakes.add("`world.opponent`: expected `builtin`, `random`, `still` or the digest of a file");
        }
    }
}

impl Algo {
    fn judge(&self, mistakes: &mut Mistakes) {
        mistakes.within("algo.hidden", self.hidden, MAX_HIDDEN);
        let share = (0.0..=1.0).contains(&self.gamma);
        mistakes.expect(share, "algo.gamma", self.gamma, "a number from 0 to 1");
        let rule =
            positive(self.target_update) && (self.target_update <= 1.0 || self.target_update.fract() == 0.0);
        mistakes.expect(
            rule,
            "algo.target_update",
            self.target_update,
            "a whole number of update calls above 1, or a Polyak factor above 0 and up to 1",
        );
        mistakes.expect(
            positive(self.max_grad_norm),
            "algo.max_grad_norm",
            self.max_grad_norm,
            "a number above 0",
        );
        mistakes.expect(
            self.clip_scope == ClipScope::PerAgent,
            "algo.clip_scope",
            "`joint`",
            "`per_agent`, because agents in processes of their own cannot share a gradient norm",
        );
    }
}

impl Ppo {
    fn judge(&self, mistakes: &mut Mistakes) {
        mistakes.within("ppo.epochs", self.epochs, MAX_EPOCHS);
        mistakes.expect(positive(self.clip), "ppo.clip", self.clip, "a number above 0");
        let no_penalty = self.entropy_coef.is_finite() && self.entropy_coef >= 0.0;
        mistakes.expect(no_penalty, "ppo.entropy_coef", self.entropy_coef, "a number from 0");
        mistakes.at_least_one("ppo.n_step", u64::from(self.n_step));
    }
}

impl QLearning {
    fn judge(&self, mistakes: &mut Mistakes) {
        mistakes.within("q.buffer", self.buffer, MAX_BUFFER);
        mistakes.within("q.batch", self.batch, self.buffer.max(1));
        for (key, epsilon) in [
            ("q.epsilon_start", self.epsilon_start),
            ("q.epsilon_finish", self.epsilon_finish),
            ("q.test_epsilon", self.test_epsilon),
        ] {
            mistakes.expect((0.0..=1.0).contains(&epsilon), key, epsilon, "a number from 0 to 1");
        }
        let falls = self.epsilon_finish <= self.epsilon_start || self.epsilon_start.is_nan();
        mistakes.expect(falls, "q.epsilon_finish", self.epsilon_finish, "at most `q.epsilon_start`");
    }
}

fn positive(x: f64) -> bool {
    x.is_finite() && x > 0.0
}

impl Schedule {
    fn judge(&self, agents: u32, name: AlgoName, mistakes: &mut Mistakes) {
        if self.rates.is_empty() {
            mistakes.add("`schedule.rates` is empty: expected a learning rate for each level");
        }
        for (level, &rate) in self.rates.iter().enumerate() {
            let key = format!("schedule.rates[{level}]");
            mistakes.expect((0.0..=1.0).contains(&rate), &key, rate, "a number from 0 to 1");
        }
        self.judge_levels(agents, mistakes);
        self.judge_name(name, mistakes);
        if self.rates.len() > MAX_LEVELS {
            let found = self.rates.len();
            mistakes.add(format!("`schedule.rates` has {found} levels: expected at most {MAX_LEVELS}"));
        }
        if self.switch_period == Period::Every(0) {
            mistakes.add("`schedule.switch_period` is 0: expected a whole number from 1, or \"inf\"");
        }
    }

    fn judge_levels(&self, agents: u32, mistakes: &mut Mistakes) {
        if self.levels.len() != agents as usize {
            mistakes.add(format!(
                "`schedule.levels` has {} entries: expected one for each of the {agents} agents",
                self.levels.len()
            ));
        }
        let known = self.rates.len();
        if let Some(level) = self.levels.iter().find(|&&level| level as usize >= known) {
            mistakes.add(format!(
                "`schedule.levels` names level {level}: `schedule.rates` has {known} levels, from 0"
            ));
        }
        for level in (0..known).filter(|&level| !self.levels.iter().any(|&used| used as usize == level)) {
            mistakes.add(format!("`schedule.rates[{level}]` is used by no agent: give it one, or remove it"));
        }
    }

    /// A result must not be published under the name of another algorithm.
    fn judge_name(&self, name: AlgoName, mistakes: &mut Mistakes) {
        let others = self.rates.get(1..).unwrap_or_default();
        let mt = match name.learner() {
            Learner::Ppo => AlgoName::Mtppo,
            Learner::Q => AlgoName::Mtql,
        };
        let (agree, expected) = match name.timescales() {
            Timescales::Many => (true, ""),
            Timescales::One => (self.rates.windows(2).all(|pair| pair[0] == pair[1]), "equal rates"),
            Timescales::OneAtATime => (
                self.rates.first() != Some(&0.0) && others.iter().all(|&rate| rate == 0.0),
                "a first rate above 0 and zero for the others",
            ),
        };
        if !agree {
            mistakes.add(format!(
                "`schedule.rates` with `algo.name` = `{name}`: expected {expected}; for \
                 other rates use `{mt}`"
            ));
        }
    }
}

struct Mistakes(Vec<String>);

impl Mistakes {
    fn add(&mut self, mistake: impl Into<String>) {
        self.0.push(mistake.into());
    }

    fn expect(&mut self, holds: bool, key: &str, found: impl Display, expected: &str) {
        if !holds {
            self.add(format!("`{key}` is {found}: expected {expected}"));
        }
    }

    fn within(&mut self, key: &str, value: u32, most: u32) {
        self.expect((1..=most).contains(&value), key, value, &format!("a number from 1 to {most}"));
    }

    fn at_least_one(&mut self, key: &str, value: u64) {
        self.expect(value > 0, key, value, "a number from 1");
    }

    fn into_result(self) -> Result<(), ConfigError> {
        if self.0.is_empty() {
            Ok(())
        } else {
            Err(ConfigError::Invalid(self.0))
        }
    }
}

#[cfg(test)]
mod tests;
