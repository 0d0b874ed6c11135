//! Kills, cut files and flipped bits: a checkpoint is complete, or the one before is used.

use std::os::unix::fs::FileExt;

use super::*;

struct Role {
    _tmp: tempfile::TempDir,
    checkpoints: Checkpoints,
}

impl Role {
    fn new() -> Self {
        let tmp = tempfile::tempdir().unwrap();
        let checkpoints = Checkpoints::new(tmp.path().join("checkpoints"));
        Self { _tmp: tmp, checkpoints }
    }

    fn with(rounds: &[u64]) -> Self {
        let role = Self::new();
        for &round in rounds {
            role.checkpoints.save(&checkpoint(round)).unwrap();
        }
        role
    }

    fn file(&self, round: u64, name: &str) -> PathBuf {
        self.checkpoints.folder(round).join(name)
    }

    fn names(&self) -> Vec<String> {
        files::names(&self.checkpoints.path).unwrap()
    }

    fn rounds(&self) -> Vec<u64> {
        self.checkpoints.rounds().unwrap()
    }

    fn problem(&self, round: u64) -> String {
        match self.checkpoints.load(round).unwrap_err() {
            Error::DamagedCheckpoint { path, problem } => {
                assert_eq!(path, self.checkpoints.folder(round));
                problem
            }
            other => panic!("{other}"),
        }
    }
}

fn checkpoint(round: u64) -> Checkpoint {
    let tensor =
        |name: &str, data: &[f32]| Tensor { name: name.into(), shape: vec![data.len()], data: data.into() };
    Checkpoint {
        round,
        state: format!("{{\"updates\":{round}}}").into_bytes(),
        tensors: vec![tensor("actor.w", &[0.1, -2.0, round as f32]), tensor("adam.actor.w.m", &[1e-20])],
    }
}

#[test]
fn a_saved_round_is_loaded_bit_for_bit() {
    let role = Role::with(&[120]);
    assert_eq!(role.names(), ["round-000000000120"]);
    assert_eq!(files::names(&role.checkpoints.folder(120)).unwrap(), [MANIFEST, STATE, WEIGHTS]);
    assert_eq!(role.checkpoints.load(120).unwrap(), checkpoint(120));
}

#[test]
fn an_unsaved_round_is_answered_with_those_that_are_there() {
    let role = Role::with(&[10, 20]);
    let error = role.checkpoints.load(30).unwrap_err();
    let path = role.checkpoints.path.display();
    assert_eq!(
        error.to_string(),
        format!("there is no checkpoint of round 30 in `{path}`, only of [10, 20]")
    );
    assert!(Role::new().rounds().is_empty());
}

#[test]
fn the_newest_two_rounds_stay() {
    let role = Role::with(&[10, 20, 30, 40]);
    assert_eq!(role.rounds(), [30, 40]);
    assert_eq!(role.names(), ["round-000000000030", "round-000000000040"]);
}

#[test]
fn rounds_of_more_than_twelve_digits_are_still_in_order() {
    let large = 3_000_000_000_000;
    let role = Role::with(&[999_999_999_999, large]);
    assert_eq!(role.rounds(), [999_999_999_999, large]);
}

#[test]
fn pruning_never_counts_a_damaged_round_as_one_to_fall_back_to() {
    let role = Role::with(&[10, 20]);
    fs::remove_file(role.file(20, MANIFEST)).unwrap();
    role.checkpoints.save(&checkpoint(30)).unwrap();
    assert_eq!(role.names(), ["round-000000000010", "round-000000000030"]);

    let weights = fs::read(role.file(30, WEIGHTS)).unwrap();
    fs::write(role.file(30, WEIGHTS), &weights[1..]).unwrap();
    role.checkpoints.save(&checkpoint(40)).unwrap();
    assert_eq!(role.rounds(), [10, 40]);
}

#[test]
fn a_save_that_was_killed_is_ignored_and_removed_by_the_next() {
    let role = Role::with(&[10]);
    let unfinished = role.checkpoints.path.join(".writing-round-000000000020");
    let half_removed = role.checkpoints.path.join(".removing-round-000000000005");
    for folder in [&unfinished, &half_removed] {
        fs::create_dir(folder).unwrap();
        fs::write(folder.join(WEIGHTS), "half").unwrap();
    }
    assert_eq!(role.rounds(), [10]);
    assert!(unfinished.is_dir(), "a reader must leave alone what may be being written");
    role.checkpoints.save(&checkpoint(20)).unwrap();
    assert_eq!(role.names(), ["round-000000000010", "round-000000000020"]);
    assert_eq!(role.checkpoints.load(20).unwrap(), checkpoint(20));
}

