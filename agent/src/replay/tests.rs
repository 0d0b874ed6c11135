use rand_chacha::rand_core::{RngCore, SeedableRng};
use store::{RoleFolder, RunFolder};

use super::*;
use algos::rollout::End;

struct Folder {
    _tmp: tempfile::TempDir,
    role: RoleFolder,
}

impl Folder {
    fn new() -> Self {
        let tmp = tempfile::tempdir().unwrap();
        let run = RunFolder::create(tmp.path().join("run"), "name = \"a\"\n").unwrap();
        Self { role: run.role("agent-0").unwrap(), _tmp: tmp }
    }

    fn open(&self, position: u64, capacity: usize, memory_bytes: u64) -> Result<Replay, Failure> {
        Replay::open(self.role.episodes(position)?, capacity, memory_bytes)
    }
}

/// Different for every number, 1 to 7 steps long; its first reward is the number.
fn episode(number: u64) -> Episode {
    let mut rng = ChaCha8Rng::seed_from_u64(number);
    let length = 1 + (rng.next_u32() % 7) as usize;
    let mut float = || rng.next_u32() as f32 / 1e9 - 2.0;
    let mut rewards: Vec<f32> = (0..length).map(|_| float()).collect();
    rewards[0] = number as f32;
    Episode {
        obs: (0..(length + 1) * 5).map(|_| float()).collect(),
        avail: (0..(length + 1) * 3).map(|_| u8::from(float() > 0.0)).collect(),
        actions: (0..length).map(|i| (i % 3) as u16).collect(),
        rewards,
        end: if length == 7 { End::TimeLimit } else { End::Terminated },
    }
}

fn push(replay: &mut Replay, numbers: std::ops::Range<u64>) {
    for number in numbers {
        assert_eq!(replay.position(), number);
        replay.push(&episode(number)).unwrap();
    }
}

/// The numbers of a minibatch. Asserts that its episodes are those that were pushed.
fn sample(replay: &mut Replay, count: usize, rng: &mut ChaCha8Rng) -> Vec<u64> {
    let check = |found: &Episode| {
        let number = found.rewards[0] as u64;
        let pushed = episode(number);
        assert_eq!((&found.obs, &found.avail), (&pushed.obs, &pushed.avail));
        assert_eq!((&found.actions, &found.rewards), (&pushed.actions, &pushed.rewards));
        assert_eq!(found.end, pushed.end);
        number
    };
    replay.sample(count, rng).unwrap().iter().map(check).collect()
}

#[test]
fn the_newest_episodes_up_to_the_capacity_can_be_drawn_and_no_other() {
    let folder = Folder::new();
    let mut replay = folder.open(0, 10, 1 << 20).unwrap();
    let mut rng = ChaCha8Rng::seed_from_u64(1);
    assert!(replay.len() == 0);
    for number in 0..35 {
        push(&mut replay, number..number + 1);
        let len = replay.len();
        assert_eq!(len as u64, (number + 1).min(10));
        let mut drawn = sample(&mut replay, len, &mut rng);
        drawn.sort_unstable();
        assert_eq!(drawn, (number + 1 - len as u64..=number).collect::<Vec<_>>());
    }
    assert_eq!(replay.sync().unwrap(), 35);
}

#[test]
fn minibatches_are_the_same_whatever_fits_into_memory() {
    // Episodes of 1 to 7 steps take up to 220 bytes: none, a few or all of 20 are held.
    let run = |memory_bytes| {
        let folder = Folder::new();
        let mut replay = folder.open(0, 20, memory_bytes).unwrap();
        let mut rng = ChaCha8Rng::seed_from_u64(2);
        let mut all = Vec::new();
        for number in 0..60 {
            push(&mut replay, number..number + 1);
            let held: u64 = replay.held.iter().map(|record| cost(record)).sum();
            assert_eq!(held, replay.held_bytes);
            assert!(held <= memory_bytes && replay.held.len() <= 20, "{held} of {memory_bytes}");
            if replay.len() >= 8 {
                all.extend(sample(&mut replay, 8, &mut rng));
            }
        }
        (all, replay.held.len())
    };
    let (expected, held) = run(u64::MAX);
    assert_eq!(held, 20);
    for (memory_bytes, least, most) in [(0, 0, 0), (150, 0, 1), (1_000, 2, 12)] {
        let (found, held) = run(memory_bytes);
        assert_eq!(found, expected, "{memory_bytes} bytes");
        assert!((least..=most).contains(&held), "{held} held in {memory_bytes} bytes");
    }
}

