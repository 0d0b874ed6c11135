//! Every message, every key, the wire format and the experiment's configuration.
//!
//! This crate is pure: it opens no socket and no file and reads no clock. `docs/protocol.md` describes the same wire
//! format for agents in other languages, and a test compares the two byte by byte.
//!
//! Comments in all crates cite `docs/spec/` by document and section: `algorithms §6.2` is `docs/spec/algorithms.md`.

pub mod codec;
pub mod config;
pub mod control;
pub mod exit;
pub mod keys;
pub mod presets;
pub mod stream;
pub mod suggest;
pub mod tick;

pub use codec::{Message, WireError, WIRE_VERSION};
pub use config::{Config, ConfigError};
pub use keys::{Key, Keys};
pub use tick::{Act, End, Mode, Observe, TickId};
