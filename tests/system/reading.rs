//! Reading runs: damaged and new runs are skipped and named, the others are drawn and compared.

use std::fs;

use crate::cluster::{experiment, rondo, Cluster, Ended, Process};

/// Two small finished runs below `runs/`.
fn two_seeds() -> Cluster {
    let cluster = Cluster::new();
    for seed in [1, 2] {
        let words = ["--in-process"];
        cluster.train(&format!("runs/seed-{seed}"), experiment(seed, 3_000), words).succeeds();
    }
    cluster
}

fn run(cluster: &Cluster, words: &[&str]) -> Ended {
    let mut command = rondo();
    for word in words {
        match word.strip_prefix('@') {
            Some(path) => command.arg(cluster.path(path)),
            None => command.arg(word),
        };
    }
    Process::start(command).wait()
}

#[test]
fn a_young_and_a_damaged_seed_do_not_keep_the_others_from_being_drawn_and_compared() {
    let cluster = two_seeds();
    // As during a sweep that has just started its third seed.
    let config = fs::read_to_string(cluster.path("runs/seed-1/config.toml")).expect("a configuration");
    fs::create_dir(cluster.path("runs/seed-3")).expect("created");
    let third = config.replace("seed = 1", "seed = 3");
    fs::write(cluster.path("runs/seed-3/config.toml"), third).expect("written");
    // As Python's json writes a mean over nothing, in another metric.
    let rows = cluster.path("runs/seed-2/world/metrics.jsonl");
    let text = fs::read_to_string(&rows).expect("rows");
    let start = text.find("\"return_mean\":").expect("a return") + "\"return_mean\":".len();
    let end = start + text[start..].find([',', '}']).expect("the value ends");
    fs::write(&rows, format!("{}NaN{}", &text[..start], &text[end..])).expect("written");

    let plot = run(&cluster, &["plot", "@runs", "--out", "@curves.svg"]);
    assert_eq!(plot.code, Some(0), "{plot:#?}");
    assert_eq!(plot.stderr.matches("skipped: ").count(), 1, "{plot:#?}");
    assert!(plot.stderr.contains("seed-3"), "{plot:#?}");
    assert!(fs::read_to_string(cluster.path("curves.svg")).expect("a picture").contains("(2 seeds)"));
    let scores = run(&cluster, &["compare", "@runs"]);
    assert_eq!(scores.code, Some(0), "{scores:#?}");
    for part in ["(2 seeds", "final", "mean of last 5", "best", "AUC", "standard error", "IQM"] {
        assert!(scores.stdout.contains(part), "{part} is missing in {scores:#?}");
    }
}

#[test]
fn runs_whose_numbers_mean_other_things_are_not_compared_without_a_word() {
    let cluster = Cluster::new();
    for reward in ["sum", "mean"] {
        let argument = format!("--reward={reward}");
        cluster.train(reward, experiment(1, 3_000), ["--in-process", &argument]).succeeds();
    }
    let compared = run(&cluster, &["compare", "@sum", "--reference", "@mean"]);
    let first = compared.stdout.lines().next().unwrap_or_default();
    assert!(first.contains("world.reward"), "{compared:#?}");
    assert!(compared.stdout.contains("verdict: none"), "{compared:#?}");
}

#[test]
fn rows_that_were_cut_off_a_finished_run_are_missed() {
    let cluster = two_seeds();
    for role in ["world", "agent-1"] {
        let path = cluster.path("runs/seed-2").join(role).join("metrics.jsonl");
        let whole = fs::read_to_string(&path).expect("it is there");
        let cut = whole[..whole.len() - 1].rfind('\n').expect("there are rows") + 1;
        fs::write(&path, &whole[..cut]).expect("written");
        let missing = format!("`{}` has ", path.display());
        let digest = run(&cluster, &["digest", "@runs/seed-2"]);
        assert!(digest.stdout.starts_with("digest    none, this is a part of a run\n"), "{digest:#?}");
        digest.fails_with(75, &["error: this is not the digest of the run: ", &missing, "copy it again"]);
        let metric = if role == "world" { "return_mean" } else { "agent-1/entropy" };
        for words in [&["plot", "@runs", "--out", "@p.svg"][..], &["compare", "@runs"]] {
            let read = run(&cluster, &[words, &["--metric", metric]].concat());
            assert_eq!(read.code, Some(0), "{read:#?}");
            assert_eq!(read.stderr.matches("skipped: ").count(), 1, "{read:#?}");
            assert!(read.stderr.contains(&missing), "{read:#?}");
        }
        fs::write(&path, &whole).expect("written");
    }
    let digest = run(&cluster, &["digest", "@runs/seed-2"]);
    assert_eq!((digest.code, digest.stderr.as_str()), (Some(0), ""));
}
