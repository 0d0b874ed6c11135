//! The learners, one file per published algorithm, and the kernels they run on.
//!
//! Pure: slices of numbers go in, numbers come out. This crate does not know that processes, worlds,
//! files or a bus exist. Every matrix is row-major `f32`; every sum has one fixed
//! order, so that the same inputs give the same bits.
//!
//! Reading order: [`ppo`] and [`iql`] are the algorithms; [`rollout`] is what they learn from; [`returns`],
//! [`reward_stats`] and [`adam`] are their parts; [`network`] and [`kernels`] are the arithmetic, and
//! [`device`] is where else it can be done.

pub mod iql;
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

pub mod device;
pub mod kernels;
