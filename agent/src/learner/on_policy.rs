//! Algorithms with a policy: a round is one lesson, and its episodes are not stored (algorithms §4).

use algos::device::Device;
use algos::host::{Host, Seconds};
use algos::learner::{Choice, Scalars};
use algos::rollout::Episode;
use algos::saved::NamedTensor;
use process::Failure;
use proto::Mode;
use rand_chacha::ChaCha8Rng;
use serde_json::Value;
use store::RoleFolder;

use super::algorithm::{Algorithm, Find, Rows};

/// A policy and how it chooses in tests.
pub struct OnPolicy<L> {
    pub learner: L,
    pub in_tests: Choice,
}

impl<L: algos::learner::OnPolicy> Algorithm for OnPolicy<L> {
    fn open(&mut self, _: &RoleFolder, _: bool) -> Result<(), Failure> {
        Ok(())
    }

    fn compute_on(&mut self, device: &Device) {
        self.learner.compute_on(device);
    }

    fn run_on(&mut self, host: Host) {
        self.learner.run_on(host);
    }

    fn seconds(&self) -> Seconds {
        self.learner.seconds()
    }

    fn update_calls(&self) -> u64 {
        self.learner.update_calls()
    }

    fn choose_in_tests(&mut self, choice: Choice) {
        self.in_tests = choice;
    }

    fn begin_round(&mut self, copies: usize) {
        self.learner.begin_round(copies);
    }

    fn act(&mut self, rows: &Rows, rng: &mut ChaCha8Rng, actions: &mut Vec<u16>) {
        let choice = if rows.mode == Mode::Test { self.in_tests } else { Choice::Sample };
        self.learner.act(rows.copies, rows.inputs, rows.avail, choice, rng, actions);
    }

    fn lesson_size(&self, episodes: usize) -> usize {
        episodes
    }

    fn updates_due(&self, _: usize) -> u64 {
        1
    }

    fn learn(&mut self, episodes: &[Episode], _: u64, lr: f64) -> Result<Option<Scalars>, Failure> {
        let mut scalars = self.learner.learn(episodes, lr);
        scalars.push(("lr", lr));
        Ok(Some(scalars))
    }

    fn tensors(&self) -> Vec<NamedTensor<'_>> {
        self.learner.tensors()
    }

    fn first_not_finite(&self) -> Option<(String, f32)> {
        self.learner.first_not_finite()
    }

    fn kind(&self) -> &'static str {
        L::KIND
    }

    fn counters(&self) -> Result<Value, Failure> {
        let counters = serde_json::to_value(self.learner.counters());
        Ok(counters.expect("numbers and strings always serialise"))
    }

    fn restore(&mut self, counters: &Value, tensor: &Find) -> Result<(), String> {
        let counters = serde::Deserialize::deserialize(counters).map_err(|error| error.to_string())?;
        self.learner.restore(&counters, tensor).map_err(|error| error.to_string())
    }

    fn saved(&mut self) -> Result<(), Failure> {
        Ok(())
    }
}
