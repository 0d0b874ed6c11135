//! Converts between worlds and messages: environment copies on one side, one [`Observe`] per agent on the other.

use envs::scene::Scene;
use envs::{Sizes, Task, World};
use process::Failure;
use proto::config::Reward;
use proto::exit;
use proto::stream::stream;
use proto::{End, Observe};
use rand_chacha::ChaCha8Rng;

/// One environment copy and the episode it is in.
struct Copy {
    world: Box<dyn World>,
    rng: ChaCha8Rng,
    end: End,
    /// Each agent's own reward for the last step.
    rewards: Vec<f64>,
    /// Each agent's own undiscounted sum of rewards.
    returns: Vec<f64>,
    /// The undiscounted sum of the team's rewards.
    episode_return: f64,
    length: u64,
    /// How the last finished episode went, in the world's own words.
    facts: Vec<(&'static str, f64)>,
}

/// A finished episode.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Played<'a> {
    /// Undiscounted sum of the team's rewards; of their mean with `world.reward = mean`.
    pub episode_return: f64,
    /// Each agent's own.
    pub returns: &'a [f64],
    /// Steps taken.
    pub length: u64,
    /// How it went, in the world's own words.
    pub facts: &'a [(&'static str, f64)],
}

/// The environment copies of one mode, training or test.
pub struct Copies {
    copies: Vec<Copy>,
    /// Copies that were running before the last step: the rows of the next message.
    rows: Vec<u16>,
    sizes: Sizes,
    reward: Reward,
    /// All agents are given one reward: it is the team's.
    is_shared: bool,
    actions: Vec<u16>,
}

impl Copies {
    /// `count` copies of a task, whose agents learn from `reward`.
    pub fn of(task: &Task, count: u32, reward: Reward) -> Self {
        let sizes = task.sizes().clone();
        let copy = || Copy {
            world: task.make(),
            rng: stream(0, "world", "unused", &[]),
            end: End::Running,
            rewards: vec![0.0; sizes.agents],
            returns: vec![0.0; sizes.agents],
            episode_return: 0.0,
            length: 0,
            facts: vec![],
        };
        Self {
            copies: (0..count).map(|_| copy()).collect(),
            rows: Vec::new(),
            actions: vec![0; sizes.agents],
            reward,
            is_shared: task.make().shares_reward(),
            sizes,
        }
    }

    /// Starts an episode in every copy. The random stream of copy `k` follows from seed, purpose, round and `k`.
    pub fn reset(&mut self, seed: u64, purpose: &str, round: u64) {
        for (k, copy) in self.copies.iter_mut().enumerate() {
            copy.rng = stream(seed, "world", purpose, &[round, k as u64]);
            copy.world.reset(&mut copy.rng);
            copy.rewards.fill(0.0);
            copy.returns.fill(0.0);
            (copy.end, copy.episode_return, copy.length) = (End::Running, 0.0, 0);
        }
        self.rows.clear();
        self.rows.extend(0..self.copies.len() as u16);
    }

    /// Writes the rows of a tick for one agent.
    pub fn show(&self, agent: usize, to: &mut Observe) {
        let (obs_size, n_actions) = (self.sizes.obs_size[agent], self.sizes.n_actions[agent]);
        (to.obs_size, to.n_actions) = (obs_size, n_actions);
        to.copies.clone_from(&self.rows);
        to.ends.clear();
        to.rewards.clear();
        to.obs.resize(self.rows.len() * obs_size, 0.0);
        to.avail.resize(self.rows.len() * n_actions, 0);
        let places = to.obs.chunks_exact_mut(obs_size).zip(to.avail.chunks_exact_mut(n_actions));
        for (&row, (obs, avail)) in self.rows.iter().zip(places) {
            let copy = &self.copies[usize::from(row)];
            to.ends.push(copy.end);
            to.rewards.push(self.reward_of(agent, &copy.rewards) as f32);
            copy.world.observe(agent, obs);
            copy.world.available(agent, avail);
        }
    }

    /// Rows of the present tick that need an action.
    pub fn running(&self) -> usize {
        self.rows.iter().filter(|&&row| self.copies[usize::from(row)].end == End::Running).count()
    }

