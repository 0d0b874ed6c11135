//! The frame around every message, and the only place that names `bincode`.
//!
//! Byte 0 is [`WIRE_VERSION`], byte 1 the message's tag, the rest its content. Tick messages lay their content out
//! themselves ([`crate::tick`]); control messages ([`crate::control`]) are encoded here. Decoding is bounded, never
//! panics, and treats leftover bytes as an error: they come from a foreign or a broken peer.

use crate::control::Rates;
use bincode::error::{DecodeError, EncodeError};
use serde::de::DeserializeOwned;
use serde::Serialize;
use thiserror::Error;

/// Version of the wire format. Encodings are positional: reordering or adding a field changes the meaning of the
/// bytes, so any such change raises this number.
pub const WIRE_VERSION: u8 = 2;

/// Version and tag.
const FRAME_BYTES: usize = 2;

/// The longest control message is that of the largest schedule.
const LONGEST_CONTROL_MESSAGE: usize = Rates::MAX_BYTES;

/// Memory that bincode may allocate while it decodes one message. It counts eight bytes for a number that took one
/// byte on the wire; twice that leaves room for the lengths. Without a bound, a hostile length makes bincode panic.
const DECODE_LIMIT: usize = 16 * LONGEST_CONTROL_MESSAGE;

/// Why bytes cannot be decoded as the expected message, or a message cannot be sent.
#[derive(Debug, Clone, PartialEq, Eq, Error)]
pub enum WireError {
    /// Too short for a frame or a header.
    #[error("{name} message of {found} bytes: expected at least {expected}")]
    TooShort { name: &'static str, expected: usize, found: usize },
    /// The peer was built from another version of the project.
    #[error(
        "message of wire version {theirs}: this program speaks version {ours}; \
         install the same version of rondo on every host"
    )]
    Version { ours: u8, theirs: u8 },
    /// A message of another type.
    #[error("message with tag {found}: expected {name}, tag {expected}")]
    Tag { name: &'static str, expected: u8, found: u8 },
    /// The header gives another length.
    #[error("{name} message of {found} bytes: its header says {expected}")]
    Length { name: &'static str, expected: u64, found: usize },
    /// Longer than this message is allowed to be.
    #[error("{name} message of {found} bytes: at most {limit} are allowed")]
    TooLong { name: &'static str, limit: usize, found: usize },
    /// Well-formed bytes with an impossible value.
    #[error("{name} message: {what}")]
    Value { name: &'static str, what: String },
    /// Bytes after the end of the message.
    #[error("{name} message followed by {extra} more bytes")]
    Trailing { name: &'static str, extra: usize },
    /// It ends before its content does.
    #[error("{name} message of {found} bytes is cut off: expected at least {expected}")]
    CutOff { name: &'static str, expected: usize, found: usize },
    /// The content does not follow the encoding.
    #[error("{name} message of {found} bytes: {what}")]
    Content { name: &'static str, what: String, found: usize },
}

/// A control message: rare, small, encoded by serde and bincode.
pub trait Message: Serialize + DeserializeOwned {
    /// Byte 1 of the message; unique among all messages, those of [`crate::tick`] included.
    const TAG: u8;
    /// The name used in errors.
    const NAME: &'static str;
    /// Longest permitted message, frame included.
    const MAX_BYTES: usize;

    /// Checks what the types cannot express. Called before sending and after receiving.
    ///
    /// # Errors
    /// A sentence fragment: what is wrong and what was expected.
    fn check(&self) -> Result<(), String> {
        Ok(())
    }
}

/// The message as it goes over the bus.
///
/// # Errors
/// [`WireError::Value`] and [`WireError::TooLong`] for a message that every receiver would reject.
pub fn encode<M: Message>(message: &M) -> Result<Vec<u8>, WireError> {
    message.check().map_err(|what| WireError::Value { name: M::NAME, what })?;
    let mut bytes = vec![WIRE_VERSION, M::TAG];
    bincode::serde::encode_into_std_write(message, &mut bytes, options())
        .map_err(|error| WireError::Value { name: M::NAME, what: unwritten(&error) })?;
    if bytes.len() > M::MAX_BYTES {
        return Err(WireError::TooLong { name: M::NAME, limit: M::MAX_BYTES, found: bytes.len() });
    }
    Ok(bytes)
}

/// The message in these bytes, all of which must belong to it.
///
/// # Errors
/// [`WireError`] for anything but a complete, permitted message of this type and version.
pub fn decode<M: Message>(bytes: &[u8]) -> Result<M, WireError> {
    check_frame(bytes, M::NAME, M::TAG, FRAME_BYTES)?;
    if bytes.len() > M::MAX_BYTES {
        return Err(WireError::TooLong { name: M::NAME, limit: M::MAX_BYTES, found: bytes.len() });
    }
    let content = &bytes[FRAME_BYTES..];
    let (message, used) = bincode::serde::decode_from_slice::<M, _>(content, options())
        .map_err(|error| unread(&error, M::NAME, bytes.len()))?;
    if used < content.len() {
        return Err(WireError::Trailing { name: M::NAME, extra: content.len() - used });
    }
    message.check().map_err(|what| WireError::Value { name: M::NAME, what })?;
    Ok(message)
}

/// bincode's own texts are those for programmers.
fn unwritten(error: &EncodeError) -> String {
    match error {
        EncodeError::Other(what) => (*what).to_owned(),
        EncodeError::OtherString(what) => what.clone(),
        _ => "it cannot be put into bytes".to_owned(),
    }
}

/// What is wrong with the content of a message of `found` bytes.
fn unread(error: &DecodeError, name: &'static str, found: usize) -> WireError {
    let what = match error {
        DecodeError::UnexpectedEnd { additional } => {
            return WireError::CutOff { name, expected: found.saturating_add(*additional), found };
        }
        DecodeError::LimitExceeded => "a length in it is larger than such a message can be".to_owned(),
        DecodeError::OutsideUsizeRange(length) => {
            format!("a length in it is {length}, which no list can have")
        }
        DecodeError::InvalidIntegerType { .. } => {
            "a number in it has more bytes than expected there".to_owned()
        }
        DecodeError::InvalidBooleanValue(byte) => format!("a byte in it is {byte}: expected 0 or 1"),
        DecodeError::Utf8 { inner } => format!("a text in it is not UTF-8: {inner}"),
        DecodeError::UnexpectedVariant { found, .. } => {
            format!("a choice in it is {found}, which does not exist")
        }
        DecodeError::Other(what) => (*what).to_owned(),
        DecodeError::OtherString(what) => what.clone(),
        _ => "it does not follow the encoding".to_owned(),
    };
    WireError::Content { name, what, found }
}

/// Checks version and tag, then that at least `shortest` bytes are there. The version comes first, because a peer of
/// another version may have other tags and other lengths.
pub(crate) fn check_frame(
    bytes: &[u8],
    name: &'static str,
    tag: u8,
    shortest: usize,
) -> Result<(), WireError> {
    let too_short = WireError::TooShort { name, expected: shortest, found: bytes.len() };
    let &[theirs, found, ..] = bytes else { return Err(too_short) };
    if theirs != WIRE_VERSION {
        return Err(WireError::Version { ours: WIRE_VERSION, theirs });
    }
    if found != tag {
        return Err(WireError::Tag { name, expected: tag, found });
    }
    if bytes.len() < shortest {
        return Err(too_short);
    }
    Ok(())
}

fn options() -> impl bincode::config::Config {
    bincode::config::standard().with_limit::<DECODE_LIMIT>()
}
