//! The replay buffer (algorithms §5.1): the last `capacity` episodes. All of them are on disk, and as many of the
//! newest as fit a limit are in memory.
//!
//! The limit affects speed only: episodes in memory are the same bytes as on disk.

mod encoding;

use std::collections::VecDeque;

use algos::iql::sample_distinct;
use algos::rollout::Episode;
use process::Failure;
use proto::exit;
use rand_chacha::ChaCha8Rng;
use store::Episodes;

/// Default limit of memory, in bytes.
pub const DEFAULT_MEMORY_BYTES: u64 = 64 << 20;

/// The last `capacity` episodes.
pub struct Replay {
    file: Episodes,
    capacity: u64,
    memory_bytes: u64,
    /// The newest episodes in the format on disk, the oldest of them first.
    held: VecDeque<Box<[u8]>>,
    held_bytes: u64,
    encoded: Vec<u8>,
    minibatch: Vec<Episode>,
}

impl Replay {
    /// The buffer over the episodes of `file`. Reads the newest into memory, up to `memory_bytes`.
    ///
    /// # Errors
    /// If one of the last `capacity` episodes is missing or cannot be read.
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

    /// Adds an episode, and drops the oldest if there are more than `capacity`.
    ///
    /// # Errors
    /// I/O errors. The buffer is unchanged then.
    pub fn push(&mut self, episode: &Episode) -> Result<(), Failure> {
        encoding::encode(episode, &mut self.encoded);
        self.file.append(&self.encoded)?;
        // Frees memory first, so that the limit always holds.
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

    /// Episodes that can be drawn: at most `capacity`.
    pub fn len(&self) -> usize {
        (self.file.position() - self.oldest()) as usize
    }

    /// Draws `count` different episodes uniformly.
    ///
    /// # Errors
    /// If one cannot be read, or there are fewer than `count`.
    pub fn sample(&mut self, count: usize, rng: &mut ChaCha8Rng) -> Result<&[Episode], Failure> {
        if count > self.len() {
            let text =
                format!("a minibatch of {count} was requested, but only {} episodes are stored", self.len());
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

    /// Number of episodes pushed so far.
    pub fn position(&self) -> u64 {
        self.file.position()
    }

    /// Flushes everything to the disk and returns the position, for a checkpoint to store.
    pub fn sync(&self) -> Result<u64, Failure> {
        Ok(self.file.sync()?)
    }

    /// Frees the disk space of episodes that were no longer in the buffer at `position`, that of the oldest kept
    /// checkpoint.
    pub fn forget_before(&mut self, position: u64) -> Result<(), Failure> {
        Ok(self.file.forget_before(position.saturating_sub(self.capacity))?)
    }

    /// Number of the oldest episode that can be drawn.
    fn oldest(&self) -> u64 {
        self.file.position().saturating_sub(self.capacity)
    }
}

/// Bytes of an episode in memory, with its place in the queue.
fn cost(record: &[u8]) -> u64 {
    (record.len() + size_of::<Box<[u8]>>()) as u64
}

#[cfg(test)]
mod tests;
