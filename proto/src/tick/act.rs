//! `Act`: one agent's actions for one tick.

use super::{narrow, put_u16s, u16_at, u16s, u32_at, u64_at, Mode, TickId};
use crate::codec::{check_frame, WireError, WIRE_VERSION};

const HEADER_BYTES: usize = 24;

/// One agent's actions for one tick; also the confirmation that it received this tick.
///
/// - key: `agent/{i}/act`
/// - from agent i to the env-server
/// - if lost: the env-server sends the tick again after a deadline, and the agent repeats its answer
///
/// Every tick is answered, also one without a running episode and one that closes the run. Then there are no actions,
/// and the answer confirms that the tick arrived. The answer to tick 0 of a round also confirms that the update calls
/// before it are complete.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Act {
    pub mode: Mode,
    pub epoch: u32,
    pub round: u64,
    pub tick: u32,
    /// One action for every running row of the tick, in the order of the rows.
    pub actions: Vec<u16>,
}

impl Act {
    /// Byte 1 of the message.
    pub const TAG: u8 = 2;
    /// The name used in errors.
    pub const NAME: &'static str = "Act";

    /// Bytes of a message with this many actions.
    pub const fn encoded_len(rows: usize) -> usize {
        HEADER_BYTES + 2 * rows
    }

    /// The tick that is answered.
    pub fn id(&self) -> TickId {
        TickId { epoch: self.epoch, round: self.round, mode: self.mode, tick: self.tick }
    }

    /// Encodes the message into `out`, whose content is replaced.
    ///
    /// # Panics
    /// If there are more than 65,535 actions. The configuration excludes that.
    pub fn encode(&self, out: &mut Vec<u8>) {
        out.clear();
        out.resize(Self::encoded_len(self.actions.len()), 0);
        out[0] = WIRE_VERSION;
        out[1] = Self::TAG;
        out[2] = self.mode as u8;
        out[4..8].copy_from_slice(&self.epoch.to_le_bytes());
        out[8..16].copy_from_slice(&self.round.to_le_bytes());
        out[16..20].copy_from_slice(&self.tick.to_le_bytes());
        out[20..22].copy_from_slice(&narrow(self.actions.len()).to_le_bytes());
        put_u16s(&mut out[HEADER_BYTES..], &self.actions);
    }

    /// Replaces `self` by the message. Whether an action exists and is available is checked by the env-server.
    ///
    /// # Errors
    /// [`WireError`] if this is not a well-formed message; `self` is unchanged then.
    pub fn decode(&mut self, bytes: &[u8]) -> Result<(), WireError> {
        check_frame(bytes, Self::NAME, Self::TAG, HEADER_BYTES)?;
        let rows = usize::from(u16_at(bytes, 20));
        let expected = Self::encoded_len(rows);
        if bytes.len() != expected {
            return Err(WireError::Length {
                name: Self::NAME,
                expected: expected as u64,
                found: bytes.len(),
            });
        }
        let mode = check(bytes, rows).map_err(|what| WireError::Value { name: Self::NAME, what })?;

        self.mode = mode;
        self.epoch = u32_at(bytes, 4);
        self.round = u64_at(bytes, 8);
        self.tick = u32_at(bytes, 16);
        self.actions.clear();
        self.actions.extend(u16s(&bytes[HEADER_BYTES..]));
        Ok(())
    }
}

fn check(bytes: &[u8], rows: usize) -> Result<Mode, String> {
    let mode = Mode::from_wire(bytes[2])?;
    if bytes[3] != 0 || u16_at(bytes, 22) != 0 {
        return Err("a reserved byte of the header is not zero".to_owned());
    }
    if mode.closes_the_run() && rows > 0 {
        return Err(format!("{rows} actions in mode {mode}: expected none"));
    }
    Ok(mode)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn example() -> Act {
        Act { mode: Mode::Train, epoch: 2, round: 0x0102_0304_0506, tick: 7, actions: vec![5, 0, 258] }
    }

    fn encoded(act: &Act) -> Vec<u8> {
        let mut out = vec![9; 100];
        act.encode(&mut out);
        out
    }

    fn value_error(bytes: &[u8]) -> String {
        match Act::default().decode(bytes) {
            Err(WireError::Value { what, .. }) => what,
            other => panic!("expected a value error, got {other:?}"),
        }
    }

    #[test]
    fn actions_follow_a_header_of_24_bytes() {
        #[rustfmt::skip]
        let expected = [
            2, 2, 0, 0,  2, 0, 0, 0,  6, 5, 4, 3, 2, 1, 0, 0,  7, 0, 0, 0,  3, 0, 0, 0,
            5, 0, 0, 0, 2, 1,
        ];
        assert_eq!(encoded(&example()), expected);
        assert_eq!(Act::encoded_len(3), expected.len());
    }

    #[test]
    fn decoding_replaces_what_the_buffer_held_before() {
        let mut act = Act { actions: vec![1; 50], epoch: 99, mode: Mode::Test, ..Act::default() };
        act.decode(&encoded(&example())).unwrap();
        assert_eq!(act, example());
        assert_eq!(act.id(), TickId { epoch: 2, round: 0x0102_0304_0506, mode: Mode::Train, tick: 7 });
    }

    #[test]
    fn a_refused_message_leaves_the_buffer_as_it_was() {
        let mut bytes = encoded(&example());
        bytes[2] = 4;
        let mut act = example();
        act.decode(&bytes).unwrap_err();
        assert_eq!(act, example());
    }

    #[test]
    fn impossible_values_are_refused() {
        let good = encoded(&example());
        for at in [3, 22, 23] {
            let mut bytes = good.clone();
            bytes[at] = 1;
            assert_eq!(value_error(&bytes), "a reserved byte of the header is not zero");
        }
        let mut bytes = good.clone();
        bytes[2] = 4;
        assert_eq!(
            value_error(&bytes),
            "mode is 4: expected 0 (train), 1 (test), 2 (finished) or 3 (stopped)"
        );
        bytes[2] = 2;
        assert_eq!(value_error(&bytes), "3 actions in mode finished: expected none");
    }

    #[test]
    fn a_wrong_frame_or_length_is_named() {
        let good = encoded(&example());
        let refused = |bytes: &[u8]| Act::default().decode(bytes).unwrap_err().to_string();
        assert_eq!(refused(&[]), "Act message of 0 bytes: expected at least 24");
        assert_eq!(refused(&good[..23]), "Act message of 23 bytes: expected at least 24");
        assert_eq!(refused(&good[..29]), "Act message of 29 bytes: its header says 30");
        assert_eq!(refused(&[&good[..], &[0]].concat()), "Act message of 31 bytes: its header says 30");
        assert_eq!(refused(&[WIRE_VERSION, 1]), "message with tag 1: expected Act, tag 2");
        assert_eq!(
            refused(&[7, 2]),
            "message of wire version 7: this program speaks version 2; \
             install the same version of rondo on every host"
        );
    }
}
