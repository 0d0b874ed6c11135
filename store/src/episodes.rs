//! Data that a role stores beside its checkpoints: records of any bytes. They are appended to files in segments, read
//! by number in any order, and truncated to the position of a checkpoint when a run resumes.
//!
//! ```text
//! replay/episodes-000000000000.bin      named by the number of its first record
//!        records:  u64 length | 8 bytes of blake3(u64 number, bytes) | bytes
//! ```
//!
//! All numbers are little-endian. A checkpoint stores the number of records. A role can always return to it, because
//! earlier records are never overwritten.

use std::fs::{self, File, OpenOptions};
use std::os::unix::fs::FileExt;
use std::path::PathBuf;

use crate::{files, Error};

/// Size of a segment. The largest buffers have some tens of them open, and removing one frees a noticeable part of
/// the disk.
const SEGMENT_BYTES: u64 = 64 << 20;

/// Length and checksum before each record.
const HEADER: usize = 16;

/// The records of one role, without a buffer: [`Episodes::append`] writes the record before it returns, or fails.
#[derive(Debug)]
pub struct Episodes {
    folder: PathBuf,
    segment_bytes: u64,
    /// Ascending and without gaps; new records go to the last one.
    segments: Vec<Segment>,
    position: u64,
    writing: Vec<u8>,
}

#[derive(Debug)]
struct Segment {
    path: PathBuf,
    file: File,
    /// Number of the first record.
    first: u64,
    /// Where each record ends.
    ends: Vec<u64>,
}

impl Episodes {
    /// Opens the records in `folder` and cuts off those from number `position` on.
    pub(crate) fn open(folder: PathBuf, position: u64) -> Result<Self, Error> {
        Self::open_segmented(folder, position, SEGMENT_BYTES)
    }

    fn open_segmented(folder: PathBuf, position: u64, segment_bytes: u64) -> Result<Self, Error> {
        files::ensure_folder(&folder)?;
        let mut firsts: Vec<u64> =
            files::names(&folder)?.iter().filter_map(|name| first_record(name)).collect();
        firsts.sort_unstable(); // Names sort like numbers up to 12 digits only.
        let later = firsts.split_off(firsts.partition_point(|&first| first < position));

        let mut segments = Vec::with_capacity(firsts.len());
        for (i, &first) in firsts.iter().enumerate() {
            let end = firsts.get(i + 1).copied().unwrap_or(position);
            segments.push(Segment::read(folder.join(file_name(first)), first, end)?);
        }
        if position > 0 && segments.is_empty() {
            let problem = format!("none of the {position} records exists");
            return Err(Error::DamagedEpisodes { path: folder, problem });
        }
        // Nothing is cut off before all records that stay have been read.
        for &first in later.iter().rev() {
            let path = folder.join(file_name(first));
            fs::remove_file(&path).map_err(Error::io("remove", &path))?;
        }
        if let Some(last) = segments.last() {
            last.file.set_len(last.bytes()).map_err(Error::io("cut", &last.path))?;
        }
        // Otherwise a removed file could reappear after a power cut and block a new one of the same name.
        files::sync_folder(&folder)?;
        Ok(Self { folder, segment_bytes, segments, position, writing: Vec::new() })
    }

    /// Number of records appended so far; the next one gets this number.
    pub fn position(&self) -> u64 {
        self.position
    }

    /// Number of the oldest record that still exists.
    pub fn oldest(&self) -> u64 {
        self.segments.first().map_or(self.position, |segment| segment.first)
    }

    /// Checks that the records from number `oldest` on exist.
    ///
    /// # Errors
    /// [`Error::DamagedEpisodes`].
    pub fn require(&self, oldest: u64) -> Result<(), Error> {
        if self.oldest() <= oldest {
            return Ok(());
        }
        let problem = format!("the records from {oldest} to {} are missing", self.oldest() - 1);
        Err(Error::DamagedEpisodes { path: self.folder.clone(), problem })
    }

    /// Appends a record.
    ///
    /// # Errors
    /// I/O errors. All earlier records stay readable, and the failed record is cut off again if the disk allows it.
    pub fn append(&mut self, record: &[u8]) -> Result<(), Error> {
        if self.segments.last().is_none_or(|segment| segment.bytes() >= self.segment_bytes) {
            self.start_segment()?;
        }
        let segment = self.segments.last_mut().expect("a segment was just started if there was none");
        self.writing.clear();
        self.writing.extend_from_slice(&header(self.position, record));
        self.writing.extend_from_slice(record);
        // At a tracked position, so that the next record overwrites one that was written in part.
        let start = segment.bytes();
        if let Err(error) = segment.file.write_all_at(&self.writing, start) {
            if let Err(error) = segment.file.set_len(start) {
                tracing::warn!(path = %segment.path.display(), %error, "cannot cut off a record written in part");
            }
            return Err(Error::io("append an episode to", &segment.path)(error));
        }
        segment.ends.push(start + self.writing.len() as u64);
        self.position += 1;
        Ok(())
    }

