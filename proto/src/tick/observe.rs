//! `Observe`: what one agent sees in one tick, for all environment copies that were running.

use super::{f32s, narrow, put_f32s, put_u16s, u16_at, u16s, u32_at, u64_at, End, Mode, TickId};
use crate::codec::{check_frame, WireError, WIRE_VERSION};

const HEADER_BYTES: usize = 40;

/// What one agent sees in one tick, and the reward of the world step just made: the team's or the agent's own.
///
/// - key: `world/{i}/observe`
/// - from the env-server to agent i only
/// - if lost: sent again after a deadline; an agent repeats its answer to a tick that it has already answered
///
/// The rows are the environment copies that were running before this tick's world step, all of them at tick 0.
/// A copy whose episode ended with this step has its last row here, with the final observation. A message whose mode
/// closes the run has no rows.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Observe {
    pub mode: Mode,
    /// Increases whenever the run starts again from a checkpoint.
    pub epoch: u32,
    /// Training rounds completed. With PPO this is also the number `u` of the round's update call (algorithms §6.2);
    /// Q-learning counts update calls separately. A test has the number of the training round that follows it.
    pub round: u64,
    /// World steps made in this round so far.
    pub tick: u32,
    /// Environment steps counted before this round, summed over copies.
    pub t_env: u64,
    /// Numbers in one observation.
    pub obs_size: usize,
    /// Number of actions, available or not.
    pub n_actions: usize,
    /// Which environment copy each row belongs to; strictly increasing.
    pub copies: Vec<u16>,
    /// Whether each row's episode is running; at tick 0 all are.
    pub ends: Vec<End>,
    /// The reward of the step just made, by row: the team's, or the agent's own with `world.reward = individual`. Zero
    /// at tick 0.
    pub rewards: Vec<f32>,
    /// Observations, row-major: rows × `obs_size`.
    pub obs: Vec<f32>,
    /// 1 where an action is available, else 0; row-major: rows × `n_actions`. A running row has at least one.
    pub avail: Vec<u8>,
}

impl Observe {
    /// Byte 1 of the message.
    pub const TAG: u8 = 1;
    /// The name used in errors.
    pub const NAME: &'static str = "Observe";

    /// Bytes of a message of these sizes.
    pub const fn encoded_len(rows: usize, obs_size: usize, n_actions: usize) -> usize {
        HEADER_BYTES + (3 * rows).next_multiple_of(4) + 4 * rows + 4 * rows * obs_size + rows * n_actions
    }

    /// The id of this tick.
    pub fn id(&self) -> TickId {
        TickId { epoch: self.epoch, round: self.round, mode: self.mode, tick: self.tick }
    }

    /// Number of rows.
    pub fn rows(&self) -> usize {
        self.copies.len()
    }

    /// The observation in a row.
    pub fn observation(&self, row: usize) -> &[f32] {
        &self.obs[row * self.obs_size..][..self.obs_size]
    }

    /// The availability of each action in a row.
    pub fn available(&self, row: usize) -> &[u8] {
        &self.avail[row * self.n_actions..][..self.n_actions]
    }

    /// The rows that need an action, in the order of [`super::Act::actions`].
    pub fn running(&self) -> impl Iterator<Item = usize> + '_ {
        self.ends.iter().enumerate().filter(|(_, &end)| end == End::Running).map(|(row, _)| row)
    }

    /// Encodes the message into `out`, whose content is replaced.
    ///
    /// # Panics
    /// If the arrays have different numbers of rows, or there are more than 65,535 rows, numbers in an observation or
    /// actions. Values are not checked: the receiver rejects what [`Observe::decode`] rejects.
    pub fn encode(&self, out: &mut Vec<u8>) {
        let rows = self.rows();
        assert_eq!(
            (self.ends.len(), self.rewards.len(), self.obs.len(), self.avail.len()),
            (rows, rows, rows * self.obs_size, rows * self.n_actions),
            "ends, rewards, observations and availability have as many rows as copies"
        );
        out.clear();
        out.resize(Self::encoded_len(rows, self.obs_size, self.n_actions), 0);
        out[0] = WIRE_VERSION;
        out[1] = Self::TAG;
        out[2] = self.mode as u8;
        out[4..8].copy_from_slice(&self.epoch.to_le_bytes());
        out[8..16].copy_from_slice(&self.round.to_le_bytes());
        out[16..20].copy_from_slice(&self.tick.to_le_bytes());
        out[20..22].copy_from_slice(&narrow(rows).to_le_bytes());
        out[22..24].copy_from_slice(&narrow(self.obs_size).to_le_bytes());
        out[24..26].copy_from_slice(&narrow(self.n_actions).to_le_bytes());
        out[32..40].copy_from_slice(&self.t_env.to_le_bytes());

        let (copies, rest) = out[HEADER_BYTES..].split_at_mut(2 * rows);
        put_u16s(copies, &self.copies);
        let (ends, rest) = rest.split_at_mut(rows);
        for (byte, &end) in ends.iter_mut().zip(&self.ends) {
            *byte = end as u8;
        }
        let (_padding, rest) = rest.split_at_mut(padding(rows));
        let (rewards, rest) = rest.split_at_mut(4 * rows);
        put_f32s(rewards, &self.rewards);
        let (obs, avail) = rest.split_at_mut(4 * rows * self.obs_size);
        put_f32s(obs, &self.obs);
        avail.copy_from_slice(&self.avail);
    }

    /// Replaces `self` by the message.
    ///
    /// # Errors
    /// [`WireError`] if this is not a well-formed message; `self` is unchanged then. Nothing is allocated before the
    /// length of the message has been compared with its header.
    pub fn decode(&mut self, bytes: &[u8]) -> Result<(), WireError> {
        check_frame(bytes, Self::NAME, Self::TAG, HEADER_BYTES)?;
        let sections = Sections::cut(bytes)?;
        let mode = sections.check(bytes).map_err(|what| WireError::Value { name: Self::NAME, what })?;

        self.mode = mode;
        self.epoch = u32_at(bytes, 4);
        self.round = u64_at(bytes, 8);
        self.tick = u32_at(bytes, 16);
        self.t_env = u64_at(bytes, 32);
        self.obs_size = sections.obs_size;
        self.n_actions = sections.n_actions;
        self.copies.clear();
        self.copies.extend(u16s(sections.copies));
        self.ends.clear();
        self.ends.extend(sections.ends.iter().map(|&code| End::from_wire(code).unwrap_or_default()));
        self.rewards.clear();
        self.rewards.extend(f32s(sections.rewards));
        self.obs.clear();
        self.obs.extend(f32s(sections.obs));
        self.avail.clear();
        self.avail.extend_from_slice(sections.avail);
        Ok(())
    }
}

