//! The exit codes of all programs. A supervisor can see from them whether to start a program again.
//!
//! The numbers are those of BSD's `sysexits.h`, which service managers and batch systems support.

/// The run or command is complete.
pub const DONE: u8 = 0;

/// The command line was wrong; trying again without changing it is useless.
pub const USAGE: u8 = 64;

/// A defect of the program itself; please report it.
pub const BUG: u8 = 70;

/// A file, folder or endpoint could not be used, for instance on a full disk, or the system refused something else
/// that is needed; repair that, then resume.
pub const IO: u8 = 74;

/// The process was stopped, or something outside was missing or is gone, for instance a peer. The same command again
/// continues the run.
pub const AGAIN: u8 = 75;

/// The configuration is wrong, or differs from that of the other processes, or a learner has diverged with it. Trying
/// again is useless: the result is the same.
pub const CONFIG: u8 = 78;
