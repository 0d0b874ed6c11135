//! `rondo bench`.

use process::Failure;

/// Measure training speed
#[derive(Debug, Clone, clap::Args)]
pub struct Bench {}

impl Bench {
    pub fn run(&self) -> Result<(), Failure> {
        Ok(())
    }
}
