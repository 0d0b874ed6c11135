//! Learners on a device against the same learners on the kernels. The device is candle's CPU, which runs the same
//! passes; with the feature `cuda` the ignored test repeats it on a GPU.

use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

use super::*;
use crate::iql::{self, Iql};
use crate::kernels::gru::Steps;
use crate::learner::Learner;
use crate::network::{ActWork, Activations, Kind, Network};
use crate::params::initial;
use crate::ppo::{self, Ppo};
use crate::returns::EndOfBatch;
use crate::reward_stats::Standardisation;
use crate::rollout::{End, Episode, Rollout};
use crate::saved::NamedTensor;

const OBS: usize = 7;
const ACTIONS: usize = 5;

/// Episodes of all lengths, some of them equally long.
const LENGTHS: [usize; 8] = [6, 9, 3, 9, 1, 8, 3, 17];

fn cpu() -> Device {
    Device::of_candle(candle_core::Device::Cpu)
}

fn ppo_config(actor: Kind) -> ppo::Config {
    ppo::Config {
        actor,
        hidden: 32,
        agents: 2,
        gamma: 0.97,
        epochs: 4,
        clip: 0.2,
        entropy_coef: 0.01,
        n_step: 5,
        target_update: 2.0,
        max_grad_norm: 10.0,
        end_of_batch: EndOfBatch::Epymarl,
        reward_standardisation: Standardisation::Running,
        hold_frozen_moments: false,
    }
}

fn iql_config(network: Kind) -> iql::Config {
    iql::Config {
        network,
        hidden: 32,
        agents: 2,
        gamma: 0.97,
        target_update: 0.01,
        max_grad_norm: 10.0,
        reward_standardisation: Standardisation::Off,
        hold_frozen_moments: false,
        time_limit_is_terminal: false,
        double_q: true,
    }
}

fn episodes(rng: &mut ChaCha8Rng) -> Vec<Episode> {
    let of_length = |length: usize| {
        let mut avail: Vec<u8> =
            (0..(length + 1) * ACTIONS).map(|_| rng.random_range(0..4u8).min(1)).collect();
        let actions: Vec<u16> = (0..length).map(|_| rng.random_range(0..ACTIONS as u16)).collect();
        avail.chunks_exact_mut(ACTIONS).for_each(|row| row[0] = 1);
        avail.chunks_exact_mut(ACTIONS).zip(&actions).for_each(|(row, &action)| row[usize::from(action)] = 1);
        Episode {
            obs: (0..(length + 1) * OBS).map(|_| rng.random_range(-1.0..1.0)).collect(),
            avail,
            actions,
            rewards: (0..length).map(|_| rng.random_range(-1.0..1.0)).collect(),
            end: if length.is_multiple_of(2) { End::Terminated } else { End::TimeLimit },
        }
    };
    LENGTHS.map(of_length).to_vec()
}

fn rollout(rng: &mut ChaCha8Rng) -> Rollout {
    let mut rollout = Rollout::default();
    rollout.begin(LENGTHS.len());
    for (copy, episode) in episodes(rng).iter().enumerate() {
        rollout.observe(copy, &episode.obs, &episode.avail);
        for (&action, &reward) in episode.actions.iter().zip(&episode.rewards) {
            rollout.act(copy, action);
            rollout.outcome(copy, reward, episode.end);
        }
    }
    rollout
}

/// Mean and largest absolute difference of the weights, without Adam's state.
fn distance(ours: &[NamedTensor], theirs: &[NamedTensor]) -> (f64, f64) {
    let learned = |tensors: &[NamedTensor]| -> Vec<f32> {
        let learned = tensors.iter().filter(|(name, ..)| !name.starts_with("adam."));
        learned.flat_map(|(_, _, data)| data.to_vec()).collect()
    };
    let (ours, theirs) = (learned(ours), learned(theirs));
    assert_eq!(ours.len(), theirs.len());
    let apart = ours.iter().zip(&theirs).map(|(a, b)| f64::from((a - b).abs()));
    (apart.clone().sum::<f64>() / ours.len() as f64, apart.fold(0.0, f64::max))
}

