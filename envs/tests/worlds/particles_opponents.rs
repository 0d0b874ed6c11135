//! The opponents of Tag and Adversary: which are accepted, how networks act under each version of the rules, and the
//! errors for invalid files. If the reference's networks are available, ours give the same scores.

use std::collections::{BTreeMap, HashMap};
use std::path::PathBuf;

use envs::mpe::{encode, Dense, FrozenNetwork, Role};
use envs::{task, End, Opponent, Task, World};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use safetensors::tensor::{Dtype, TensorView};
use serde_json::Value;

use crate::traces::text;

/// A network for `inputs` numbers that moves along x in the direction of `obs[0]`.
fn follower(inputs: usize) -> Vec<u8> {
    let mut first = vec![0.0; 2 * inputs];
    (first[0], first[1]) = (1.0, -1.0);
    encode(
        [
            Dense { weight: &first, bias: &[0.0; 2] },
            Dense { weight: &[1.0, 0.0, 0.0, 1.0], bias: &[0.0; 2] },
            // 1 is +x, 2 is -x.
            Dense { weight: &[0.0, 1.0, -1.0, 0.0, 0.0, 0.0, -1.0, 1.0, 0.0, 0.0], bias: &[0.0; 5] },
        ],
        &BTreeMap::new(),
    )
}

fn started(task: &Task, seed: u64) -> Box<dyn World> {
    let mut world = task.make();
    world.reset(&mut ChaCha8Rng::seed_from_u64(seed));
    world
}

fn sees(world: &dyn World, agent: usize) -> Vec<f32> {
    let mut seen = vec![f32::NAN; world.sizes().obs_size[agent]];
    world.observe(agent, &mut seen);
    seen
}

/// What the prey's velocity becomes in one step from rest, as predator 0 sees it.
fn prey_after_a_step(task: &Task, seed: u64, chance: &mut ChaCha8Rng) -> [f32; 2] {
    let mut world = started(task, seed);
    world.step(&[0; 3], chance, &mut [0.0; 3]);
    let seen = sees(&*world, 0);
    [seen[14], seen[15]]
}

#[test]
fn a_network_steers_as_trained_except_under_epymarl_where_it_goes_backwards() {
    for (rules, sign) in [("current", 1.0), ("2021", 1.0), ("epymarl", -1.0)] {
        let opponent = Opponent::Weights(follower(8).into());
        let task = task("mpe-simple-adversary")
            .unwrap()
            .with_opponent(&opponent)
            .unwrap()
            .with_rules(rules)
            .unwrap();
        for seed in 0..20 {
            let mut world = started(&task, seed);
            // A good agent sees landmark 0 (2, 3) and the adversary (6, 7) relative to itself.
            let to_landmark = |world: &dyn World| {
                let seen = sees(world, 0);
                seen[2] - seen[6]
            };
            let before = to_landmark(&*world);
            let mut rng = ChaCha8Rng::seed_from_u64(0);
            world.step(&[0; 2], &mut rng, &mut [0.0; 2]);
            world.step(&[0; 2], &mut rng, &mut [0.0; 2]);
            // A push is half a unit per second, and all versions show the first one by now. Who has passed the
            // landmark turns round.
            let moved = before - to_landmark(&*world);
            let forward = moved * before.signum() * sign;
            assert!((0.03..0.15).contains(&forward), "{rules}, seed {seed}: {forward}");
        }
    }
}