#[test]
fn a_save_that_fails_leaves_the_earlier_rounds_and_nothing_else() {
    let role = Role::with(&[10, 20]);
    let mut wrong = checkpoint(30);
    wrong.tensors[0].shape = vec![7];
    assert_eq!(
        role.checkpoints.save(&wrong).unwrap_err().to_string(),
        "cannot save round 30: tensor `actor.w` has the shape [7], but 3 elements"
    );
    assert_eq!(role.names(), ["round-000000000010", "round-000000000020"]);
}

#[test]
fn the_round_before_is_used_when_a_file_is_missing_or_cut() {
    for name in [MANIFEST, STATE, WEIGHTS] {
        let role = Role::with(&[10, 20]);
        let bytes = fs::read(role.file(20, name)).unwrap();
        let file = fs::OpenOptions::new().write(true).open(role.file(20, name)).unwrap();
        for length in (0..bytes.len()).rev() {
            file.set_len(length as u64).unwrap();
            // Without its last newline the manifest is still complete.
            let whole: &[u64] = if name == MANIFEST && length + 1 == bytes.len() { &[10, 20] } else { &[10] };
            assert_eq!(role.rounds(), whole, "{name} cut to {length} bytes");
        }
        fs::remove_file(role.file(20, name)).unwrap();
        assert_eq!(role.rounds(), [10]);
        assert_eq!(role.problem(20), format!("cannot read {name}: No such file or directory (os error 2)"));
        assert_eq!(role.checkpoints.load(10).unwrap(), checkpoint(10));
    }
}

#[test]
fn every_flipped_bit_is_detected() {
    let role = Role::with(&[10, 20]);
    for name in [MANIFEST, STATE, WEIGHTS] {
        let bytes = fs::read(role.file(20, name)).unwrap();
        // In place: some file systems take a millisecond to rewrite a whole file.
        let file = fs::OpenOptions::new().write(true).open(role.file(20, name)).unwrap();
        for (i, byte) in bytes.into_iter().enumerate() {
            for bit in 0..8 {
                file.write_all_at(&[byte ^ (1 << bit)], i as u64).unwrap();
                assert!(role.checkpoints.load(20).is_err(), "{name}, byte {i}, bit {bit}");
            }
            file.write_all_at(&[byte], i as u64).unwrap();
        }
        assert_eq!(role.checkpoints.load(20).unwrap(), checkpoint(20));
    }
}

#[test]
fn what_is_wrong_with_a_checkpoint_is_said() {
    let role = Role::with(&[10, 20]);
    fs::write(role.file(20, STATE), "{}").unwrap();
    assert_eq!(role.problem(20), "state.bin is not the file that manifest.json describes");

    fs::remove_dir_all(role.checkpoints.folder(20)).unwrap();
    fs::rename(role.checkpoints.folder(10), role.checkpoints.folder(20)).unwrap();
    assert_eq!(role.problem(20), "manifest.json is that of another checkpoint");

    let text = fs::read_to_string(role.file(20, MANIFEST)).unwrap();
    fs::write(role.file(20, MANIFEST), text.replace("\"format_version\": 1", "\"format_version\": 2"))
        .unwrap();
    assert_eq!(role.problem(20), "it has format version 2, this program reads 1");
    let error = role.checkpoints.load(20).unwrap_err();
    assert!(error.is_io() && !error.is_config());
}

#[test]
fn a_round_saved_again_replaces_the_one_that_is_there() {
    let role = Role::with(&[10, 20]);
    fs::write(role.file(20, WEIGHTS), "damaged").unwrap();
    role.checkpoints.save(&checkpoint(20)).unwrap();
    assert_eq!(role.checkpoints.load(20).unwrap(), checkpoint(20));

    let other = Checkpoint { state: b"other".to_vec(), ..checkpoint(20) };
    role.checkpoints.save(&other).unwrap();
    assert_eq!(role.checkpoints.load(20).unwrap(), other);
    assert_eq!(role.names(), ["round-000000000010", "round-000000000020"]);
}

#[test]
fn a_run_that_goes_back_drops_the_later_rounds() {
    let role = Role::with(&[10, 20]);
    fs::create_dir(role.checkpoints.folder(30)).unwrap();
    role.checkpoints.discard_after(10).unwrap();
    assert_eq!(role.names(), ["round-000000000010"]);
    role.checkpoints.discard_after(10).unwrap();
    assert_eq!(role.rounds(), [10]);
    Role::new().checkpoints.discard_after(0).unwrap();
}

#[test]
fn saving_an_earlier_round_does_not_touch_later_ones() {
    let role = Role::with(&[10, 20, 5]);
    assert_eq!(role.rounds(), [5, 10, 20]);
}
