//! Opponents: chosen by name or by a file, stored with the run, and the same until its end.

use std::fs;
use std::path::PathBuf;

use nix::sys::signal::Signal;

use crate::bad_input::refused;
use crate::cluster::{rondo, Cluster, Process};
use crate::hosts::Hosts;

/// The opponent's file in a run folder.
const KEPT: &str = "opponent.safetensors";

/// Numbers that the prey of Tag sees.
const PREY_SEES: usize = 14;

/// A short run of three predators.
fn tag() -> Vec<String> {
    let words = [
        "mpe-simple-tag",
        "--t-max=6000",
        "--envs=5",
        "--switch-period=3",
        "--test-interval=2000",
        "--test-episodes=10",
        "--set=algo.hidden=8",
        "--set=save.interval=4",
        "--set=log.interval=125",
    ];
    words.map(str::to_owned).into()
}

/// The file of a frozen network that always chooses the same action.
fn network(inputs: usize, action: usize) -> Vec<u8> {
    let mut scores = vec![0.0; 5];
    scores[action] = 1.0;
    let (zeros, ones) = (|count: usize| vec![0.0_f32; count], vec![1.0; inputs]);
    let tensors = [
        ("in_fn.weight", vec![inputs], ones.clone()),
        ("in_fn.bias", vec![inputs], zeros(inputs)),
        ("in_fn.running_mean", vec![inputs], zeros(inputs)),
        ("in_fn.running_var", vec![inputs], ones),
        ("fc1.weight", vec![2, inputs], zeros(2 * inputs)),
        ("fc1.bias", vec![2], zeros(2)),
        ("fc2.weight", vec![2, 2], zeros(4)),
        ("fc2.bias", vec![2], zeros(2)),
        ("fc3.weight", vec![5, 2], zeros(10)),
        ("fc3.bias", vec![5], scores),
    ];
    // Safetensors: the length of a JSON header, the header, the numbers.
    let (mut header, mut data) = (serde_json::Map::new(), Vec::new());
    for (name, shape, values) in tensors {
        let start = data.len();
        data.extend(values.iter().flat_map(|value| value.to_le_bytes()));
        let entry = serde_json::json!({"dtype": "F32", "shape": shape, "data_offsets": [start, data.len()]});
        header.insert(name.to_owned(), entry);
    }
    let header = serde_json::to_vec(&header).expect("names and numbers");
    [&(header.len() as u64).to_le_bytes()[..], &header, &data].concat()
}

/// A file in the test's folder, as the word of a command line.
fn opponent_file(cluster: &Cluster, name: &str, bytes: &[u8]) -> (PathBuf, String) {
    let path = cluster.path(name);
    fs::write(&path, bytes).expect("written");
    let word = format!("--opponent={}", path.display());
    (path, word)
}

fn digest_of_training(cluster: &Cluster, run: &str, more: &[&str]) -> String {
    cluster.train(run, tag(), more).succeeds();
    cluster.digest(run)
}

#[test]
fn other_opponents_lead_to_other_results_and_each_to_one() {
    let cluster = Cluster::new();
    let of =
        |name: &str, more: &[&str]| digest_of_training(&cluster, name, &[more, &["--in-process"]].concat());
    let builtin = of("builtin", &[]);
    let (random, still) = (of("random", &["--opponent=random"]), of("still", &["--opponent=still"]));
    assert!(random != still && random != builtin && still != builtin);
    assert_eq!(digest_of_training(&cluster, "processes", &["--opponent=random"]), random);

    let (path, word) = opponent_file(&cluster, "network.safetensors", &network(PREY_SEES, 1));
    let weights = of("weights", &[&word]);
    assert!(weights != random && weights != still && weights != builtin);
    // A network that always does nothing plays like the opponent `still`.
    fs::write(path, network(PREY_SEES, 0)).expect("written");
    assert_eq!(of("idle", &[&word]), still);
    for run in ["builtin", "random", "still"] {
        assert!(!cluster.path(run).join(KEPT).exists(), "{run} needs no file");
    }
}

#[test]
fn adversary_has_opponents_to_choose_from_too() {
    let cluster = Cluster::new();
    let words = || tag().into_iter().map(|word| word.replace("simple-tag", "simple-adversary")).collect();
    let digests = ["--opponent=builtin", "--opponent=random", "--opponent=still"].map(|word| {
        let run = &word["--opponent=".len()..];
        cluster.train(run, words(), [word, "--in-process"]).succeeds();
        cluster.digest(run)
    });
    assert!(digests[0] != digests[1] && digests[1] != digests[2] && digests[0] != digests[2]);
}

