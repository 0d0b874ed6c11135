//! The ring buffer of a learner that replays experience (algorithms §5.1): the last `capacity` episodes, on disk
//! all of them, in memory as many of the newest as fit into a bound.
//!
//! The bound is a matter of speed alone: episodes in memory are the same bytes as on disk.

mod encoding;

use std::collections::VecDeque;

use algos::iql::sample_distinct;
use algos::rollout::Episode;
use process::Failure;
use proto::exit;
use rand_chacha::ChaCha8Rng;
use store::Episodes;

/// What is kept in memory unless the user says otherwise, in bytes.
pub const DEFAULT_MEMORY_BYTES: u64 = 64 << 20;

/// The last `capacity` episodes.
pub struct Replay {
    file: Episodes,
    capacity: u64,
    memory_bytes: u64,
    /// The newest episodes as they are on disk, the oldest of them first.
    held: VecDeque<Box<[u8]>>,
    held_bytes: u64,
    encoded: Vec<u8>,
    minibatch: Vec<Episode>,
}

impl Replay {
    /// The buffer over what `file` holds, of which the newest episodes are read into memory, up to
    /// `memory_bytes`.
    ///
    /// # Errors
    /// If one of the last `capacity` episodes is not there or cannot be read.
    pub fn open(file: Episodes, capacity: usize, memory_bytes: u64) -> Result<Self, Failure> {
        let mut replay = Self {
            file,
            capacity: capacity as u64,
            memory_bytes,
            held: VecDeque::new(),
            held_bytes: 0,
            encoded: Vec::new(),
            minibatch: Vec::new(),
        };
        let oldest = replay.oldest();
        replay.file.require(oldest)?;
        for number in (oldest..replay.file.position()).rev() {
            let record = replay.file.read(number, &mut replay.encoded)?;
            if replay.held_bytes + cost(record) > memory_bytes {
                break;
            }
            replay.held_bytes += cost(record);
            replay.held.push_front(record.into());
        }
        Ok(replay)
    }

    /// Adds an episode; the oldest one leaves when there are more than `capacity`.
    ///
    /// # Errors
    /// What the disk says; the buffer is then as it was.
    pub fn push(&mut self, episode: &Episode) -> Result<(), Failure> {
        encoding::encode(episode, &mut self.encoded);
        self.file.append(&self.encoded)?;
        // Room is made first, so that the bound holds at every moment.
        let cost = cost(&self.encoded);
        while !self.held.is_empty()
            && (self.held_bytes + cost > self.memory_bytes || self.held.len() as u64 >= self.capacity)
        {
            self.held_bytes -= self.held.pop_front().map_or(0, |record| self::cost(&record));
        }
        if cost <= self.memory_bytes {
            self.held_bytes += cost;
            self.held.push_back(self.encoded.as_slice().into());
        }
        Ok(())
    }

    /// Episodes that can be drawn: all that were pushed, at most `capacity`.
    pub fn len(&self) -> usize {
        (self.file.position() - self.oldest()) as usize
    }

    /// Draws `count` different episodes, every choice of them equally likely.
    ///
    /// # Errors
    /// If one cannot be read, or there are fewer than `count`.
    pub fn sample(&mut self, count: usize, rng: &mut ChaCha8Rng) -> Result<&[Episode], Failure> {
        if count > self.len() {
            let text =
                format!("a minibatch of {count} was asked for, but only {} episodes are stored", self.len());
            return Err(Failure::new(exit::BUG, text));
        }
        let (oldest, in_memory) = (self.oldest(), self.file.position() - self.held.len() as u64);
        let numbers = sample_distinct(count, self.len(), rng).into_iter().map(|i| oldest + i as u64);
        self.minibatch.resize_with(count, Episode::default);
        for (number, episode) in numbers.zip(&mut self.minibatch) {
            let record = match number.checked_sub(in_memory) {
                Some(i) => &self.held[i as usize],
                None => self.file.read(number, &mut self.encoded)?,
            };
            encoding::decode(record, episode).ok_or_else(|| {
                let text = format!(
                    "record {number} of the experience holds no episode\n\
                     hint: it was written by another program; start the run again in a new folder"
                );
                Failure::new(exit::IO, text)
            })?;
        }
        Ok(&self.minibatch)
    }

    /// How many episodes were ever pushed.
    pub fn position(&self) -> u64 {
        self.file.position()
    }

    /// Flushes everything to the disk and returns the position, for a checkpoint to store.
    pub fn sync(&self) -> Result<u64, Failure> {
        Ok(self.file.sync()?)
    }

    /// Gives back the disk space of episodes that the buffer did not hold any more at `position`, that of
    /// the oldest checkpoint that is kept.
    pub fn forget_before(&mut self, position: u64) -> Result<(), Failure> {
        Ok(self.file.forget_before(position.saturating_sub(self.capacity))?)
    }

    /// Number of the oldest episode that can be drawn.
    fn oldest(&self) -> u64 {
        self.file.position().saturating_sub(self.capacity)
    }
}

/// Bytes that an episode takes in memory: its own and those of its place in the queue.
fn cost(record: &[u8]) -> u64 {
    (record.len() + size_of::<Box<[u8]>>()) as u64
}

#[cfg(test)]
mod tests;