/// Ten update calls, in which a weight can move by up to 0.01 in every step of Adam. Adam turns a gradient that is
/// only a rounding error into a whole step, so single weights may differ by more than the mean.
const CALLS: usize = 10;
const MEAN_APART: f64 = 2e-6;
const LARGEST_APART: f64 = 5e-4;

fn assert_close(what: &str, call: usize, (mean, largest): (f64, f64)) {
    println!("{what}, call {call}: mean {mean:.1e}, largest {largest:.1e}");
    assert!(
        mean < MEAN_APART && largest < LARGEST_APART,
        "{what} after call {call}: mean {mean:e}, largest {largest:e}"
    );
}

fn close(what: &str, found: f64, expected: f64) {
    assert!((found - expected).abs() < 1e-4 * (1.0 + expected.abs()), "{what}: {found} {expected}");
}

/// Asserts that nothing failed, the learner has changed, and both computed the same.
fn assert_learned(
    device: &Device,
    kind: Kind,
    start: &[NamedTensor],
    here: &[NamedTensor],
    there: &[NamedTensor],
) {
    device.check().expect("nothing failed");
    assert!(distance(start, here).0 > 1e-3, "they learn");
    let apart = distance(there, here).1 > 0.0;
    assert!(
        apart || kind == Kind::Fc,
        "a recurrent network has other last bits where it is computed otherwise"
    );
}

fn ppo_follows(device: &Device, kind: Kind) {
    let mut rng = ChaCha8Rng::seed_from_u64(1);
    let mut here = Ppo::new(ppo_config(kind), OBS, ACTIONS, &mut rng);
    let (start, mut there) = (here.clone(), here.clone());
    there.compute_on(device);
    for call in 1..=CALLS {
        let rollout = rollout(&mut rng);
        let (expected, found) =
            (here.update(rollout.episodes(), 1e-3), there.update(rollout.episodes(), 1e-3));
        assert_close(&format!("PPO, {kind:?}"), call, distance(&there.tensors(), &here.tensors()));
        close("actor loss", found.actor_loss, expected.actor_loss);
        close("critic loss", found.critic_loss, expected.critic_loss);
        close("norm of the critic's gradient", found.critic_grad_norm, expected.critic_grad_norm);
    }
    assert_eq!(here.counters(), there.counters());
    assert_learned(device, kind, &start.tensors(), &here.tensors(), &there.tensors());
}

fn iql_follows(device: &Device, kind: Kind) {
    let mut rng = ChaCha8Rng::seed_from_u64(2);
    let mut here = Iql::new(iql_config(kind), OBS, ACTIONS, &mut rng);
    let (start, mut there) = (here.clone(), here.clone());
    there.compute_on(device);
    for call in 1..=CALLS {
        let episodes = episodes(&mut rng);
        let (expected, found) = (here.update(&episodes, 1e-3), there.update(&episodes, 1e-3));
        assert_close(&format!("Q-learning, {kind:?}"), call, distance(&there.tensors(), &here.tensors()));
        close("loss", found.loss, expected.loss);
        close("norm of the gradient", found.grad_norm, expected.grad_norm);
    }
    assert_eq!(here.counters(), there.counters());
    assert_learned(device, kind, &start.tensors(), &here.tensors(), &there.tensors());
}

/// A network with random weights, observations and gradient of its outputs.
struct Case {
    network: Network,
    values: Vec<f32>,
    o: Vec<f32>,
    d_out: Vec<f32>,
    steps: Steps,
}

fn case(kind: Kind, lengths: &[usize]) -> Case {
    let mut rng = ChaCha8Rng::seed_from_u64(3);
    let network = Network { kind, inputs: OBS, hidden: 24, outputs: ACTIONS };
    let steps = Steps::of_lengths(lengths);
    let values = initial(&network.blocks(), &mut rng);
    let mut random = |count: usize| (0..count).map(|_| rng.random_range(-1.0..1.0f32)).collect::<Vec<_>>();
    Case { o: random(steps.rows() * OBS), d_out: random(steps.rows() * ACTIONS), network, values, steps }
}