#[test]
fn going_back_to_an_earlier_position_gives_the_minibatches_of_never_having_gone_on() {
    for memory_bytes in [0, 700, u64::MAX] {
        let undisturbed = Folder::new();
        let mut expected = undisturbed.open(0, 12, memory_bytes).unwrap();
        push(&mut expected, 0..30);

        let folder = Folder::new();
        let mut replay = folder.open(0, 12, memory_bytes).unwrap();
        push(&mut replay, 0..30);
        assert_eq!(replay.sync().unwrap(), 30);
        push(&mut replay, 30..41);
        drop(replay);
        let mut replay = folder.open(30, 12, memory_bytes).unwrap();

        let mut rngs = [3, 3].map(ChaCha8Rng::seed_from_u64);
        for number in 30..50 {
            assert_eq!(sample(&mut replay, 5, &mut rngs[0]), sample(&mut expected, 5, &mut rngs[1]));
            push(&mut replay, number..number + 1);
            push(&mut expected, number..number + 1);
            assert_eq!(replay.held, expected.held);
        }
    }
}

#[test]
fn every_episode_is_drawn_equally_often() {
    // 10,000 draws from 10 episodes, 1,000 expected of each; χ² with 9 degrees of freedom exceeds 27.9
    // once in a thousand times. Draws of one minibatch exclude each other, which only makes χ² smaller.
    let folder = Folder::new();
    let mut replay = folder.open(0, 10, 1 << 20).unwrap();
    push(&mut replay, 0..13);
    let mut rng = ChaCha8Rng::seed_from_u64(4);
    let mut counts = [0u32; 10];
    for _ in 0..2_500 {
        sample(&mut replay, 4, &mut rng).into_iter().for_each(|number| counts[number as usize - 3] += 1);
    }
    let chi_square: f64 = counts.iter().map(|&n| (f64::from(n) - 1_000.0).powi(2) / 1_000.0).sum();
    assert!(chi_square < 27.9, "{chi_square} {counts:?}");
}

#[test]
fn forgetting_leaves_what_the_oldest_checkpoint_counts_on() {
    let folder = Folder::new();
    let mut replay = folder.open(0, 4, 0).unwrap();
    // The first episode alone fills a segment of 64 MiB, so that it has a file of its own.
    let one_step = Episode { actions: vec![0], rewards: vec![1.0], ..Episode::default() };
    replay.push(&Episode { obs: vec![0.5; 1 << 24], avail: vec![1; 2], ..one_step }).unwrap();
    push(&mut replay, 1..9);
    let files = || std::fs::read_dir(folder.role.path().join("replay")).unwrap().count();
    assert_eq!(files(), 2);
    replay.forget_before(4).unwrap();
    assert_eq!(files(), 2, "at position 4 episode 0 can still be drawn");
    replay.forget_before(5).unwrap();
    assert_eq!(files(), 1);
    drop(replay);
    folder.open(5, 4, 0).unwrap();
    let failure = folder.open(5, 5, 0).err().expect("refused");
    assert_eq!(failure.code, exit::IO);
    assert!(failure.message.contains("the records from 0 to 0 are missing"), "{failure}");
}

#[test]
fn a_minibatch_of_more_than_there_is_and_a_foreign_record_are_refused() {
    let folder = Folder::new();
    let mut replay = folder.open(0, 10, 0).unwrap();
    push(&mut replay, 0..3);
    let mut rng = ChaCha8Rng::seed_from_u64(5);
    let failure = replay.sample(4, &mut rng).unwrap_err();
    assert_eq!(failure.code, exit::BUG);
    assert_eq!(failure.message, "a minibatch of 4 was requested, but only 3 episodes are stored");
    drop(replay);

    folder.role.episodes(0).unwrap().append(b"no episode").unwrap();
    let failure = folder.open(1, 10, 0).unwrap().sample(1, &mut rng).unwrap_err();
    assert_eq!(failure.code, exit::IO);
    assert!(failure.message.starts_with("record 0 of the experience holds no episode\nhint: "), "{failure}");
}
