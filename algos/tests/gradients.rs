//! Every hand-written backward pass against central finite differences of its own forward pass.

use algos::kernels::gru::Steps;
use algos::network::{Activations, Kind, Network};
use algos::params::initial;
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// `Σ w ⊙ out`, a loss whose gradient with respect to the output is `w`; summed in double precision.
fn loss(network: &Network, values: &[f32], obs: &[f32], steps: &Steps, w: &[f32]) -> f64 {
    let mut to = Activations::default();
    network.forward(values, obs, steps, &mut to);
    to.out.iter().zip(w).map(|(o, w)| f64::from(*o) * f64::from(*w)).sum()
}

/// With this step, finite differences in single precision are accurate to a few 1e-3. The tolerance is relative to the
/// largest gradient. Checks about eight parameters of every tensor.
fn check(kind: Kind, outputs: usize, lengths: &[usize]) {
    let mut rng = ChaCha8Rng::seed_from_u64(1);
    let network = Network { kind, inputs: 4, hidden: 9, outputs };
    let steps = Steps::of_lengths(lengths);
    let values = initial(&network.blocks(), &mut rng);
    let obs: Vec<f32> = (0..steps.rows() * 4).map(|_| rng.random_range(-1.0..1.0)).collect();
    let w: Vec<f32> = (0..steps.rows() * outputs).map(|_| rng.random_range(-1.0..1.0)).collect();

    let mut to = Activations::default();
    let mut gradient = vec![0.0; values.len()];
    network.forward(&values, &obs, &steps, &mut to);
    network.backward(&values, &obs, &steps, &w, &mut to, &mut gradient);

    let scale = gradient.iter().fold(0.0f32, |m, g| m.max(g.abs()));
    let mut start = 0;
    for block in network.blocks() {
        let stride = (block.len() / 8).max(1);
        for i in (start..start + block.len()).step_by(stride) {
            let at = |h: f32| {
                let mut moved = values.clone();
                moved[i] += h;
                (loss(&network, &moved, &obs, &steps, &w), f64::from(moved[i]))
            };
            // The step after rounding to a float.
            let ((up, x_up), (down, x_down)) = (at(2e-3), at(-2e-3));
            let expected = (up - down) / (x_up - x_down);
            let error = (f64::from(gradient[i]) - expected).abs();
            assert!(error < 2e-3 * f64::from(scale), "{} {i}: {} {expected}", block.name, gradient[i]);
        }
        start += block.len();
    }
}

#[test]
fn actor_and_critic_gradients_of_the_feed_forward_network() {
    check(Kind::Fc, 5, &[3, 3, 2]);
    check(Kind::Fc, 1, &[4]);
}

#[test]
fn recurrent_gradients_through_time_with_episodes_of_different_lengths() {
    check(Kind::Gru, 5, &[7, 7, 4, 1]);
    check(Kind::Gru, 3, &[1]);
    check(Kind::Gru, 2, &[20]);
}

/// A batch of sequences, the longest first, each with its rows of `width` numbers, packed by time.
fn packed(lengths: &[usize], rows: &[Vec<f32>], width: usize) -> Vec<f32> {
    let steps = (0..lengths[0]).flat_map(|t| (0..lengths.len()).map(move |k| (t, k)));
    let there = steps.filter(|&(t, k)| t < lengths[k]);
    there.flat_map(|(t, k)| rows[k][t * width..(t + 1) * width].to_vec()).collect()
}

#[test]
fn gradients_of_parts_add_up_to_that_of_the_whole_batch() {
    let lengths = [7, 7, 4, 2, 1];
    for kind in [Kind::Fc, Kind::Gru] {
        let mut rng = ChaCha8Rng::seed_from_u64(3);
        let network = Network { kind, inputs: 4, hidden: 16, outputs: 3 };
        let values = initial(&network.blocks(), &mut rng);
        let mut rows = |width: usize| -> Vec<Vec<f32>> {
            lengths.iter().map(|l| (0..l * width).map(|_| rng.random_range(-1.0..1.0)).collect()).collect()
        };
        let (obs, d_out) = (rows(4), rows(3));
        let mut to = Activations::default();
        let mut gradient = |parts: &[std::ops::Range<usize>]| {
            let mut gradient = vec![0.0; values.len()];
            for part in parts {
                let lengths = &lengths[part.clone()];
                let steps = Steps::of_lengths(lengths);
                let (obs, d_out) =
                    (packed(lengths, &obs[part.clone()], 4), packed(lengths, &d_out[part.clone()], 3));
                network.forward(&values, &obs, &steps, &mut to);
                network.backward(&values, &obs, &steps, &d_out, &mut to, &mut gradient);
            }
            gradient
        };
        let all = 0..lengths.len();
        let (whole, parts) = (gradient(std::slice::from_ref(&all)), gradient(&[0..2, 2..3, 3..5]));
        let largest = whole.iter().fold(0.0f32, |m, g| m.max(g.abs()));
        assert!(whole.iter().filter(|g| **g != 0.0).count() > whole.len() / 2, "{kind:?} has a gradient");
        // They differ in the order of summation only.
        for (whole, parts) in whole.iter().zip(&parts) {
            assert!((whole - parts).abs() < 1e-6 * largest, "{kind:?}: {whole} {parts}");
        }
    }
}

#[test]
fn acting_step_by_step_gives_the_outputs_of_the_training_pass() {
    let mut rng = ChaCha8Rng::seed_from_u64(2);
    for kind in [Kind::Fc, Kind::Gru] {
        let network = Network { kind, inputs: 4, hidden: 16, outputs: 3 };
        let values = initial(&network.blocks(), &mut rng);
        let steps = Steps::of_lengths(&[6, 6]);
        let obs: Vec<f32> = (0..12 * 4).map(|_| rng.random_range(-1.0..1.0)).collect();
        let mut to = Activations::default();
        network.forward(&values, &obs, &steps, &mut to);
        let mut state = vec![0.0; 2 * 16];
        let mut work = Default::default();
        for t in 0..6 {
            network.act(&values, &obs[t * 8..(t + 1) * 8], 2, &mut state, &mut work);
            for (a, b) in work.out.iter().zip(&to.out[t * 6..(t + 1) * 6]) {
                assert!((a - b).abs() < 1e-6, "step {t}: {a} {b}");
            }
        }
    }
}
