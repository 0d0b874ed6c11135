//! Save and resume: after any end of a run, resuming it gives the digest of an undisturbed run.

use std::fs;
use std::path::Path;

use nix::fcntl::{Flock, FlockArg};
use nix::sys::signal::Signal;

use crate::cluster::{experiment, short, undisturbed, wait_until, Cluster, Ended};

const NOTHING: [&str; 0] = [];

/// Rounds between checkpoints in these experiments.
const SAVE_INTERVAL: u64 = 4;

#[track_caller]
fn resumes(cluster: &Cluster) -> Ended {
    let ended = cluster.resume("run").succeeds();
    assert_eq!(cluster.digest("run"), undisturbed());
    ended
}

#[test]
fn an_interrupted_run_saves_says_how_to_go_on_and_comes_to_the_same_digest() {
    let cluster = Cluster::new();
    let training = cluster.train("run", short(), NOTHING);
    cluster.run("run").reaches(2_000);
    training.signal(Signal::SIGINT);
    let ended = training.wait();
    assert_eq!(ended.code, Some(75), "{ended:#?}");
    let advice = format!("stopped early; continue with `rondo resume {}`", cluster.path("run").display());
    assert!(ended.stdout.contains(&advice), "{ended:#?}");

    // Every role saved the state at which it left.
    let newest = |role: &str| cluster.run("run").checkpoints(role).last().copied();
    let (world, first, second) = (newest("world"), newest("agent-0"), newest("agent-1"));
    assert!(world.is_some_and(|round| round > 0));
    assert_eq!((world, world), (first, second));
    resumes(&cluster);
}

#[test]
fn a_run_in_threads_is_interrupted_and_resumed_in_processes() {
    let cluster = Cluster::new();
    let training = cluster.train("run", short(), ["--in-process"]);
    cluster.run("run").reaches(2_000);
    training.signal(Signal::SIGTERM);
    assert_eq!(training.wait().code, Some(75));
    resumes(&cluster);
}

#[test]
fn a_finished_run_is_resumed_without_changing_anything() {
    let cluster = Cluster::new();
    cluster.train("run", short(), NOTHING).succeeds();
    resumes(&cluster);
}

/// Kills every process of the run when `moment` holds.
#[track_caller]
fn killed(cluster: &Cluster, moment: impl FnMut() -> bool, what: &str) {
    let training = cluster.train("run", short(), NOTHING);
    wait_until(what, moment);
    training.kill_all();
}

#[test]
fn killed_before_the_first_checkpoint() {
    let cluster = Cluster::new();
    // The interval of checkpoints does not affect the result.
    let training = cluster.train("run", short(), ["--set=save.interval=1000"]);
    cluster.run("run").reaches(3_000);
    training.kill_all();
    for role in ["world", "agent-0", "agent-1"] {
        assert!(cluster.run("run").checkpoints(role).is_empty(), "{role}");
    }
    resumes(&cluster);
}

#[test]
fn killed_as_soon_as_one_role_has_saved() {
    let cluster = Cluster::new();
    let run = cluster.run("run");
    killed(&cluster, || !run.checkpoints("world").is_empty(), "the env-server's first checkpoint");
    resumes(&cluster);
}

#[test]
fn killed_while_checkpoints_are_written_and_removed() {
    let cluster = Cluster::new();
    let run = cluster.run("run");
    killed(&cluster, || run.checkpoints("agent-1").len() == 2, "two checkpoints");
    // A kill in the middle of a save or a removal leaves some of the files under a special name.
    let kept = run.checkpoint("agent-1", *run.checkpoints("agent-1").last().expect("it has saved"));
    for unfinished in [".writing-round-000000000016", ".removing-round-000000000004"] {
        let folder = kept.with_file_name(unfinished);
        fs::create_dir_all(&folder).expect("created");
        fs::write(folder.join("weights.safetensors"), b"half").expect("written");
    }
    resumes(&cluster);
    let left = fs::read_dir(run.path.join("agent-1/checkpoints")).expect("a folder").count();
    assert_eq!(left, 2, "nothing but the two newest checkpoints");
}

#[test]
fn killed_in_the_middle() {
    let cluster = Cluster::new();
    let run = cluster.run("run");
    killed(&cluster, || run.t_env() > 4_500, "half of the run");
    resumes(&cluster);
}

#[test]
fn killed_in_a_test() {
    let cluster = Cluster::new();
    // Tests of a thousand episodes are long enough to interrupt one.
    let long_tests = || {
        experiment(1, 5_000)
            .into_iter()
            .chain(["test.episodes=1000", "log.interval=1"].map(|set| format!("--set={set}")))
            .collect()
    };
    cluster.train("undisturbed", long_tests(), ["--in-process"]).succeeds();
    let training = cluster.train("run", long_tests(), NOTHING);
    let run = cluster.run("run");
    let tests = || run.rows("world").iter().filter(|row| !row["test_return_mean"].is_null()).count();
    wait_until("the first test to be over", || tests() == 1);
    let due = run.rows("world").last().and_then(|row| row["t_env"].as_u64()).expect("a row") + 2_500;
    run.reaches(due);
    training.kill_all();
    assert_eq!(tests(), 1, "the second test was due and is not over");
    cluster.resume("run").succeeds();
    assert_eq!(cluster.digest("run"), cluster.digest("undisturbed"));
}