    /// Checks that each action is available in its row. The error is the first that is not, as (row, action).
    pub fn check(&self, agent: usize, actions: &[u16]) -> Result<(), (u16, u16)> {
        let mut avail = vec![0; self.sizes.n_actions[agent]];
        let running = self.rows.iter().filter(|&&row| self.copies[usize::from(row)].end == End::Running);
        for (&row, &action) in running.zip(actions) {
            self.copies[usize::from(row)].world.available(agent, &mut avail);
            if avail.get(usize::from(action)) != Some(&1) {
                return Err((row, action));
            }
        }
        Ok(())
    }

    /// Lets the worlds precompute parts of the next step while the agents choose actions.
    pub fn think_ahead(&mut self) {
        for &row in &self.rows {
            let copy = &mut self.copies[usize::from(row)];
            if copy.end == End::Running {
                copy.world.think_ahead();
            }
        }
    }

    /// Plays one joint action in every running copy; `actions[agent]` has one for each, in their order.
    pub fn step(&mut self, actions: &[Vec<u16>]) {
        self.rows.retain(|&row| self.copies[usize::from(row)].end == End::Running);
        for (k, &row) in self.rows.iter().enumerate() {
            for (joint, of_agent) in self.actions.iter_mut().zip(actions) {
                *joint = of_agent[k];
            }
            let copy = &mut self.copies[usize::from(row)];
            copy.end = match copy.world.step(&self.actions, &mut copy.rng, &mut copy.rewards) {
                envs::End::Running => End::Running,
                envs::End::Terminated => End::Terminated,
                envs::End::TimeLimit => End::TimeLimit,
            };
            copy.episode_return += match self.reward {
                _ if self.is_shared => copy.rewards[0],
                Reward::Mean => mean(&copy.rewards),
                Reward::Sum | Reward::Individual => copy.rewards.iter().sum(),
            };
            for (sum, reward) in copy.returns.iter_mut().zip(&copy.rewards) {
                *sum += reward;
            }
            copy.length += 1;
            if copy.end != End::Running {
                copy.facts.clear();
                copy.world.facts(&mut |name, value| copy.facts.push((name, value)));
            }
        }
    }

    /// The reward that an agent learns from (algorithms §2.5), from all agents' own rewards.
    fn reward_of(&self, agent: usize, rewards: &[f64]) -> f64 {
        match self.reward {
            _ if self.is_shared => rewards[agent],
            Reward::Sum => rewards.iter().sum(),
            Reward::Mean => mean(rewards),
            Reward::Individual => rewards[agent],
        }
    }

    /// The picture of a copy.
    pub fn scene(&self, copy: usize) -> Scene {
        self.copies[copy].world.scene()
    }

    /// The episodes just played, by copy.
    pub fn played(&self) -> impl Iterator<Item = Played<'_>> + '_ {
        self.copies.iter().map(|copy| Played {
            episode_return: copy.episode_return,
            returns: &copy.returns,
            length: copy.length,
            facts: &copy.facts,
        })
    }
}

fn mean(rewards: &[f64]) -> f64 {
    rewards.iter().sum::<f64>() / rewards.len() as f64
}