#[test]
fn a_file_of_weights_is_copied_into_the_run_which_needs_no_other() {
    let cluster = Cluster::new();
    let bytes = network(PREY_SEES, 2);
    let (path, word) = opponent_file(&cluster, "network.safetensors", &bytes);
    let undisturbed = digest_of_training(&cluster, "undisturbed", &[&word, "--in-process"]);
    let training = cluster.train("run", tag(), [&word]);
    cluster.run("run").reaches(1_000);
    training.signal(Signal::SIGINT);
    assert_eq!(training.wait().code, Some(75));
    fs::remove_file(path).expect("removed");

    let kept = cluster.path("run").join(KEPT);
    assert!(fs::read(&kept).expect("a copy") == bytes);
    let config = fs::read_to_string(cluster.path("run").join("config.toml")).expect("it was written");
    let digest = store::digest_of(&bytes);
    assert!(config.contains(&format!("opponent = \"{digest}\"")), "{config}");

    // Another file would be another world.
    let other = network(PREY_SEES, 3);
    fs::write(&kept, &other).expect("written");
    let says = format!(
        "{} is not the opponent of this run: `world.opponent` is {digest}, the file has the digest {}",
        kept.display(),
        store::digest_of(&other)
    );
    cluster.resume("run").wait().fails_with(78, &[&says]);
    let mut eval = rondo();
    eval.arg("eval").arg(cluster.path("run"));
    Process::start(eval).wait().fails_with(78, &[&says]);

    fs::remove_file(&kept).expect("removed");
    cluster.resume("run").wait().fails_with(
        74,
        &[
            &format!("cannot read the opponent's weights in {}: No such file", kept.display()),
            "hint: copy there the file that the run was started with (its digest is `world.opponent`)",
        ],
    );
    fs::write(&kept, &bytes).expect("written");
    cluster.resume("run").succeeds();
    assert_eq!(cluster.digest("run"), undisturbed);
    let mut eval = rondo();
    eval.arg("eval").arg(cluster.path("run")).arg("--episodes=3");
    Process::start(eval).succeeds();
}

#[test]
fn each_seed_of_a_sweep_keeps_the_file() {
    let cluster = Cluster::new();
    let bytes = network(PREY_SEES, 4);
    let (_, word) = opponent_file(&cluster, "network.safetensors", &bytes);
    cluster.train("sweep", tag(), [&word, "--seeds=2", "--jobs=2", "--in-process"]).succeeds();
    for seed in ["sweep/seed-1", "sweep/seed-2"] {
        assert!(fs::read(cluster.path(seed).join(KEPT)).expect("a copy") == bytes, "{seed}");
    }
}

#[test]
fn an_env_server_on_its_own_host_is_given_the_file_and_takes_no_other() {
    let files = Cluster::new();
    let bytes = network(PREY_SEES, 2);
    let (_, word) = opponent_file(&files, "network.safetensors", &bytes);
    let (_, wrong) = opponent_file(&files, "other.safetensors", &network(PREY_SEES, 3));
    let hosts = Hosts::new([tag(), vec![word.clone()]].concat());
    let kept = hosts.folder("world").join(KEPT);

    let hint = "hint: copy there the file that the run was started with";
    hosts.start_env_server(&[]).wait().fails_with(74, &["cannot read the opponent's weights in ", hint]);
    for present in [false, true] {
        hosts
            .start_env_server(&[&wrong])
            .wait()
            .fails_with(78, &["other.safetensors is not the opponent of this run: `world.opponent` is "]);
        assert_eq!(fs::read(&kept).ok(), present.then(|| bytes.clone()), "nothing takes its place");
        if !present {
            fs::write(&kept, &bytes).expect("written");
        }
    }
    fs::remove_file(&kept).expect("removed");

    let servers = [hosts.start_env_server(&[&word]), hosts.start_coordinator(&[])];
    let agents = [0, 1, 2].map(|id| hosts.start_agent(id, &[]));
    for process in agents.into_iter().chain(servers) {
        process.succeeds();
    }
    assert!(fs::read(&kept).expect("a copy") == bytes);
    let cluster = Cluster::new();
    let here = digest_of_training(&cluster, "here", &[&word, "--in-process"]);
    assert_eq!(hosts.merged_digest(), here);
}

#[test]
fn a_file_that_is_no_opponent_for_the_game_is_refused_with_what_was_expected() {
    let cluster = Cluster::new();
    let train = |bytes: &[u8], task: &str, says: &str| {
        let (_, word) = opponent_file(&cluster, "network.safetensors", bytes);
        refused(&["train", task, &word]).fails_with(78, &["error: task `", says]);
    };
    train(
        &network(PREY_SEES - 1, 0),
        "mpe-simple-tag",
        "the opponent's weights: expected the shape [14] in tensor `in_fn.weight`, found [13]",
    );
    train(
        &network(PREY_SEES, 0),
        "mpe-simple-adversary",
        "the opponent's weights: expected the shape [8] in tensor `in_fn.weight`, found [14]",
    );
    let whole = network(PREY_SEES, 0);
    let cut = &whole[..whole.len() - 1];
    for bytes in [&b"no weights"[..], b"", cut] {
        train(bytes, "mpe-simple-tag", "the opponent's weights: expected a safetensors file: ");
    }
    train(&whole, "lbf-5x5-2p-1f", "foraging has no opponent to choose");
    let checkpoint = trained_weights();
    train(&checkpoint, "mpe-simple-tag", "a frozen network has in_fn.weight, ");
}

