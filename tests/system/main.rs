//! The whole system: real processes on real sockets, stopped, killed, cut off from their disk and lied to.
//!
//! Almost every test ends with the same question: does the run come to the same digest? [`cluster`] hides
//! folders, processes and cleanup; the other files tell one story each.

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
