//! Resuming Q-learning: the content of the replay buffer is part of the resumed state.

use std::collections::BTreeMap;
use std::fs::{self, File};
use std::path::{Path, PathBuf};

use nix::sys::signal::Signal;

use crate::cluster::{rondo, wait_until, Cluster, Process, RunFolder};
use crate::q_learning::{foraging, speaking, undisturbed, BUFFER, SAVE_INTERVAL};

const NOTHING: [&str; 0] = [];

/// Update calls and stored episodes in an agent's checkpoint.
fn counters(run: &RunFolder, role: &str, round: u64) -> (u64, u64) {
    let text = fs::read(run.checkpoint(role, round).join("state.bin")).expect("a state");
    let state: serde_json::Value = serde_json::from_slice(&text).expect("the state is JSON");
    let learner = &state["counters"]["Q"];
    let number = |value: &serde_json::Value| value.as_u64().expect("a number");
    (number(&learner["counters"]["update_calls"]), number(&learner["remembered"]))
}

/// Kills one role in the middle of the run, after episodes have left the buffer. The launcher must name it, and the
/// resumed run must have the usual digest.
fn a_role_is_killed(role: &str, name: &str) {
    let cluster = Cluster::new();
    let mut training = cluster.train("run", foraging(), NOTHING);
    cluster.run("run").reaches(1_800);
    training.child(role).signal(Signal::SIGKILL);
    training.wait().fails_with(75, &[&format!("error: {name}: was ended by SIGKILL")]);
    let run = cluster.run("run");
    let newest = *run.checkpoints("agent-1").last().expect("it has saved");
    assert!(newest > BUFFER, "the oldest episodes have left the buffer: {newest}");
    cluster.resume("run").succeeds();
    assert_eq!(cluster.digest("run"), undisturbed());
}

#[test]
fn an_agent_that_was_killed_goes_on_with_what_it_remembered() {
    a_role_is_killed("agent-1", "agent-1");
}

#[test]
fn agents_whose_env_server_was_killed_go_on_with_what_they_remembered() {
    a_role_is_killed("env-server", "world");
}

#[test]
fn everybody_killed_at_once_and_again_goes_on_with_what_they_remembered() {
    let cluster = Cluster::new();
    let run = cluster.run("run");
    let training = cluster.train("run", foraging(), NOTHING);
    run.reaches(1_200);
    training.kill_all();
    let resumed = cluster.resume("run");
    run.reaches(2_700);
    resumed.kill_all();
    cluster.resume("run").succeeds();
    assert_eq!(cluster.digest("run"), undisturbed());
}

#[test]
fn killed_before_the_first_update_call() {
    let cluster = Cluster::new();
    let run = cluster.run("run");
    // A warm-up long enough to interrupt it.
    let words =
        || [foraging(), ["q.batch=60", "q.buffer=70"].map(|set| format!("--set={set}")).into()].concat();
    cluster.train("undisturbed", words(), ["--in-process"]).succeeds();
    let training = cluster.train("run", words(), NOTHING);
    wait_until("a checkpoint of everybody", || {
        ["world", "agent-0", "agent-1"].iter().all(|role| !run.checkpoints(role).is_empty())
    });
    training.kill_all();
    for role in ["agent-0", "agent-1"] {
        let newest = *run.checkpoints(role).last().expect("it has saved");
        assert_eq!(counters(&run, role, newest), (0, newest), "{role} has only remembered so far");
    }
    cluster.resume("run").succeeds();
    assert_eq!(cluster.digest("run"), cluster.digest("undisturbed"));
    let newest = *run.checkpoints("agent-0").last().expect("it has saved");
    let (update_calls, remembered) = counters(&run, "agent-0", newest);
    assert_eq!(update_calls, remembered - 60 + 1, "the warm-up was counted on");
}

#[test]
fn rounds_of_several_episodes_are_resumed_and_changed_from_processes_to_threads() {
    let cluster = Cluster::new();
    let words = || [speaking(), ["--envs=3", "--set=t_max=4500"].map(str::to_owned).into()].concat();
    cluster.train("undisturbed", words(), ["--in-process"]).succeeds();
    let training = cluster.train("run", words(), NOTHING);
    cluster.run("run").reaches(600);
    training.kill_all();
    let mut threads = rondo();
    threads.arg("resume").arg(cluster.path("run")).args(["--quiet", "--in-process"]);
    Process::start(threads).succeeds();
    assert_eq!(cluster.digest("run"), cluster.digest("undisturbed"));
}

