//! An episode in few bytes: numbers are little-endian, available actions are bits.
//!
//! ```text
//! u32 L | u32 obs_size | u32 n_actions | u8 end
//! f32 obs[(L+1) obs_size] | bits avail[(L+1) n_actions], the lowest first | u16 actions[L] | f32 rewards[L]
//! ```

use algos::rollout::{End, Episode};

const RUNNING: u8 = 0;
const TERMINATED: u8 = 1;
const TIME_LIMIT: u8 = 2;

/// Encodes `episode` into `to`, whose content is replaced.
pub(super) fn encode(episode: &Episode, to: &mut Vec<u8>) {
    let slots = episode.len() + 1;
    let per_slot = |all: usize| (all / slots) as u32;
    to.clear();
    to.extend((episode.len() as u32).to_le_bytes());
    to.extend(per_slot(episode.obs.len()).to_le_bytes());
    to.extend(per_slot(episode.avail.len()).to_le_bytes());
    to.push(match episode.end {
        End::Running => RUNNING,
        End::Terminated => TERMINATED,
        End::TimeLimit => TIME_LIMIT,
    });
    put_floats(&episode.obs, to);
    to.extend(episode.avail.chunks(8).map(|avail| {
        avail.iter().enumerate().fold(0, |byte, (bit, &allowed)| byte | u8::from(allowed != 0) << bit)
    }));
    to.extend(episode.actions.iter().flat_map(|a| a.to_le_bytes()));
    put_floats(&episode.rewards, to);
}

/// Decodes an episode into `to`, whose content is replaced; `None` if `record` is not an episode.
pub(super) fn decode(record: &[u8], to: &mut Episode) -> Option<()> {
    let rest = &mut &record[..];
    let mut size = || Some(u32::from_le_bytes(*take(rest, 4)?.first_chunk()?) as usize);
    let (length, obs_size, n_actions) = (size()?, size()?, size()?);
    to.end = match take(rest, 1)?[0] {
        RUNNING => End::Running,
        TERMINATED => End::Terminated,
        TIME_LIMIT => End::TimeLimit,
        _ => return None,
    };
    // `take` compares sizes with the record before memory of that size is allocated.
    let slots = length.checked_add(1)?;
    get_floats(take(rest, slots.checked_mul(obs_size)?.checked_mul(4)?)?, &mut to.obs);
    let bits = slots.checked_mul(n_actions)?;
    let bytes = take(rest, bits.div_ceil(8))?;
    to.avail.clear();
    to.avail.extend(bytes.iter().flat_map(|byte| (0..8).map(move |bit| byte >> bit & 1)).take(bits));
    let actions = take(rest, length.checked_mul(2)?)?;
    to.actions.clear();
    to.actions.extend(actions.as_chunks().0.iter().map(|&bytes| u16::from_le_bytes(bytes)));
    get_floats(take(rest, length.checked_mul(4)?)?, &mut to.rewards);
    rest.is_empty().then_some(())
}

fn put_floats(floats: &[f32], to: &mut Vec<u8>) {
    to.reserve(4 * floats.len());
    floats.iter().for_each(|x| to.extend_from_slice(&x.to_le_bytes()));
}

fn get_floats(bytes: &[u8], to: &mut Vec<f32>) {
    to.clear();
    to.extend(bytes.as_chunks().0.iter().map(|&bytes| f32::from_le_bytes(bytes)));
}

/// Removes the first `n` bytes from `rest` and returns them.
fn take<'a>(rest: &mut &'a [u8], n: usize) -> Option<&'a [u8]> {
    let (head, tail) = rest.split_at_checked(n)?;
    *rest = tail;
    Some(head)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn episode() -> Episode {
        Episode {
            obs: vec![1.0, -0.0, f32::MIN_POSITIVE, 3.5, f32::MAX, -2.0],
            avail: vec![1, 0, 0, 1, 1, 1, 0, 1, 0, 0, 0, 1],
            actions: vec![3, 65_535],
            rewards: vec![0.5, -7.25],
            end: End::TimeLimit,
        }
    }

    #[test]
    fn an_episode_is_a_header_and_four_sections() {
        let mut bytes = vec![9; 100];
        encode(&episode(), &mut bytes);
        assert_eq!(bytes.len(), 13 + 6 * 4 + 2 + 2 * 2 + 2 * 4);
        assert_eq!(bytes[..13], [2, 0, 0, 0, 2, 0, 0, 0, 4, 0, 0, 0, 2]);
        assert_eq!(bytes[13..21], [0, 0, 0x80, 0x3f, 0, 0, 0, 0x80]);
        assert_eq!(bytes[37..39], [0b1011_1001, 0b1000]);
        assert_eq!(bytes[39..], [3, 0, 0xff, 0xff, 0, 0, 0, 0x3f, 0, 0, 0xe8, 0xc0]);
    }

    #[test]
    fn every_bit_comes_back_whatever_was_in_the_buffers() {
        let (mut bytes, mut found) = (Vec::new(), Episode::default());
        for end in [End::Running, End::Terminated, End::TimeLimit] {
            let expected = Episode { end, ..episode() };
            encode(&expected, &mut bytes);
            decode(&bytes, &mut found).expect("an episode");
            let bits = |episode: &Episode| -> Vec<u32> { episode.obs.iter().map(|x| x.to_bits()).collect() };
            assert_eq!(bits(&found), bits(&expected));
            assert_eq!((&found.avail, &found.actions), (&expected.avail, &expected.actions));
            assert_eq!((&found.rewards, found.end), (&expected.rewards, end));
        }
    }

    #[test]
    fn what_is_no_episode_is_refused() {
        let (mut bytes, mut to) = (Vec::new(), Episode::default());
        encode(&episode(), &mut bytes);
        for length in 0..bytes.len() {
            assert!(decode(&bytes[..length], &mut to).is_none(), "{length} bytes");
        }
        assert!(decode(&[&bytes[..], &[0]].concat(), &mut to).is_none(), "a byte too many");
        for i in [0, 4, 8, 12] {
            let mut damaged = bytes.clone();
            damaged[i] += 8;
            assert!(decode(&damaged, &mut to).is_none(), "byte {i}");
            damaged[i..i + 4].fill(0xff);
            assert!(decode(&damaged, &mut to).is_none(), "bytes from {i}");
        }
    }
}
