//! The episodes of one round, as one agent saw them.

/// Whether and how an episode has ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub enum End {
    /// It has not.
    #[default]
    Running,
    /// The world ended it.
    Terminated,
    /// The step limit ended it.
    TimeLimit,
}

/// One episode of `L` actions.
#[derive(Clone, Debug, Default)]
pub struct Episode {
    /// `(L + 1) × inputs`, the final one included: observations, with the additional inputs of algorithms §1.4 if
    /// configured.
    pub obs: Vec<f32>,
    /// `(L + 1) × n_actions`, 1 where the action is available.
    pub avail: Vec<u8>,
    /// `L` actions.
    pub actions: Vec<u16>,
    /// `L` rewards: the team's or the agent's own (algorithms §2.5).
    pub rewards: Vec<f32>,
    /// How it ended.
    pub end: End,
}

impl Episode {
    /// Actions taken, `L`.
    pub fn len(&self) -> usize {
        self.actions.len()
    }

    /// True before the first action.
    pub fn is_empty(&self) -> bool {
        self.actions.is_empty()
    }

    /// Sum of the rewards.
    pub fn episode_return(&self) -> f64 {
        self.rewards.iter().map(|&r| f64::from(r)).sum()
    }
}

/// One episode for each environment copy. Rounds reuse the buffers.
#[derive(Clone, Debug, Default)]
pub struct Rollout {
    episodes: Vec<Episode>,
}

impl Rollout {
    /// Removes the last round and starts `copies` episodes.
    pub fn begin(&mut self, copies: usize) {
        self.episodes.resize_with(copies, Episode::default);
        for episode in &mut self.episodes {
            episode.obs.clear();
            episode.avail.clear();
            episode.actions.clear();
            episode.rewards.clear();
            episode.end = End::Running;
        }
    }

    /// Adds the observation of copy `copy`: before the next action, or the final one.
    pub fn observe(&mut self, copy: usize, obs: &[f32], avail: &[u8]) {
        let episode = &mut self.episodes[copy];
        episode.obs.extend_from_slice(obs);
        episode.avail.extend_from_slice(avail);
    }

    /// Adds the action chosen in copy `copy`.
    pub fn act(&mut self, copy: usize, action: u16) {
        self.episodes[copy].actions.push(action);
    }

    /// Adds the reward of the last action in copy `copy`, and whether it ended the episode.
    pub fn outcome(&mut self, copy: usize, reward: f32, end: End) {
        let episode = &mut self.episodes[copy];
        episode.rewards.push(reward);
        episode.end = end;
    }

    /// All episodes, by environment copy.
    pub fn episodes(&self) -> &[Episode] {
        &self.episodes
    }
}
