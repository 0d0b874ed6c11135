//! The two roles that frozen networks play, the games in which they are trained, and their files.

use std::borrow::Cow;
use std::collections::{BTreeMap, HashMap};

use safetensors::{Dtype, View};

use super::network::{EPSILON, TENSORS};
use super::{Game, Particles, Rules};
use crate::World;

/// A role of a frozen network (mpe §8).
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Role {
    /// `agent_0` of Tag.
    Prey,
    /// `adversary_0` of Adversary.
    Adversary,
}

const ARENA_RULES: Rules = Rules::Study2021;

impl Role {
    pub const ALL: [Role; 2] = [Role::Prey, Role::Adversary];

    pub fn name(self) -> &'static str {
        match self {
            Role::Prey => "prey",
            Role::Adversary => "adversary",
        }
    }

    pub fn game(self) -> Game {
        match self {
            Role::Prey => Game::Tag,
            Role::Adversary => Game::Adversary,
        }
    }

    /// Its number in the [`Role::arena`]: the reference's order, where the prey is last and the adversary first.
    pub fn agent(self) -> usize {
        self.game().layout().opponent.expect("games of roles have an opponent")
    }

    /// Numbers that it sees.
    pub fn obs_size(self) -> usize {
        self.game().layout().agents[self.agent()].obs_size
    }

    /// The built-in network, as a safetensors file; `envs/opponents/README.md` describes its origin.
    pub fn builtin(self) -> &'static [u8] {
        match self {
            Role::Prey => include_bytes!("../../opponents/prey.safetensors"),
            Role::Adversary => include_bytes!("../../opponents/adversary.safetensors"),
        }
    }

    /// The whole game for training: every agent is controlled and has its own reward. The rules are those of the 2021
    /// study, with the directions of frozen networks and the rewards that the reference's networks were trained with,
    /// such as the adversary's squared distance.
    pub fn arena(self) -> Box<dyn World> {
        Box::new(Particles::new(self.game(), ARENA_RULES))
    }

    /// The task of the arena, in which the opponent is not controlled.
    pub fn arena_task(self) -> String {
        self.game().name(ARENA_RULES)
    }
}

/// A dense layer as learners hold it: `weight` is `[in, out]`, row-major, `bias` is `[out]`.
#[derive(Debug, Clone, Copy)]
pub struct Dense<'a> {
    pub weight: &'a [f32],
    pub bias: &'a [f32],
}

/// A frozen network of these three layers as the bytes of a safetensors file, with `provenance` as its metadata.
/// Observations are not normalised. The same input gives the same bytes.
///
/// # Panics
/// If a layer has no outputs.
pub fn encode(layers: [Dense; 3], provenance: &BTreeMap<&str, String>) -> Vec<u8> {
    let inputs = layers[0].weight.len() / layers[0].bias.len();
    // A normalisation of inputs that changes nothing.
    let unit_variance = (1.0 - EPSILON) as f32;
    let mut tensors = vec![
        Tensor { shape: vec![inputs], data: vec![1.0; inputs] },
        Tensor { shape: vec![inputs], data: vec![0.0; inputs] },
        Tensor { shape: vec![inputs], data: vec![0.0; inputs] },
        Tensor { shape: vec![inputs], data: vec![unit_variance; inputs] },
    ];
    for Dense { weight, bias } in layers {
        let (inputs, outputs) = (weight.len() / bias.len(), bias.len());
        let transposed = (0..outputs).flat_map(|to| (0..inputs).map(move |from| weight[from * outputs + to]));
        tensors.push(Tensor { shape: vec![outputs, inputs], data: transposed.collect() });
        tensors.push(Tensor { shape: vec![outputs], data: bias.to_vec() });
    }
    // One entry, because several would be written in a random order.
    let provenance = serde_json::to_string(provenance).expect("strings always serialise");
    let metadata = HashMap::from([("provenance".to_owned(), provenance)]);
    safetensors::serialize(TENSORS.into_iter().zip(tensors), Some(metadata))
        .expect("shapes and lengths come from the same numbers")
}

struct Tensor {
    shape: Vec<usize>,
    data: Vec<f32>,
}

impl View for Tensor {
    fn dtype(&self) -> Dtype {
        Dtype::F32
    }
    fn shape(&self) -> &[usize] {
        &self.shape
    }
    fn data(&self) -> Cow<'_, [u8]> {
        self.data.iter().flat_map(|number| number.to_le_bytes()).collect::<Vec<u8>>().into()
    }
    fn data_len(&self) -> usize {
        4 * self.data.len()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mpe::FrozenNetwork;

    #[test]
    fn an_encoded_network_scores_as_its_layers_do() {
        // Two inputs, widths 3 and 2; numbers that are exact in float32.
        let layers = [
            Dense { weight: &[1.0, -2.0, 0.5, 4.0, 0.25, -1.0], bias: &[0.0, 1.0, -0.5] },
            Dense { weight: &[1.0, 2.0, -3.0, 0.5, 0.25, 1.0], bias: &[0.125, -20.0] },
            Dense {
                weight: &[1.0, 2.0, 3.0, 4.0, 5.0, -1.0, -1.0, -1.0, -1.0, -1.0],
                bias: &[0.0, 0.0, 0.0, 0.0, -9.0],
            },
        ];
        let provenance = BTreeMap::from([("role", "none".to_owned()), ("seed", "1".to_owned())]);
        let bytes = encode(layers, &provenance);
        assert_eq!(bytes, encode(layers, &provenance));
        let mut network = FrozenNetwork::parse(&bytes, 2).unwrap();
        // x = (1, 0.5): h1 = relu(1 + 2, -2 + 0.125 + 1, 0.5 - 0.5 - 0.5) = (3, 0, 0),
        // h2 = relu(3 + 0.125, 6 - 20) = (3.125, 0), scores 3.125 (1, 2, 3, 4, 5) - (0, 0, 0, 0, 9).
        let expected = [3.125, 6.25, 9.375, 12.5, 6.625];
        for (score, expected) in network.scores(&[1.0, 0.5]).into_iter().zip(expected) {
            assert!((score - expected).abs() < 1e-6, "{score}, expected {expected}");
        }
        assert_eq!(network.choose(&[1.0, 0.5]), 3);
    }
}
