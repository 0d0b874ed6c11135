//! The records of a foraging trace, without the fields that a replay does not need.

use serde::Deserialize;

use crate::lbf::State;

#[derive(Deserialize)]
pub(super) struct Header {
    pub n_agents: usize,
    pub n_actions: Vec<usize>,
    pub obs_sizes: Vec<usize>,
    pub episode_limit: u32,
    pub agents: Vec<String>,
    pub params: Params,
    pub epymarl: EpymarlHeader,
}

#[derive(Deserialize)]
pub(super) struct Params {
    pub rows: u16,
    pub cols: u16,
    pub max_num_food: u16,
    pub force_coop: bool,
    pub sight: u16,
    pub penalty: f64,
}

/// The task as EPyMARL sees it.
#[derive(Deserialize)]
pub(super) struct EpymarlHeader {
    pub controlled: Vec<usize>,
    pub n_agents: usize,
    pub obs_size: usize,
    pub n_actions: usize,
    pub state_size: usize,
    pub episode_limit: u32,
}

/// The part of a record that identifies it.
#[derive(Deserialize)]
#[serde(expecting = "an object")]
pub(super) struct Kind {
    #[serde(rename = "type")]
    pub kind: String,
}

#[derive(Deserialize)]
pub(super) struct Reset {
    pub episode: u64,
    pub state: State,
    /// Float32 values, written so that they are exact when read as doubles and narrowed.
    pub obs: Vec<Vec<f64>>,
    pub avail_actions: Vec<Vec<u8>>,
}

#[derive(Deserialize)]
pub(super) struct Step {
    pub episode: u64,
    pub t: u64,
    pub actions: Vec<u16>,
    pub effective_actions: Vec<u16>,
    pub rewards: Vec<f64>,
    pub obs: Vec<Vec<f64>>,
    pub terminated: bool,
    pub truncated: bool,
    pub avail_actions: Vec<Vec<u8>>,
    pub epymarl: EpymarlStep,
    pub state: State,
}

#[derive(Deserialize)]
pub(super) struct EpymarlStep {
    pub reward: f64,
    pub terminated: bool,
    pub truncated: bool,
}
