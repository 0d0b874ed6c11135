//! The strength of opponents: mean returns of scripted teams against each of them, with standard errors. The command
//! line names files of weights (`prey*` for Tag, `adversary*` for Adversary). The built-in network, a random opponent
//! and one that does nothing are measured too.
//!
//! ```text
//! cargo bench -p envs --bench opponents -- path/prey.safetensors path/adversary.safetensors
//! ```
//!
//! The scripts: predators chase the prey, and both good agents go to the goal (mpe §8).

use std::path::Path;

use envs::{task, End, Opponent, Task, World};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;

const EPISODES: u32 = 1000;
/// An agent does nothing within this distance of its target.
const NEAR: f32 = 0.05;

/// A game, the prefix of its files, and the place of a team agent's target in its observation.
const GAMES: [(&str, &str, usize); 2] =
    [("mpe-simple-tag", "prey", 12), ("mpe-simple-adversary", "adversary", 0)];

fn main() {
    let files: Vec<String> =
        std::env::args().skip(1).filter(|argument| !argument.starts_with("--")).collect();
    for (name, role, aim) in GAMES {
        let of_role = |file: &&String| {
            let name = Path::new(file).file_name().unwrap_or_default().to_string_lossy();
            name.starts_with(role)
        };
        let mut opponents = vec![
            ("built in".to_owned(), Opponent::Builtin),
            ("random".to_owned(), Opponent::Random),
            ("still".to_owned(), Opponent::Still),
        ];
        for file in files.iter().filter(of_role) {
            let bytes = std::fs::read(file).unwrap_or_else(|error| panic!("cannot read {file}: {error}"));
            opponents.push((file.clone(), Opponent::Weights(bytes.into())));
        }
        println!("{name}: the team's return over {EPISODES} episodes");
        for (label, opponent) in opponents {
            let task = task(name).and_then(|task| task.with_opponent(&opponent));
            let task = task.unwrap_or_else(|error| panic!("{label}: {error}"));
            let Summary { mean, error } = play(&task, aim);
            println!("{mean:10.1} ± {error:4.1}  {label}");
        }
    }
}

struct Summary {
    mean: f64,
    error: f64,
}

/// Plays the script, from the same starts against every opponent.
fn play(task: &Task, aim: usize) -> Summary {
    let mut world = task.make();
    // Two generators, so that a random opponent does not change the starts.
    let (mut starts, mut chance) = (ChaCha8Rng::seed_from_u64(2024), ChaCha8Rng::seed_from_u64(7));
    let (mut sum, mut squares) = (0.0, 0.0);
    for _ in 0..EPISODES {
        world.reset(&mut starts);
        let total = episode(&mut *world, aim, &mut chance);
        sum += total;
        squares += total * total;
    }
    let n = f64::from(EPISODES);
    let mean = sum / n;
    let variance = (squares / n - mean * mean) * n / (n - 1.0);
    Summary { mean, error: (variance / n).sqrt() }
}

fn episode(world: &mut dyn World, aim: usize, rng: &mut ChaCha8Rng) -> f64 {
    let sizes = world.sizes().clone();
    let mut seen = vec![0.0; sizes.obs_size[0]];
    let (mut actions, mut rewards) = (vec![0; sizes.agents], vec![0.0; sizes.agents]);
    let mut total = 0.0;
    loop {
        for (agent, action) in actions.iter_mut().enumerate() {
            world.observe(agent, &mut seen);
            *action = towards(seen[aim], seen[aim + 1]);
        }
        let end = world.step(&actions, rng, &mut rewards);
        total += rewards.iter().sum::<f64>();
        if end != End::Running {
            return total;
        }
    }
}

/// Along the axis of the larger distance.
fn towards(dx: f32, dy: f32) -> u16 {
    if dx.abs().max(dy.abs()) < NEAR {
        0
    } else if dx.abs() > dy.abs() {
        if dx < 0.0 {
            1
        } else {
            2
        }
    } else if dy < 0.0 {
        3
    } else {
        4
    }
}
