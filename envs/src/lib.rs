//! The worlds as plain structs: reset, step, observe. No bus, no tensors, no files, no clock; every random
//! draw comes from a generator that the caller passes in.
//!
//! ```
//! use rand_chacha::{rand_core::SeedableRng, ChaCha8Rng};
//!
//! let task = envs::task("lbf-8x8-2p-2f-coop")?;
//! let (mut world, mut rng) = (task.make(), ChaCha8Rng::seed_from_u64(7));
//! world.reset(&mut rng);
//! let mut rewards = [0.0; 2];
//! let end = world.step(&[1, 5], &mut rng, &mut rewards); // player 0 goes north, player 1 tries to load
//! assert_eq!(end, envs::End::Running);
//! # Ok::<(), envs::UnknownTask>(())
//! ```

// A world may use the paths of its users, `envs::World`, inside this crate too. So the world of docs/add-a-world.md is
// the same text as a doctest and as a file in this folder.
extern crate self as envs;

mod elsewhere;
mod family;
mod opponent;
mod padded;
mod task;
mod world;

pub mod conformance;
pub mod draw;
pub mod scene;

pub mod lbf;
pub mod mpe;
pub mod replay;
pub mod rware;
pub mod smaclite;

pub use family::{Family, Made, Refusal, Request, FAMILIES};
pub use opponent::Opponent;
pub use task::{named_task_of_map, task, task_of_map, tasks, Task, TaskInfo, UnknownTask};
pub use world::{End, Sizes, World};

/// Compiles the world of the guide and runs its tests.
#[cfg(doctest)]
#[doc = include_str!("../../docs/add-a-world.md")]
struct AddAWorld;