/// The weights of an agent of Rondo's, which are in another form.
fn trained_weights() -> Vec<u8> {
    let cluster = Cluster::new();
    cluster.train("run", tag(), ["--opponent=still", "--set=t_max=1", "--in-process"]).succeeds();
    let run = cluster.run("run");
    let newest = *run.checkpoints("agent-0").last().expect("it has saved");
    fs::read(run.checkpoint("agent-0", newest).join("weights.safetensors")).expect("weights")
}

#[test]
fn a_run_in_processes_keeps_its_opponent_through_a_kill() {
    let cluster = Cluster::new();
    let undisturbed = digest_of_training(&cluster, "undisturbed", &["--opponent=random", "--in-process"]);
    let training = cluster.train("run", tag(), ["--opponent=random"]);
    cluster.run("run").reaches(1_000);
    training.kill_all();
    cluster.resume("run").succeeds();
    assert_eq!(cluster.digest("run"), undisturbed);
}

/// The note in a run's `result.json` about comparing its returns with published ones.
fn not_comparable(cluster: &Cluster, run: &str) -> serde_json::Value {
    let text = fs::read_to_string(cluster.path(run).join("result.json")).expect("a result");
    let result: serde_json::Value = serde_json::from_str(&text).expect("JSON");
    result["not_comparable"].clone()
}

#[test]
fn a_run_against_our_own_opponent_says_that_the_papers_is_another_one() {
    let says = |task: &str, who: &str| {
        format!("the opponent in {task} is Rondo's own ({who}), not the reference's, which is not included: returns ")
    };
    for game in ["mpe-simple-tag", "mpe-simple-adversary"] {
        let cluster = Cluster::new();
        let words = || tag().into_iter().map(|word| word.replace("mpe-simple-tag", game)).collect();
        let ended = cluster.train("paper", words(), ["--paper", "--in-process"]).succeeds();
        let expected = says(&format!("{game}-2021"), "builtin");
        let note = format!("note: {expected}");
        assert_eq!(ended.stderr.matches(&note).count(), 1, "{ended:#?}");
        assert!(ended.stdout.contains(&format!("not comparable   {expected}")), "{ended:#?}");
        let result = not_comparable(&cluster, "paper");
        assert!(result.as_str().is_some_and(|text| text.starts_with(&expected)), "{result}");

        // Resuming and reading it.
        let ended = cluster.resume_with("paper", ["--t-max=7000", "--in-process"]).succeeds();
        assert_eq!(ended.stderr.matches(&note).count(), 1, "{ended:#?}");
        let mut eval = rondo();
        eval.arg("eval").arg(cluster.path("paper")).arg("--episodes=2");
        let ended = Process::start(eval).succeeds();
        assert!(ended.stdout.contains(&format!("not comparable   {expected}")), "{ended:#?}");
        let mut compare = rondo();
        compare.arg("compare").arg(cluster.path("paper"));
        let ended = Process::start(compare).succeeds();
        assert_eq!(ended.stderr.matches(&note).count(), 1, "{ended:#?}");
    }
    let cluster = Cluster::new();
    let ended = cluster.train("random", tag(), ["--opponent=random", "--in-process"]).succeeds();
    assert!(ended.stderr.contains(&says("mpe-simple-tag", "random")), "{ended:#?}");
}

#[test]
fn a_run_without_an_opponent_of_ours_says_nothing_about_it() {
    let cluster = Cluster::new();
    let (_, word) = opponent_file(&cluster, "network.safetensors", &network(PREY_SEES, 1));
    let speaking =
        || tag().into_iter().map(|word| word.replace("simple-tag", "simple-speaker-listener")).collect();
    let weights = cluster.train("weights", tag(), [word.as_str(), "--in-process"]).succeeds();
    let speaker =
        cluster.train("speaker", speaking(), ["--paper", "--profile=rondo", "--in-process"]).succeeds();
    for (run, ended) in [("weights", weights), ("speaker", speaker)] {
        assert_eq!(ended.stderr, "", "{run}");
        assert!(!ended.stdout.contains("not comparable"), "{ended:#?}");
        assert!(not_comparable(&cluster, run).is_null(), "{run}");
    }
}
