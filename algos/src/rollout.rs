//! The episodes of one round as one agent saw them.

/// Why an episode is over, if it is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub enum End {
    /// It is not.
    #[default]
    Running,
    /// The world ended it.
    Terminated,
    /// Only the step limit did.
    TimeLimit,
}

/// One episode of `L` actions.
#[derive(Clone, Debug, Default)]
pub struct Episode {
    /// `(L + 1) × obs_size`: the final observation is included.
    pub obs: Vec<f32>,
    /// `(L + 1) × n_actions`, 1 where the action is allowed.
    pub avail: Vec<u8>,
    /// `L` actions.
    pub actions: Vec<u16>,
    /// `L` team rewards.
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

    /// Sum of the team rewards.
    pub fn episode_return(&self) -> f64 {
        self.rewards.iter().map(|&r| f64::from(r)).sum()
    }
}

/// One episode for each environment copy. Buffers are kept from round to round.
#[derive(Clone, Debug, Default)]
pub struct Rollout {
    episodes: Vec<Episode>,
}

impl Rollout {
    /// Forgets the last round and makes room for `copies` episodes.
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

    /// What copy `copy` shows before the next action, or finally.
    pub fn observe(&mut self, copy: usize, obs: &[f32], avail: &[u8]) {
        let episode = &mut self.episodes[copy];
        episode.obs.extend_from_slice(obs);
        episode.avail.extend_from_slice(avail);
    }

    /// The action chosen in copy `copy`.
    pub fn act(&mut self, copy: usize, action: u16) {
        self.episodes[copy].actions.push(action);
    }

    /// What the last action in copy `copy` earned and whether it ended the episode.
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
