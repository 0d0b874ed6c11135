//! The formats of a run on disk: configuration, metric rows, checkpoints, experience.
//!
//! ```text
//! runs/<run>/config.toml                      resolved; every role must bring the same bytes
//!           /world/ /coordinator/ /agent-0/ … one folder per role, written by that role alone
//!               metrics.jsonl                 the record: one row a line, without any time
//!               log.jsonl
//!               result.json
//!               checkpoints/round-000000000120/{weights.safetensors, state.bin, manifest.json}
//!               replay/episodes-000000000000.bin  experience of a learner that replays it
//!           /tensorboard/<role>/              the rows of metrics.jsonl, written again at every start
//!           /result.json
//! ```
//!
//! A file that must be complete is written under a temporary name starting with `.writing-`, flushed to the disk, and
//! renamed. Readers ignore such names. Reading never changes a run, so a monitor or a digest may read a folder while
//! its roles write.
//!
//! Absent on purpose: the bus, the clock (only TensorBoard's files hold times, and Rondo does not read them), and the
//! meaning of a role's state. One exception: the digest skips tensors named `adam.`, the optimiser's.

mod run_folder;

mod metrics;
mod tensorboard;

mod checkpoints;
mod weights;

mod episodes;

mod digest;

mod error;
mod files;

pub use checkpoints::{Checkpoint, Checkpoints, KEEP};
pub use digest::{digest, digest_of, partial_digest, PartialDigest, RunDigest};
pub use episodes::Episodes;
pub use error::Error;
pub use metrics::{MetricsWriter, Position, Row};
pub use run_folder::{RoleFolder, RunFolder};
pub use weights::Tensor;