#[test]
fn an_agent_goes_back_to_the_checkpoint_before_and_to_the_buffer_of_that_time() {
    let cluster = Cluster::new();
    let run = cluster.run("run");
    cluster.train("run", foraging(), NOTHING).succeeds();
    let [before, newest] = run.checkpoints("agent-0")[..] else { panic!("two checkpoints are kept") };
    assert_eq!(before % SAVE_INTERVAL, 0);
    let weights = run.checkpoint("agent-0", newest).join("weights.safetensors");
    let bytes = fs::read(&weights).expect("weights");
    fs::write(&weights, &bytes[..bytes.len() - 100]).expect("written");
    let ended = cluster.resume("run").succeeds();
    assert!(ended.stderr.contains("skipped a damaged checkpoint"), "{ended:#?}");
    assert_eq!(cluster.digest("run"), undisturbed());
}

/// All that a resumed run needs, except its epoch, which is new at every start: its configuration, and each role's
/// checkpoints, rows and experience.
fn kept(run: &Path) -> BTreeMap<PathBuf, Vec<u8>> {
    let mut found = BTreeMap::new();
    let mut folders = vec![run.to_owned()];
    while let Some(folder) = folders.pop() {
        for entry in fs::read_dir(folder).expect("a folder") {
            let path = entry.expect("a name").path();
            let name = path.file_name().expect("it has one").to_string_lossy().into_owned();
            if path.is_dir() {
                // TensorBoard's files are written again from the rows at every start.
                if !["bus", "tensorboard"].contains(&name.as_str()) {
                    folders.push(path);
                }
            } else if !["log.jsonl", "result.json", "epoch"].contains(&name.as_str())
                && !name.starts_with('.')
            {
                found.insert(path.clone(), fs::read(&path).expect("it can be read"));
            }
        }
    }
    found
}

#[test]
fn damaged_experience_is_refused_and_left_as_it_is() {
    let cluster = Cluster::new();
    let training = cluster.train("run", foraging(), NOTHING);
    cluster.run("run").reaches(1_800);
    training.signal(Signal::SIGINT);
    assert_eq!(training.wait().code, Some(75));
    let file = cluster.path("run").join("agent-1/replay/episodes-000000000000.bin");
    let whole = fs::read(&file).expect("experience");
    let remembered = *cluster.run("run").checkpoints("agent-1").last().expect("it has saved");

    let mut flipped = whole.clone();
    *flipped.last_mut().expect("it holds something") ^= 1;
    let last = remembered - 1;
    let cut = whole.len() - 10;
    let of_file = |problem: String| {
        let path = file.display();
        format!("error: agent-1: `{path}` lacks episodes that the learner needs: {problem}")
    };
    let damages = [
        (Some(flipped), of_file(format!("record {last}, at byte "))),
        (
            Some(whole[..cut].to_vec()),
            of_file(format!("it ends before or within record {last}, at byte {cut}")),
        ),
        (None, format!("none of the {remembered} records exists")),
    ];
    for (bytes, says) in damages {
        match bytes {
            Some(bytes) => fs::write(&file, bytes).expect("written"),
            None => fs::remove_file(&file).expect("removed"),
        }
        let before = kept(&cluster.path("run"));
        let hint = "hint: files were changed or lost; copy them back, or start the run again in a new folder";
        cluster.resume("run").wait().fails_with(74, &[&says, hint]);
        let after = kept(&cluster.path("run"));
        assert_eq!(before.keys().collect::<Vec<_>>(), after.keys().collect::<Vec<_>>(), "{says}");
        assert!(before == after, "{says}");
    }

    // With the file copied back, the run continues as before.
    fs::write(&file, &whole).expect("written");
    cluster.resume("run").succeeds();
    assert_eq!(cluster.digest("run"), undisturbed());
}

#[test]
fn episodes_played_after_the_checkpoint_are_cut_off_before_they_are_played_again() {
    let cluster = Cluster::new();
    cluster.train("run", foraging(), NOTHING).succeeds();
    let run = cluster.run("run");
    let file = cluster.path("run").join("agent-0/replay/episodes-000000000000.bin");
    let whole = fs::read(&file).expect("experience");
    // As if all had been killed some episodes after their last common checkpoint, agent 0 while it wrote.
    for role in ["world", "agent-0", "agent-1"] {
        let rounds = run.checkpoints(role);
        fs::remove_dir_all(run.checkpoint(role, *rounds.last().expect("it has saved"))).expect("removed");
    }
    File::options().write(true).open(&file).expect("opened").set_len(whole.len() as u64 - 7).expect("cut");
    cluster.resume("run").succeeds();
    assert_eq!(cluster.digest("run"), undisturbed());
    assert!(fs::read(&file).expect("experience") == whole, "the same episodes again");
}