#[test]
fn killed_near_the_end() {
    let cluster = Cluster::new();
    let run = cluster.run("run");
    killed(&cluster, || run.t_env() > 8_000, "the last rounds");
    resumes(&cluster);
}

#[test]
fn killed_twice() {
    let cluster = Cluster::new();
    let run = cluster.run("run");
    killed(&cluster, || run.t_env() > 3_000, "a third of the run");
    let resumed = cluster.resume("run");
    wait_until("two thirds of the run", || run.t_env() > 6_000);
    resumed.kill_all();
    resumes(&cluster);
}

#[test]
fn one_agent_holds_a_newer_checkpoint_than_the_others() {
    let cluster = Cluster::new();
    let run = cluster.run("run");
    let two = |role: &str| run.checkpoints(role).len() == 2;
    killed(
        &cluster,
        || ["world", "agent-0", "agent-1"].iter().all(|role| two(role)),
        "two checkpoints of all",
    );
    // As if only agent 0 had made its next save: agent 1 and the world have the one before.
    for role in ["world", "agent-1"] {
        let rounds = run.checkpoints(role);
        fs::remove_dir_all(run.checkpoint(role, *rounds.last().expect("it has saved"))).expect("removed");
    }
    resumes(&cluster);
}

/// Interrupts a run beyond its second checkpoint, damages the newest one of a role, and resumes.
fn damaged(role: &str, damage: impl FnOnce(&Path)) {
    let cluster = Cluster::new();
    cluster.train("run", short(), NOTHING).succeeds();
    let run = cluster.run("run");
    let rounds = run.checkpoints(role);
    let newest = *rounds.last().expect("it has saved");
    assert_eq!(rounds.len(), 2, "the one before is kept");
    damage(&run.checkpoint(role, newest));
    let ended = resumes(&cluster);
    assert!(ended.stderr.contains("skipped a damaged checkpoint"), "{ended:#?}");
    assert!(ended.stderr.contains(&format!("round={newest}")), "{ended:#?}");
    assert!(newest > SAVE_INTERVAL);
}

#[test]
fn weights_that_were_cut_off_are_noticed_and_the_checkpoint_before_is_used() {
    damaged("agent-0", |checkpoint| {
        let path = checkpoint.join("weights.safetensors");
        let bytes = fs::read(&path).expect("weights");
        fs::write(&path, &bytes[..bytes.len() - 100]).expect("written");
    });
}

#[test]
fn a_flipped_bit_is_noticed_and_the_checkpoint_before_is_used() {
    damaged("agent-1", |checkpoint| {
        let path = checkpoint.join("weights.safetensors");
        let mut bytes = fs::read(&path).expect("weights");
        let middle = bytes.len() / 2;
        bytes[middle] ^= 0b100;
        fs::write(&path, bytes).expect("written");
    });
}

#[test]
fn a_damaged_manifest_of_the_world_is_noticed_and_the_checkpoint_before_is_used() {
    damaged("world", |checkpoint| fs::write(checkpoint.join("manifest.json"), "{").expect("written"));
}

#[test]
fn a_socket_that_is_still_held_is_waited_for_and_then_named() {
    let cluster = Cluster::new();
    let training = cluster.train("run", short(), ["--in-process"]);
    cluster.run("run").reaches(2_000);
    training.signal(Signal::SIGTERM);
    assert_eq!(training.wait().code, Some(75));
    let socket = cluster.path("run").join("bus").join("monitor.sock");
    fs::create_dir(cluster.path("run").join("bus")).expect("created");
    // As killed processes of the run that have not ended yet.
    let lock = fs::File::create(socket.with_extension("sock.lock")).expect("created");
    let lock = Flock::lock(lock, FlockArg::LockExclusiveNonblock).expect("nobody else has it");
    cluster.resume("run").wait().fails_with(
        74,
        &[
            &format!("error: cannot listen on `unixsock-stream/{}`: it is in use", socket.display()),
            "hint: another process of this run is alive; stop it, or choose another run folder",
        ],
    );
    let resumed = cluster.resume("run");
    drop(lock);
    resumed.succeeds();
    assert_eq!(cluster.digest("run"), undisturbed());
}

#[test]
fn a_run_that_goes_on_cannot_be_resumed_a_second_time() {
    let cluster = Cluster::new();
    let training = cluster.train("run", short(), ["--transport=tcp"]);
    cluster.run("run").reaches(1_000);
    let path = cluster.path("run").display().to_string();
    let says =
        format!("error: another `rondo` process is running {path}\nhint: wait until it ends, or stop it");
    cluster.resume("run").wait().fails_with(75, &[&says]);
    training.succeeds();
    assert_eq!(cluster.digest("run"), undisturbed());
}
