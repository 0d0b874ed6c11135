//! TensorBoard's event files, written by hand: a few fields of two protobuf messages in TFRecord frames. They may hold
//! times, because only TensorBoard reads them.
//!
//! ```text
//! record  = u64 length, u32 masked_crc(length), bytes, u32 masked_crc(bytes)     little-endian
//! Event   { double wall_time = 1; int64 step = 2; string file_version = 3; Summary summary = 5; }
//! Summary { repeated Value value = 1; }
//! Value   { string tag = 1; float simple_value = 2; }
//! ```

use std::fs::{self, File};
use std::io::Write;
use std::path::{Path, PathBuf};
use std::time::Duration;

use crate::{files, Error};

/// TensorBoard searches for files with this in their names.
const FILE_NAME: &str = "events.out.tfevents";

/// The event file of one role.
#[derive(Debug)]
pub(crate) struct EventFile {
    path: PathBuf,
    file: File,
}

impl EventFile {
    /// Starts a new file with the rows that are kept, and removes the role's older files. Its name sorts after theirs,
    /// so a running TensorBoard continues with it. `now` is since 1970.
    pub(crate) fn start<'a, S>(
        folder: &Path,
        now: Duration,
        kept: impl Iterator<Item = (u64, S)>,
    ) -> Result<Self, Error>
    where
        S: Iterator<Item = (&'a str, f64)>,
    {
        files::ensure_folder(folder)?;
        for name in files::names(folder)?.iter().filter(|name| name.starts_with(FILE_NAME)) {
            let path = folder.join(name);
            fs::remove_file(&path).map_err(Error::io("remove", &path))?;
        }
        let mut bytes = record(&version_event(now));
        for (step, scalars) in kept {
            bytes.extend(record(&scalars_event(now, step, scalars)));
        }
        let path = folder.join(format!("{FILE_NAME}.{:010}.{:09}", now.as_secs(), now.subsec_nanos()));
        let file = files::replace(&path, &bytes)?;
        Ok(Self { path, file })
    }

    /// Writes one event with all the scalars of a row.
    pub(crate) fn append<'a>(
        &mut self,
        now: Duration,
        step: u64,
        scalars: impl Iterator<Item = (&'a str, f64)>,
    ) -> Result<(), Error> {
        let bytes = record(&scalars_event(now, step, scalars));
        self.file.write_all(&bytes).map_err(Error::io("append an event to", &self.path))
    }
}

fn version_event(now: Duration) -> Vec<u8> {
    let mut event = Vec::new();
    put_double(&mut event, 1, now.as_secs_f64());
    put_bytes(&mut event, 3, b"brain.Event:2");
    event
}

fn scalars_event<'a>(now: Duration, step: u64, scalars: impl Iterator<Item = (&'a str, f64)>) -> Vec<u8> {
    let mut summary = Vec::new();
    for (tag, scalar) in scalars {
        let mut value = Vec::new();
        put_bytes(&mut value, 1, tag.as_bytes());
        put_float(&mut value, 2, scalar as f32);
        put_bytes(&mut summary, 1, &value);
    }
    let mut event = Vec::new();
    put_double(&mut event, 1, now.as_secs_f64());
    put_varint(&mut event, 2, step);
    put_bytes(&mut event, 5, &summary);
    event
}

// Protobuf's wire types, which share a field's first byte with its number (1 to 15 here).
const VARINT: u8 = 0;
const FIXED_64: u8 = 1;
const BYTES: u8 = 2;
const FIXED_32: u8 = 5;

fn put_varint(out: &mut Vec<u8>, field: u8, number: u64) {
    out.push(field << 3 | VARINT);
    varint(out, number);
}

fn put_double(out: &mut Vec<u8>, field: u8, number: f64) {
    out.push(field << 3 | FIXED_64);
    out.extend(number.to_le_bytes());
}

fn put_bytes(out: &mut Vec<u8>, field: u8, bytes: &[u8]) {
    out.push(field << 3 | BYTES);
    varint(out, bytes.len() as u64);
    out.extend(bytes);
}