/// Checks that a world's rewards and observations are finite: an agent drops a message with other numbers, and the
/// round would never end.
///
/// # Errors
/// Names the number and its place. The same seed gives it again, so this is [`exit::CONFIG`].
pub fn check_numbers(agent: usize, observe: &Observe) -> Result<(), Failure> {
    let bad = |numbers: &[f32]| numbers.iter().position(|number| !number.is_finite());
    let (row, what) = if let Some(row) = bad(&observe.rewards) {
        (row, format!("the reward {}", observe.rewards[row]))
    } else if let Some(at) = bad(&observe.obs) {
        let (row, place) = (at / observe.obs_size, at % observe.obs_size);
        (row, format!("an observation with {} in place {place}", observe.obs[at]))
    } else {
        return Ok(());
    };
    let text = format!(
        "the world gives agent {agent} {what}, in copy {} at {}: expected a finite number that fits 32 bits\n\
         hint: correct the world, then start a new run; the last checkpoint stays, but resuming computes the same numbers",
        observe.copies[row],
        observe.id()
    );
    Err(Failure::new(exit::CONFIG, text))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_message_has_the_copies_that_were_running_and_their_reward() {
        let task = envs::task("lbf-5x5-2p-1f").expect("a task");
        let mut copies = Copies::of(&task, 3, Reward::Sum);
        copies.reset(1, "episode", 0);
        let mut observe = Observe::default();
        copies.show(1, &mut observe);
        assert_eq!((observe.rows(), observe.obs_size, observe.n_actions), (3, 9, 6));
        assert_eq!((observe.rewards.as_slice(), copies.running()), ([0.0; 3].as_slice(), 3));
        let mut ticks = 0;
        while copies.running() > 0 {
            let actions = vec![vec![(ticks % 6) as u16; copies.running()]; 2];
            copies.step(&actions);
            copies.show(0, &mut observe);
            ticks += 1;
            assert!(observe.rows() >= copies.running());
        }
        let played: Vec<_> = copies.played().collect();
        assert_eq!(played.iter().map(|p| p.length).max(), Some(ticks));
        assert!(ticks <= 50);
    }

    #[test]
    fn the_same_seed_and_round_give_the_same_episodes_and_tests_are_others() {
        let task = envs::task("lbf-8x8-2p-2f-coop").expect("a task");
        let starts = |seed, purpose, round| {
            let mut copies = Copies::of(&task, 4, Reward::Sum);
            copies.reset(seed, purpose, round);
            let mut observe = Observe::default();
            copies.show(0, &mut observe);
            observe.obs
        };
        let first = starts(1, "episode", 0);
        assert_eq!(first, starts(1, "episode", 0));
        for other in [starts(2, "episode", 0), starts(1, "episode", 1), starts(1, "test-episode", 0)] {
            assert_ne!(first, other);
        }
    }

    #[test]
    fn a_reward_that_the_team_shares_is_not_added_up() {
        let task = envs::task("smaclite-3m").expect("a task");
        for reward in Reward::ALL {
            let mut copies = Copies::of(&task, 1, reward);
            copies.reset(1, "episode", 0);
            let mut observe = Observe::default();
            let mut earned = 0.0;
            while copies.running() > 0 {
                // Whoever can shoots, all others wait.
                let action = |agent: usize| {
                    let first_shot = (6..9).find(|&shot| copies.check(agent, &[shot]).is_ok());
                    first_shot.unwrap_or(if copies.check(agent, &[1]).is_ok() { 1 } else { 0 })
                };
                let actions: Vec<Vec<u16>> = (0..3).map(|agent| vec![action(agent)]).collect();
                copies.step(&actions);
                copies.show(2, &mut observe);
                earned += f64::from(observe.rewards[0]);
            }
            let played = copies.played().next().expect("one copy");
            assert!(earned > 1.0 && earned < 20.0, "{earned}");
            assert!((played.episode_return - earned).abs() < 1e-4, "{reward:?}: {played:?}, not {earned}");
            assert!((played.returns[1] - earned).abs() < 1e-4);
            let names = played.facts.iter().map(|(name, _)| *name);
            assert!(names.eq(["battle_won", "allies_left", "enemies_left", "damage_dealt", "damage_taken"]));
            assert_eq!(played.facts[4].1, 3.0 * 45.0, "all three marines died");
        }
    }

    #[test]
    fn an_action_that_does_not_exist_is_found() {
        let task = envs::task("lbf-5x5-2p-1f").expect("a task");
        let mut copies = Copies::of(&task, 2, Reward::Sum);
        copies.reset(1, "episode", 0);
        assert_eq!(copies.check(0, &[0, 5]), Ok(()));
        assert_eq!(copies.check(0, &[0, 6]), Err((1, 6)));
    }

    #[test]
    fn a_number_that_is_none_is_named_with_the_agent_and_where_it_came_up() {
        let task = envs::task("lbf-5x5-2p-1f").expect("a task");
        let mut copies = Copies::of(&task, 2, Reward::Sum);
        copies.reset(1, "episode", 0);
        let mut shown = Observe::default();
        copies.show(1, &mut shown);
        let check = |change: &dyn Fn(&mut Observe)| {
            let mut observe = shown.clone();
            change(&mut observe);
            check_numbers(1, &observe).map_err(|failure| (failure.code, failure.message))
        };
        assert_eq!(check(&|_| ()), Ok(()));
        for bad in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY] {
            let (code, text) = check(&|observe| observe.rewards[1] = bad).unwrap_err();
            assert!(
                text.starts_with(&format!("the world gives agent 1 the reward {bad}, in copy 1 at ")),
                "{text}"
            );
            assert_eq!(code, exit::CONFIG);
            let (_, text) = check(&|observe| observe.obs[11] = bad).unwrap_err();
            assert!(text.contains(&format!("an observation with {bad} in place 2, in copy 1 at ")), "{text}");
        }
    }
}