#[test]
fn a_still_opponent_never_pushes_and_a_random_one_does_everything_equally_often() {
    let tag = task("mpe-simple-tag").unwrap();
    let (still, random) =
        (tag.with_opponent(&Opponent::Still).unwrap(), tag.with_opponent(&Opponent::Random).unwrap());
    let mut chance = ChaCha8Rng::seed_from_u64(3);
    let mut counts = [0_u32; 5];
    for seed in 0..2000 {
        let pushed = prey_after_a_step(&random, seed, &mut chance);
        let alone = prey_after_a_step(&still, seed, &mut chance);
        // Contact acts on both alike; the difference is 0.4 along the axis of the action.
        let [x, y] = [pushed[0] - alone[0], pushed[1] - alone[1]].map(|push| (push / 0.4).round() as i32);
        let sides = [(0, 0), (-1, 0), (1, 0), (0, -1), (0, 1)];
        // Where contact makes it faster than its limit, its push cannot be computed from the speed.
        if let Some(action) = sides.iter().position(|side| *side == (x, y)) {
            counts[action] += 1;
        }
    }
    let total: u32 = counts.iter().sum();
    let expected = f64::from(total) / 5.0;
    let statistic: f64 = counts.iter().map(|&n| (f64::from(n) - expected).powi(2) / expected).sum();
    // The quantile of chi-square for p = 1e-4 and 4 degrees of freedom.
    assert!(total > 1900 && statistic < 23.5, "{counts:?}, {statistic}");
}

#[test]
fn only_a_random_opponent_draws_in_a_step() {
    let tag = task("mpe-simple-tag").unwrap();
    for (opponent, draws) in [
        (Opponent::Builtin, false),
        (Opponent::Still, false),
        (Opponent::Weights(follower(14).into()), false),
        (Opponent::Random, true),
    ] {
        let mut rng = ChaCha8Rng::seed_from_u64(3);
        let before = rng.clone();
        prey_after_a_step(&tag.with_opponent(&opponent).unwrap(), 1, &mut rng);
        assert_eq!(rng != before, draws);
    }
}

/// The team's mean return over 200 episodes in which every agent walks to what it sees at place `aim`.
fn scripted_return(task: &Task, aim: usize) -> f64 {
    let mut world = task.make();
    let (mut starts, mut chance) = (ChaCha8Rng::seed_from_u64(11), ChaCha8Rng::seed_from_u64(12));
    let agents = world.sizes().agents;
    let (mut actions, mut rewards, mut total) = (vec![0; agents], vec![0.0; agents], 0.0);
    for _ in 0..200 {
        world.reset(&mut starts);
        loop {
            for (agent, action) in actions.iter_mut().enumerate() {
                let seen = sees(&*world, agent);
                let (x, y) = (seen[aim], seen[aim + 1]);
                *action = match x.abs() > y.abs() {
                    true => 1 + u16::from(x > 0.0),
                    false => 3 + u16::from(y > 0.0),
                };
            }
            let end = world.step(&actions, &mut chance, &mut rewards);
            total += rewards.iter().sum::<f64>();
            if end != End::Running {
                break;
            }
        }
    }
    total / 200.0
}

#[test]
fn the_built_in_opponents_are_far_harder_than_a_random_one() {
    // Predators aim at the prey, good agents at the goal. `cargo bench --bench opponents` has precise numbers.
    for (name, aim) in [("mpe-simple-tag", 12), ("mpe-simple-adversary", 0)] {
        let built_in = task(name).unwrap();
        let random = built_in.with_opponent(&Opponent::Random).unwrap();
        let (hard, easy) = (scripted_return(&built_in, aim), scripted_return(&random, aim));
        assert!(hard < 0.6 * easy, "{name}: {hard} against the network, {easy} against chance");
    }
}

#[test]
fn the_lowest_of_several_best_actions_is_chosen() {
    let bytes = encode(
        [
            Dense { weight: &[1.0; 8], bias: &[0.0] },
            Dense { weight: &[1.0], bias: &[0.0] },
            Dense { weight: &[0.0, 0.0, 0.0, 0.0, 1.0], bias: &[0.0, 2.0, 0.0, 2.0, 1.0] },
        ],
        &BTreeMap::new(),
    );
    let mut network = FrozenNetwork::parse(&bytes, 8).unwrap();
    assert_eq!(network.scores(&[0.0; 8]), [0.0, 2.0, 0.0, 2.0, 1.0]);
    assert_eq!(network.choose(&[0.0; 8]), 1);
    assert_eq!(network.choose(&[1.0; 8]), 4);
}

fn refusal(name: &str, opponent: &Opponent) -> String {
    task(name).unwrap().with_opponent(opponent).map(|_| ()).unwrap_err().to_string()
}