/// Zero bytes that fill copies and ends up to a multiple of four.
const fn padding(rows: usize) -> usize {
    (3 * rows).next_multiple_of(4) - 3 * rows
}

/// A message of the right length, cut into its arrays.
struct Sections<'a> {
    rows: usize,
    obs_size: usize,
    n_actions: usize,
    copies: &'a [u8],
    ends: &'a [u8],
    padding: &'a [u8],
    rewards: &'a [u8],
    obs: &'a [u8],
    avail: &'a [u8],
}

impl<'a> Sections<'a> {
    fn cut(bytes: &'a [u8]) -> Result<Self, WireError> {
        let [rows, obs_size, n_actions] = [20, 22, 24].map(|at| usize::from(u16_at(bytes, at)));
        // In u64, because the product of three u16 does not fit the usize of every machine.
        let [r, o, a] = [rows, obs_size, n_actions].map(|size| size as u64);
        let expected = HEADER_BYTES as u64 + (3 * r).next_multiple_of(4) + 4 * r + 4 * r * o + r * a;
        if bytes.len() as u64 != expected {
            return Err(WireError::Length { name: Observe::NAME, expected, found: bytes.len() });
        }
        let (copies, rest) = bytes[HEADER_BYTES..].split_at(2 * rows);
        let (ends, rest) = rest.split_at(rows);
        let (padding, rest) = rest.split_at(padding(rows));
        let (rewards, rest) = rest.split_at(4 * rows);
        let (obs, avail) = rest.split_at(4 * rows * obs_size);
        Ok(Self { rows, obs_size, n_actions, copies, ends, padding, rewards, obs, avail })
    }

    /// Checks the values of a message of the right length.
    fn check(&self, bytes: &[u8]) -> Result<Mode, String> {
        let mode = Mode::from_wire(bytes[2])?;
        if bytes[3] != 0 || bytes[26..32].iter().any(|&b| b != 0) {
            return Err("a reserved byte of the header is not zero".to_owned());
        }
        if self.padding.iter().any(|&b| b != 0) {
            return Err("a byte of padding is not zero".to_owned());
        }
        if mode.closes_the_run() != (self.rows == 0) {
            let expected = if mode.closes_the_run() { "none" } else { "at least one" };
            return Err(format!("{} rows in mode {mode}: expected {expected}", self.rows));
        }
        if u16s(self.copies).zip(u16s(self.copies).skip(1)).any(|(before, after)| before >= after) {
            return Err("the copies are not strictly increasing".to_owned());
        }
        if let Some(code) = self.ends.iter().find(|&&code| End::from_wire(code).is_none()) {
            return Err(format!("end is {code}: expected 0 (running), 1 (terminated) or 2 (time limit)"));
        }
        if !all_finite(self.rewards) || !all_finite(self.obs) {
            return Err("a reward or an observation is not finite".to_owned());
        }
        if self.avail.iter().fold(0, |all, flag| all | flag) > 1 {
            return Err("an availability is neither 0 nor 1".to_owned());
        }
        self.check_start(u32_at(bytes, 16))?;
        self.check_choices()?;
        Ok(mode)
    }

    /// At tick 0 there is no reward and no end.
    fn check_start(&self, tick: u32) -> Result<(), String> {
        let moved = self.ends.iter().any(|&code| code != End::Running as u8)
            || f32s(self.rewards).any(|reward| reward != 0.0);
        if tick == 0 && moved {
            return Err("tick 0 has an end or a reward: expected neither before the first step".to_owned());
        }
        Ok(())
    }

    /// Every running row needs an available action.
    fn check_choices(&self) -> Result<(), String> {
        for (row, &end) in self.ends.iter().enumerate() {
            let available = &self.avail[row * self.n_actions..][..self.n_actions];
            if end == End::Running as u8 && !available.contains(&1) {
                return Err(format!("row {row} is running but has no available action"));
            }
        }
        Ok(())
    }
}

/// A fold without an early exit: the compiler turns it into vector instructions.
fn all_finite(section: &[u8]) -> bool {
    f32s(section).fold(true, |fine, x| fine & x.is_finite())
}

#[cfg(test)]
mod tests;
