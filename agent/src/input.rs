//! The input of a network: the observation, and optionally the agent's last action and its index (algorithms §1.4).

use proto::config::Algo;
use proto::Observe;

/// `[observation | one-hot of the last action, zeros at t = 0 | one-hot of the agent's index]`; by default the
/// observation alone.
pub struct Input {
    obs_size: usize,
    n_actions: usize,
    last_action: bool,
    /// Own index and number of agents.
    id: Option<(usize, usize)>,
    /// The last action of each environment copy.
    last: Vec<Option<u16>>,
    rows: Vec<f32>,
}

impl Input {
    /// For agent `id` of `agents`, with `obs_size` and `n_actions`.
    pub fn new(algo: &Algo, (id, agents): (u32, u32), (obs_size, n_actions): (usize, usize)) -> Self {
        Self {
            obs_size,
            n_actions,
            last_action: algo.last_action_input,
            id: algo.agent_id_input.then_some((id as usize, agents as usize)),
            last: Vec::new(),
            rows: Vec::new(),
        }
    }

    /// Numbers in an input.
    pub fn size(&self) -> usize {
        let last = if self.last_action { self.n_actions } else { 0 };
        self.obs_size + last + self.id.map_or(0, |(_, agents)| agents)
    }

    /// Starts an episode in each of `copies` environment copies.
    pub fn begin_round(&mut self, copies: usize) {
        self.last.clear();
        self.last.resize(copies, None);
    }

    /// Stores the last action in a copy.
    pub fn acted(&mut self, copy: u16, action: u16) {
        self.last[usize::from(copy)] = Some(action);
    }

    /// The inputs of a tick's rows, `rows × size`.
    pub fn rows<'a>(&'a mut self, observe: &'a Observe) -> &'a [f32] {
        if !self.last_action && self.id.is_none() {
            return &observe.obs;
        }
        let size = self.size();
        self.rows.clear();
        self.rows.resize(observe.rows() * size, 0.0);
        for (k, row) in self.rows.chunks_exact_mut(size).enumerate() {
            let (obs, mut rest) = row.split_at_mut(self.obs_size);
            obs.copy_from_slice(observe.observation(k));
            if self.last_action {
                let (last, id) = rest.split_at_mut(self.n_actions);
                if let Some(action) = self.last[usize::from(observe.copies[k])] {
                    last[usize::from(action)] = 1.0;
                }
                rest = id;
            }
            if let Some((id, _)) = self.id {
                rest[id] = 1.0;
            }
        }
        &self.rows
    }
}

#[cfg(test)]
mod tests {
    use proto::config::AlgoName;
    use proto::presets::{algo_defaults, Family};
    use proto::End;

    use super::*;

    fn input(last_action: bool, id: bool) -> Input {
        let mut algo = algo_defaults(AlgoName::Ippo, Family::Lbf);
        (algo.last_action_input, algo.agent_id_input) = (last_action, id);
        let mut input = Input::new(&algo, (1, 3), (2, 4));
        input.begin_round(2);
        input
    }

    /// Copies 0 and 1, with observations of two numbers.
    fn tick() -> Observe {
        Observe {
            copies: vec![0, 1],
            ends: vec![End::Running; 2],
            rewards: vec![0.0; 2],
            obs_size: 2,
            n_actions: 4,
            obs: vec![0.5, -1.0, 2.0, 3.0],
            avail: vec![1; 8],
            ..Observe::default()
        }
    }

    #[test]
    fn by_default_the_network_sees_the_observation_alone() {
        let mut input = input(false, false);
        input.acted(1, 3);
        assert_eq!(input.size(), 2);
        assert_eq!(input.rows(&tick()), [0.5, -1.0, 2.0, 3.0]);
    }

    #[test]
    fn the_last_action_and_then_the_index_follow_the_observation() {
        let mut input = input(true, true);
        assert_eq!(input.size(), 2 + 4 + 3);
        let none = [0.0; 4];
        let index = [0.0, 1.0, 0.0];
        let expected =
            |last_of_1: [f32; 4]| [&[0.5, -1.0][..], &none, &index, &[2.0, 3.0], &last_of_1, &index].concat();
        assert_eq!(input.rows(&tick()), expected(none));
        input.acted(1, 3);
        assert_eq!(input.rows(&tick()), expected([0.0, 0.0, 0.0, 1.0]));
        input.begin_round(2);
        assert_eq!(input.rows(&tick()), expected(none));
    }
}