/// Compares outputs and gradients of both, relative to the largest number.
fn passes_agree(device: &Device, kind: Kind, lengths: &[usize]) {
    let Case { network, values, o, d_out, steps } = case(kind, lengths);
    let pass = |on: Option<Passes>| {
        let (mut work, mut gradient) = (Activations::default(), vec![0.0; values.len()]);
        work.on = on;
        // Twice, as for a batch in two parts: gradients add up.
        for _ in 0..2 {
            network.forward(&values, &o, &steps, &mut work);
            network.backward(&values, &o, &steps, &d_out, &mut work, &mut gradient);
        }
        (work.out, gradient)
    };
    let (here, there) = (pass(None), pass(device.passes()));
    for (what, ours, theirs) in [("outputs", &there.0, &here.0), ("gradient", &there.1, &here.1)] {
        assert_eq!(ours.len(), theirs.len());
        let largest = theirs.iter().fold(0.0, |largest: f32, x| largest.max(x.abs()));
        let apart = ours.iter().zip(theirs).fold(0.0, |apart: f32, (a, b)| apart.max((a - b).abs()));
        assert!(apart < 5e-6 * largest, "{what} of {kind:?} over {lengths:?}: {apart:e} of {largest:e}");
    }
}

/// Compares one tick of so many rows on both.
fn ticks_agree(device: &Device, kind: Kind, rows: usize) -> bool {
    let Case { network, values, o, .. } = case(kind, &vec![1; rows]);
    let state: Vec<f32> = (0..rows * network.hidden).map(|k| (k as f32 * 0.37).sin()).collect();
    let tick = |on: Option<Passes>| {
        let (mut work, mut state) = (ActWork::default(), state.clone());
        work.on = on;
        network.act(&values, &o, rows, &mut state, &mut work);
        (work.out, state)
    };
    let (here, there) = (tick(None), tick(device.passes()));
    for (ours, theirs) in [(&there.0, &here.0), (&there.1, &here.1)] {
        assert_eq!(ours.len(), theirs.len());
        assert!(ours.iter().zip(theirs).all(|(a, b)| (a - b).abs() < 2e-6), "{kind:?}, {rows} rows");
    }
    here == there
}

fn all(device: &Device) {
    for kind in [Kind::Fc, Kind::Gru] {
        passes_agree(device, kind, &[1]);
        passes_agree(device, kind, &[4, 4, 4]);
        passes_agree(device, kind, &[300, 41, 7, 7, 1]);
        ticks_agree(device, kind, ROWS_TO_ACT_ON_GPU + 3);
        ppo_follows(device, kind);
        iql_follows(device, kind);
    }
    device.check().expect("nothing failed");
}

#[test]
fn passes_give_the_outputs_and_gradients_of_the_kernels() {
    for kind in [Kind::Fc, Kind::Gru] {
        for lengths in [&[1][..], &[4, 4, 4], &[300, 41, 7, 7, 1], &[2, 1, 1, 1]] {
            passes_agree(&cpu(), kind, lengths);
        }
    }
}

#[test]
fn a_feed_forward_ppo_learner_follows_the_kernels() {
    ppo_follows(&cpu(), Kind::Fc);
}

#[test]
fn a_recurrent_ppo_learner_follows_the_kernels() {
    ppo_follows(&cpu(), Kind::Gru);
}

#[test]
fn a_feed_forward_q_learner_follows_the_kernels() {
    iql_follows(&cpu(), Kind::Fc);
}

#[test]
fn a_recurrent_q_learner_follows_the_kernels() {
    iql_follows(&cpu(), Kind::Gru);
}