#[test]
fn an_opponent_that_cannot_play_is_refused_with_the_reason() {
    assert_eq!(
        refusal("mpe-simple-speaker-listener", &Opponent::Still),
        "task `mpe-simple-speaker-listener`: this game has no opponent to choose"
    );
    assert_eq!(
        refusal("mpe-simple-tag", &Opponent::Weights(follower(8).into())),
        "task `mpe-simple-tag`: the opponent's weights: expected the shape [14] in tensor `in_fn.weight`, found [8]"
    );
    let garbage = refusal("mpe-simple-tag", &Opponent::Weights(b"no weights at all".as_slice().into()));
    assert!(
        garbage.starts_with("task `mpe-simple-tag`: the opponent's weights: expected a safetensors file: "),
        "{garbage}"
    );
}

#[test]
fn a_file_that_holds_no_frozen_network_is_refused_with_the_tensor_that_is_wrong() {
    type Tensors = BTreeMap<String, (Dtype, Vec<usize>, Vec<u8>)>;
    type Change<'a> = &'a dyn Fn(&mut Tensors);
    let outcome = |change: Change| {
        let bytes = follower(8);
        let file = safetensors::SafeTensors::deserialize(&bytes).unwrap();
        let mut tensors: Tensors = file
            .iter()
            .map(|(name, view)| {
                (name.to_owned(), (view.dtype(), view.shape().to_vec(), view.data().to_vec()))
            })
            .collect();
        change(&mut tensors);
        let views = tensors.iter().map(|(name, (dtype, shape, data))| {
            (name.clone(), TensorView::new(*dtype, shape.clone(), data).unwrap())
        });
        let bytes = safetensors::serialize(views.collect::<HashMap<_, _>>(), None).unwrap();
        FrozenNetwork::parse(&bytes, 8).map(|_| ()).map_err(|error| error.to_string())
    };
    let number = |tensors: &mut Tensors, name: &str, value: f32| {
        tensors.get_mut(name).unwrap().2[4..8].copy_from_slice(&value.to_le_bytes());
    };
    let all =
        "in_fn.weight, in_fn.bias, in_fn.running_mean, in_fn.running_var, fc1.weight, fc1.bias, fc2.weight, \
               fc2.bias, fc3.weight, fc3.bias";
    assert_eq!(outcome(&|_| ()), Ok(()));
    let cases: [(Change, String); 8] = [
        (
            &|t| drop(t.remove("fc2.bias")),
            format!("expected a tensor `fc2.bias`, found none; a frozen network has {all}"),
        ),
        (
            &|t| drop(t.insert("fc4.bias".to_owned(), (Dtype::F32, vec![1], vec![0; 4]))),
            format!("found a tensor `fc4.bias`, which has no meaning; a frozen network has {all}"),
        ),
        (
            &|t| t.get_mut("fc1.bias").unwrap().0 = Dtype::I32,
            "expected F32 in tensor `fc1.bias`, found I32".to_owned(),
        ),
        (
            &|t| t.get_mut("fc1.weight").unwrap().1 = vec![8, 2],
            "expected the shape [any, 8] in tensor `fc1.weight`, found [8, 2]".to_owned(),
        ),
        (
            &|t| t.get_mut("fc3.weight").unwrap().1 = vec![2, 5],
            "expected the shape [5, 2] in tensor `fc3.weight`, found [2, 5]".to_owned(),
        ),
        (
            &|t| drop(t.insert("fc1.weight".to_owned(), (Dtype::F32, vec![0, 8], vec![]))),
            "expected the shape [any, 8] in tensor `fc1.weight`, found [0, 8]".to_owned(),
        ),
        (
            &|t| number(t, "fc2.weight", f32::NAN),
            "expected finite numbers in tensor `fc2.weight`, found NaN at place 1".to_owned(),
        ),
        (
            &|t| number(t, "in_fn.running_var", -0.5),
            "expected no negative variance in tensor `in_fn.running_var`, found -0.5 at place 1".to_owned(),
        ),
    ];
    for (change, expected) in cases {
        assert_eq!(outcome(change), Err(expected));
    }
}

