//! The whole system: real processes on real sockets, with stops, kills, full disks and malicious messages.
//!
//! Almost every test checks in the end that the run has the same digest. [`cluster`] hides folders, processes and
//! cleanup; each other file covers one subject.

mod cluster;

mod bad_choices;
mod bad_input;
mod battles;
mod determinism;
mod diverging;
mod faults;
mod full_disk;
mod hosts;
mod isolation;
mod learning;
mod opponents;
mod places;
mod playing;
mod python_agent;
mod q_learning;
mod reading;
mod replay;
mod resume;
mod same_command;
mod seeds;
mod strangers;
mod terminals;
mod worlds;