#[test]
fn only_ticks_of_many_rows_leave_the_kernels() {
    // With a recurrent network: a feed-forward one has the same bits on both, because candle uses `gemm` too.
    assert!(
        ticks_agree(&cpu(), Kind::Gru, ROWS_TO_ACT_ON_GPU - 1),
        "below, the bits are those of the kernels"
    );
    assert!(!ticks_agree(&cpu(), Kind::Gru, ROWS_TO_ACT_ON_GPU), "from there on it is other arithmetic");
}

#[test]
fn a_checkpoint_from_a_device_goes_on_on_the_kernels() {
    let mut rng = ChaCha8Rng::seed_from_u64(4);
    let (first, second) = (rollout(&mut rng), rollout(&mut rng));
    let mut there = Ppo::new(ppo_config(Kind::Gru), OBS, ACTIONS, &mut rng);
    there.compute_on(&cpu());
    there.update(first.episodes(), 1e-3);

    let saved: Vec<(String, Vec<f32>)> =
        there.tensors().into_iter().map(|(name, _, data)| (name, data.to_vec())).collect();
    let find = |name: &str| saved.iter().find(|(n, _)| n == name).map(|(_, data)| data.as_slice());
    let mut here = Ppo::new(ppo_config(Kind::Gru), OBS, ACTIONS, &mut rng);
    here.restore(&there.counters(), find).expect("it fits");
    assert_eq!(here.tensors(), there.tensors());
    here.update(second.episodes(), 1e-3);
    there.update(second.episodes(), 1e-3);
    assert_close("one went over", 2, distance(&there.tensors(), &here.tensors()));
}

#[test]
fn a_failure_is_kept_until_somebody_asks_and_gives_zeros_meanwhile() {
    let Case { network, values, o, d_out, steps } = case(Kind::Gru, &[3, 2]);
    let device = cpu();
    let mut work = Activations::default();
    work.on = device.passes();
    // Observations of a wrong size, in place of a failing GPU.
    network.forward(&values, &o[1..], &steps, &mut work);
    assert_eq!(work.out, [0.0; 5 * ACTIONS]);
    let mut gradient = vec![9.0; values.len()];
    network.backward(&values, &o, &steps, &d_out, &mut work, &mut gradient);
    assert!(gradient.iter().all(|&x| x == 9.0), "nothing is added");
    let first = device.check().expect_err("it failed").to_string();
    assert!(first.starts_with("the computation on the GPU failed: "), "{first}");
    assert!(!first.contains("go back through") && !first.contains('\n'), "the first failure counts: {first}");
}

#[test]
fn names_of_devices_are_read_and_written() {
    for (text, name) in
        [("cpu", DeviceName::Cpu), ("cuda:0", DeviceName::Cuda(0)), ("cuda:3", DeviceName::Cuda(3))]
    {
        assert_eq!(text.parse(), Ok(name));
        assert_eq!(name.to_string(), text);
    }
    assert_eq!("cuda".parse(), Ok(DeviceName::Cuda(0)));
    for text in ["", "gpu", "cuda:", "cuda:-1", "cuda:x", "CPU"] {
        let error = text.parse::<DeviceName>().expect_err("no device").to_string();
        assert!(
            error.contains(&format!("`{text}` is not a device: expected cpu, cuda or cuda:N")),
            "{error}"
        );
    }
}

#[cfg(not(feature = "cuda"))]
#[test]
fn a_build_without_the_feature_says_how_to_get_one() {
    let error = DeviceName::Cuda(1).open().expect_err("it is not built").to_string();
    assert!(error.starts_with("`cuda:1` was requested, but this build of Rondo computes on the CPU only"));
    assert!(error.contains("`cargo build --release --features cuda`"), "{error}");
    DeviceName::Cpu.open().expect("always there");
}

#[cfg(feature = "cuda")]
#[test]
#[ignore = "needs a GPU: cargo test -p algos --features cuda -- --ignored"]
fn on_a_gpu_everything_follows_the_kernels() {
    all(&DeviceName::Cuda(0).open().expect("a GPU"));
}

#[test]
fn a_device_shared_by_learners_serves_all_of_them() {
    all(&cpu());
}
