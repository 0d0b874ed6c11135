//! Every message, every key, the wire format and the experiment's configuration.
//!
//! This crate is pure: it opens no socket, reads no clock and touches no file, so that every role, every test and
//! every other language can agree with it by reading alone. `docs/protocol.md` says the same for people who write an
//! agent without Rust, and a test holds the two together byte by byte.
//!
//! "Spec" in comments is the specification of the algorithms that Rondo reproduces; sections are cited as `algorithms §6.2`.

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