    /// Reads a record by its number, into `buffer`.
    ///
    /// # Errors
    /// [`Error::NoSuchEpisode`], or [`Error::DamagedEpisodes`] if it is not what was appended.
    pub fn read<'a>(&self, number: u64, buffer: &'a mut Vec<u8>) -> Result<&'a [u8], Error> {
        let after = self.segments.partition_point(|segment| segment.first <= number);
        if after == 0 || number >= self.position {
            let (path, held) = (self.folder.clone(), self.oldest()..self.position);
            return Err(Error::NoSuchEpisode { path, number, held });
        }
        let segment = &self.segments[after - 1];
        let i = (number - segment.first) as usize;
        let start = if i == 0 { 0 } else { segment.ends[i - 1] };
        buffer.resize((segment.ends[i] - start) as usize, 0);
        segment.file.read_exact_at(buffer, start).map_err(Error::io("read", &segment.path))?;
        let (header, record) = buffer.split_at(HEADER);
        if header != self::header(number, record) {
            return Err(segment.damaged(number, start));
        }
        Ok(record)
    }

    /// Flushes the records to the disk and returns the position, for a checkpoint to store.
    pub fn sync(&self) -> Result<u64, Error> {
        if let Some(last) = self.segments.last() {
            last.flush()?;
        }
        files::sync_folder(&self.folder)?;
        Ok(self.position)
    }

    /// Removes segments that hold only records before number `oldest`.
    pub fn forget_before(&mut self, oldest: u64) -> Result<(), Error> {
        while self.segments.get(1).is_some_and(|second| second.first <= oldest) {
            let path = &self.segments[0].path;
            fs::remove_file(path).map_err(Error::io("remove", path))?;
            // One after another, so that a power cut leaves no gap.
            files::sync_folder(&self.folder)?;
            self.segments.remove(0);
        }
        Ok(())
    }

    fn start_segment(&mut self) -> Result<(), Error> {
        // From here on `sync` flushes the new one only.
        if let Some(last) = self.segments.last() {
            last.flush()?;
        }
        let path = self.folder.join(file_name(self.position));
        let file = OpenOptions::new()
            .read(true)
            .write(true)
            .create_new(true)
            .open(&path)
            .map_err(Error::io("create", &path))?;
        self.segments.push(Segment { path, file, first: self.position, ends: Vec::new() });
        Ok(())
    }
}

impl Segment {
    /// Opens a file that must hold the records from `first` up to `end`, and checks each of them. Later bytes are not
    /// read.
    fn read(path: PathBuf, first: u64, end: u64) -> Result<Self, Error> {
        let file = OpenOptions::new().read(true).write(true).open(&path).map_err(Error::io("open", &path))?;
        let size = file.metadata().map_err(Error::io("ask for the size of", &path))?.len();
        let mut segment = Self { path, file, first, ends: Vec::new() };
        let mut buffer = Vec::new();
        for number in first..end {
            let start = segment.bytes();
            let mut found = [0; HEADER];
            let length = if size.saturating_sub(start) < HEADER as u64 {
                None
            } else {
                segment.read_at(&mut found, start)?;
                let (length, _) = found.split_first_chunk().expect("a header starts with 8 bytes");
                // Compared with the file's size before memory of that length is allocated.
                let length = u64::from_le_bytes(*length);
                (length <= size - start - HEADER as u64).then_some(length)
            };
            let Some(length) = length else {
                let problem = format!("it ends before or within record {number}, at byte {size}");
                return Err(Error::DamagedEpisodes { path: segment.path, problem });
            };
            buffer.resize(length as usize, 0);
            segment.read_at(&mut buffer, start + HEADER as u64)?;
            if found != header(number, &buffer) {
                return Err(segment.damaged(number, start));
            }
            segment.ends.push(start + HEADER as u64 + length);
        }
        Ok(segment)
    }

    fn read_at(&self, buffer: &mut [u8], start: u64) -> Result<(), Error> {
        self.file.read_exact_at(buffer, start).map_err(Error::io("read", &self.path))
    }

    /// Where the last record ends.
    fn bytes(&self) -> u64 {
        self.ends.last().copied().unwrap_or(0)
    }

    fn flush(&self) -> Result<(), Error> {
        self.file.sync_data().map_err(Error::io("flush", &self.path))
    }

    fn damaged(&self, number: u64, start: u64) -> Error {
        let problem = format!("record {number}, at byte {start}, is not what was written there");
        Error::DamagedEpisodes { path: self.path.clone(), problem }
    }
}

fn header(number: u64, record: &[u8]) -> [u8; HEADER] {
    let mut header = [0; HEADER];
    header[..8].copy_from_slice(&(record.len() as u64).to_le_bytes());
    // The number is part of the checksum: a record in another one's place is damaged too.
    let mut hasher = blake3::Hasher::new();
    hasher.update(&number.to_le_bytes()).update(record);
    header[8..].copy_from_slice(&hasher.finalize().as_bytes()[..8]);
    header
}

fn file_name(first: u64) -> String {
    format!("episodes-{first:012}.bin")
}

fn first_record(name: &str) -> Option<u64> {
    let first = name.strip_prefix("episodes-")?.strip_suffix(".bin")?.parse().ok()?;
    (file_name(first) == name).then_some(first)
}

#[cfg(test)]
mod tests;