fn put_float(out: &mut Vec<u8>, field: u8, number: f32) {
    out.push(field << 3 | FIXED_32);
    out.extend(number.to_le_bytes());
}

/// Seven bits per byte, lowest first; the top bit marks that more follow.
fn varint(out: &mut Vec<u8>, mut number: u64) {
    while number >= 0x80 {
        out.push(number as u8 | 0x80);
        number >>= 7;
    }
    out.push(number as u8);
}

fn record(data: &[u8]) -> Vec<u8> {
    let length = (data.len() as u64).to_le_bytes();
    let mut record = Vec::with_capacity(data.len() + 16);
    record.extend(length);
    record.extend(masked(crc32c(&length)).to_le_bytes());
    record.extend(data);
    record.extend(masked(crc32c(data)).to_le_bytes());
    record
}

/// TFRecord's mask, for checksums of bytes that contain checksums.
fn masked(crc: u32) -> u32 {
    crc.rotate_right(15).wrapping_add(0xa282_ead8)
}

/// CRC-32C (Castagnoli), a byte at a time: event files are small.
fn crc32c(bytes: &[u8]) -> u32 {
    !bytes.iter().fold(!0, |crc, &byte| TABLE[usize::from(crc as u8 ^ byte)] ^ (crc >> 8))
}

const TABLE: [u32; 256] = {
    const REVERSED_POLYNOMIAL: u32 = 0x82f6_3b78;
    let mut table = [0; 256];
    let mut i = 0;
    while i < 256 {
        let mut crc = i as u32;
        let mut bit = 0;
        while bit < 8 {
            crc = if crc & 1 == 1 { crc >> 1 ^ REVERSED_POLYNOMIAL } else { crc >> 1 };
            bit += 1;
        }
        table[i] = crc;
        i += 1;
    }
    table
};

#[cfg(test)]
pub(crate) mod tests {
    use super::*;

    /// A field of an encoded message.
    #[derive(Debug, PartialEq)]
    enum Field<'a> {
        Number(u64),
        Double(f64),
        Bytes(&'a [u8]),
        Float(f32),
    }

    /// Every (step, tag, value) in the only event file of a folder, its checksums verified.
    pub(crate) fn scalars_in(folder: &Path) -> Vec<(u64, String, f32)> {
        let names = files::names(folder).unwrap();
        assert_eq!(names.len(), 1, "{names:?}");
        let bytes = fs::read(folder.join(&names[0])).unwrap();
        let mut events = records(&bytes).into_iter().map(fields);
        assert_eq!(events.next().unwrap()[1], (3, Field::Bytes(b"brain.Event:2")));
        let mut scalars = Vec::new();
        for event in events {
            let [(1, Field::Double(_)), (2, Field::Number(step)), (5, Field::Bytes(summary))] = event[..]
            else {
                panic!("{event:?}")
            };
            for (field, value) in fields(summary) {
                assert_eq!(field, 1);
                let Field::Bytes(value) = value else { panic!("{value:?}") };
                let value = fields(value);
                let [(1, Field::Bytes(tag)), (2, Field::Float(scalar))] = value[..] else {
                    panic!("{value:?}")
                };
                scalars.push((step, String::from_utf8(tag.to_vec()).unwrap(), scalar));
            }
        }
        scalars
    }

    fn records(mut bytes: &[u8]) -> Vec<&[u8]> {
        let mut records = Vec::new();
        while !bytes.is_empty() {
            let (head, rest) = bytes.split_at(12);
            let length = u64::from_le_bytes(head[..8].try_into().unwrap()) as usize;
            assert_eq!(head[8..], masked(crc32c(&head[..8])).to_le_bytes());
            let (data, rest) = rest.split_at(length);
            let (crc, rest) = rest.split_at(4);
            assert_eq!(crc, masked(crc32c(data)).to_le_bytes());
            records.push(data);
            bytes = rest;
        }
        records
    }