#[test]
fn every_cut_of_a_file_is_refused() {
    let bytes = follower(8);
    for length in 0..bytes.len() {
        assert!(FrozenNetwork::parse(&bytes[..length], 8).is_err(), "the first {length} bytes");
    }
}

/// The folder of the reference's networks, if it is here: `RONDO_OPPONENTS`, or beside the full traces.
fn reference_networks() -> Option<PathBuf> {
    let folder = match std::env::var_os("RONDO_OPPONENTS") {
        Some(folder) => PathBuf::from(folder),
        None => PathBuf::from(std::env::var_os("RONDO_GOLDEN")?).join("../data/opponents"),
    };
    folder.is_dir().then_some(folder)
}

fn reference_network(folder: &std::path::Path, role: Role) -> FrozenNetwork {
    let bytes = std::fs::read(folder.join(format!("{}.safetensors", role.name()))).unwrap();
    FrozenNetwork::parse(&bytes, role.obs_size()).unwrap()
}

fn numbers(list: &Value) -> Vec<f64> {
    list.as_array().expect("a list").iter().map(|number| number.as_f64().expect("a number")).collect()
}

#[test]
fn the_references_networks_score_and_choose_as_their_authors_recorded() {
    let Some(folder) = reference_networks() else {
        eprintln!("skipped: neither RONDO_OPPONENTS nor RONDO_GOLDEN leads to the reference's networks");
        return;
    };
    for role in Role::ALL {
        let mut network = reference_network(&folder, role);
        let pairs = std::fs::read_to_string(folder.join(format!("{}_pairs.json", role.name()))).unwrap();
        let pairs: Value = serde_json::from_str(&pairs).unwrap();
        let pairs = pairs["pairs"].as_array().unwrap();
        assert_eq!(pairs.len(), 50);
        let mut widest = 0.0_f64;
        for pair in pairs {
            let obs: Vec<f32> = numbers(&pair["obs"]).into_iter().map(|number| number as f32).collect();
            for (found, expected) in network.scores(&obs).into_iter().zip(numbers(&pair["logits_f64"])) {
                widest = widest.max((found - expected).abs());
            }
            assert_eq!(u64::from(network.choose(&obs)), pair["action"].as_u64().unwrap());
        }
        println!("{}: scores differ by up to {widest:e}", role.name());
        assert!(widest < 1e-5, "{}: {widest:e}", role.name());
    }
}

#[test]
fn the_references_networks_act_as_in_the_recorded_episodes() {
    let (Some(folder), Some(golden)) = (reference_networks(), std::env::var_os("RONDO_GOLDEN")) else {
        eprintln!("skipped: RONDO_GOLDEN does not lead to traces and the reference's networks");
        return;
    };
    for role in Role::ALL {
        let mut network = reference_network(&folder, role);
        let file = match role {
            Role::Prey => "mpe-simple-tag.jsonl.gz",
            Role::Adversary => "mpe-simple-adversary.jsonl.gz",
        };
        let (mut policy, mut seen, mut acted) = (String::new(), vec![], [0, 0]);
        for line in text(&PathBuf::from(&golden).join(file)).lines().skip(1) {
            let record: Value = serde_json::from_str(line).unwrap();
            if let Some(label) = record["policy"].as_str() {
                policy = label.to_owned();
            } else if policy.contains("net") {
                let mirrored = policy.ends_with("mirrored");
                let choice = network.choose(&seen);
                let action = if mirrored { [0, 2, 1, 4, 3][usize::from(choice)] } else { choice };
                let recorded = record["actions"][role.agent()].as_u64().unwrap();
                assert_eq!(u64::from(action), recorded, "{policy}, {line}");
                acted[usize::from(mirrored)] += 1;
            }
            seen = numbers(&record["obs"][role.agent()]).into_iter().map(|number| number as f32).collect();
        }
        // Seven episodes of each kind.
        assert_eq!(acted, [175, 175], "{}", role.name());
    }
}
