//! The learners, one module per published algorithm, and the kernels they run on.
//!
//! Pure: the interface is slices of numbers. This crate knows no processes, worlds, files or bus; its only clock is
//! passed in ([`host`]) and measures speed. Every matrix is row-major `f32`. Every sum has one fixed order, so the
//! same inputs give the same bits.
//!
//! Reading order: [`ppo`] and [`iql`] are the algorithms, [`learner`] what they have in common; [`rollout`] holds
//! their data; [`returns`], [`reward_stats`]
//! and [`adam`] are their parts; [`network`] and [`kernels`] are the arithmetic, and [`device`] the same on a GPU.

pub mod iql;
pub mod learner;
pub mod ppo;
pub mod rollout;

mod acting;
pub mod adam;
pub mod host;
pub mod network;
pub mod params;
mod parts;
pub mod returns;
pub mod reward_stats;
pub mod saved;
mod target;
mod trained;

pub mod device;
pub mod kernels;
