//! A wrapper that gives all agents of a world the same sizes.

use rand::RngCore;

use crate::scene::Scene;
use crate::{End, Sizes, World};

/// Whether the agents of a world differ in their sizes.
pub(crate) fn needs_padding(sizes: &Sizes) -> bool {
    let differ = |sizes: &[usize]| sizes.iter().any(|&size| size != sizes[0]);
    differ(&sizes.obs_size) || differ(&sizes.n_actions)
}

/// Pads observations with zeros and masks with actions that are never available.
pub(crate) struct Padded {
    world: Box<dyn World>,
    sizes: Sizes,
}

impl Padded {
    pub fn new(world: Box<dyn World>) -> Padded {
        let sizes = world.sizes();
        let most = |sizes: &[usize]| vec![sizes.iter().copied().max().unwrap_or(0); sizes.len()];
        let sizes =
            Sizes { obs_size: most(&sizes.obs_size), n_actions: most(&sizes.n_actions), ..sizes.clone() };
        Padded { world, sizes }
    }
}

impl World for Padded {
    fn sizes(&self) -> &Sizes {
        &self.sizes
    }

    fn warning(&self) -> Option<String> {
        self.world.warning()
    }

    fn reset(&mut self, rng: &mut dyn RngCore) {
        self.world.reset(rng);
    }

    fn think_ahead(&mut self) {
        self.world.think_ahead();
    }

    /// A padding action does not exist for its agent, so the world treats it as doing nothing.
    fn step(&mut self, actions: &[u16], rng: &mut dyn RngCore, rewards: &mut [f64]) -> End {
        self.world.step(actions, rng, rewards)
    }

    fn shares_reward(&self) -> bool {
        self.world.shares_reward()
    }

    fn observe(&self, agent: usize, out: &mut [f32]) {
        assert_eq!(out.len(), self.sizes.obs_size[agent], "one place per observed number");
        let (seen, padding) = out.split_at_mut(self.world.sizes().obs_size[agent]);
        self.world.observe(agent, seen);
        padding.fill(0.0);
    }

    fn available(&self, agent: usize, out: &mut [u8]) {
        assert_eq!(out.len(), self.sizes.n_actions[agent], "one place per action");
        let (own, padding) = out.split_at_mut(self.world.sizes().n_actions[agent]);
        self.world.available(agent, own);
        padding.fill(0);
    }

    fn facts(&self, report: &mut dyn FnMut(&'static str, f64)) {
        self.world.facts(report);
    }

    fn scene(&self) -> Scene {
        self.world.scene()
    }

    fn copy(&self) -> Box<dyn World> {
        Box::new(Padded { world: self.world.copy(), sizes: self.sizes.clone() })
    }
}