    fn fields(mut bytes: &[u8]) -> Vec<(u8, Field<'_>)> {
        let mut fields = Vec::new();
        while let Some((&key, rest)) = bytes.split_first() {
            bytes = rest;
            let field = match key & 7 {
                VARINT => Field::Number(read_varint(&mut bytes)),
                FIXED_64 => Field::Double(f64::from_le_bytes(take(&mut bytes, 8).try_into().unwrap())),
                BYTES => {
                    let length = read_varint(&mut bytes) as usize;
                    Field::Bytes(take(&mut bytes, length))
                }
                FIXED_32 => Field::Float(f32::from_le_bytes(take(&mut bytes, 4).try_into().unwrap())),
                other => panic!("wire type {other}"),
            };
            fields.push((key >> 3, field));
        }
        fields
    }

    fn take<'a>(bytes: &mut &'a [u8], count: usize) -> &'a [u8] {
        let (taken, rest) = bytes.split_at(count);
        *bytes = rest;
        taken
    }

    fn read_varint(bytes: &mut &[u8]) -> u64 {
        let mut number = 0;
        for shift in (0..).step_by(7) {
            let byte = take(bytes, 1)[0];
            number |= u64::from(byte & 0x7f) << shift;
            if byte < 0x80 {
                break;
            }
        }
        number
    }

    #[test]
    fn checksums_are_those_of_rfc_3720() {
        assert_eq!(crc32c(b""), 0);
        assert_eq!(crc32c(b"123456789"), 0xe306_9283);
        assert_eq!(crc32c(&[0; 32]), 0x8a91_36aa);
        assert_eq!(crc32c(&[0xff; 32]), 0x62a8_ab43);
        let ascending: Vec<u8> = (0..32).collect();
        assert_eq!(crc32c(&ascending), 0x46dd_794e);
        assert_eq!(masked(0), 0xa282_ead8);
        assert_eq!(masked(0x0001_8003), 0x0006_0003_u32.wrapping_add(0xa282_ead8));
    }

    #[test]
    fn varints_take_seven_bits_a_byte() {
        for (number, bytes) in [
            (0, &[0][..]),
            (127, &[127]),
            (300, &[0xac, 2]),
            (u64::MAX, &[255, 255, 255, 255, 255, 255, 255, 255, 255, 1]),
        ] {
            let mut out = Vec::new();
            varint(&mut out, number);
            assert_eq!(out, bytes);
            assert_eq!(read_varint(&mut &out[..]), number);
        }
    }

    #[test]
    fn an_event_is_the_protobuf_that_tensorboard_reads() {
        let event = scalars_event(Duration::from_millis(1500), 362, [("loss", 0.5)].into_iter());
        let expected = [
            &[0x09][..],
            &1.5_f64.to_le_bytes(),
            &[0x10, 0xea, 0x02],
            &[0x2a, 13, 0x0a, 11, 0x0a, 4],
            b"loss",
            &[0x15],
            &0.5_f32.to_le_bytes(),
        ]
        .concat();
        assert_eq!(event, expected);
    }

    #[test]
    fn scalars_read_back_at_single_precision() {
        let tmp = tempfile::tempdir().unwrap();
        let folder = tmp.path().join("tensorboard/agent-0");
        let now = Duration::new(1_700_000_000, 5);
        let kept = [(1, [("loss", 0.1), ("return_mean", f64::INFINITY)])];
        let mut file =
            EventFile::start(&folder, now, kept.map(|(t, s)| (t, s.into_iter())).into_iter()).unwrap();
        file.append(now, 1 << 40, [("loss", 1e300)].into_iter()).unwrap();
        assert_eq!(files::names(&folder).unwrap(), ["events.out.tfevents.1700000000.000000005"]);
        assert_eq!(
            scalars_in(&folder),
            [
                (1, "loss".to_owned(), 0.1),
                (1, "return_mean".to_owned(), f32::INFINITY),
                (1 << 40, "loss".to_owned(), f32::INFINITY),
            ]
        );
    }
}
