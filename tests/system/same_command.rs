//! The same command again: an unfinished run continues, a finished one stays, another configuration is refused.

use nix::sys::signal::Signal;

use crate::cluster::{experiment, short, undisturbed, Cluster};

const NOTHING: [&str; 0] = [];

/// A run that was interrupted after some rounds.
fn interrupted() -> Cluster {
    let cluster = Cluster::new();
    let training = cluster.train("run", short(), NOTHING);
    cluster.run("run").reaches(2_000);
    training.signal(Signal::SIGTERM);
    assert_eq!(training.wait().code, Some(75));
    cluster
}

#[test]
fn an_unfinished_run_is_continued_and_a_finished_one_is_left() {
    let cluster = interrupted();
    let ended = cluster.train("run", short(), NOTHING).succeeds();
    let first = format!("continuing the run in {}", cluster.path("run").display());
    assert_eq!(ended.stderr.lines().next(), Some(first.as_str()), "{ended:#?}");
    assert_eq!(cluster.digest("run"), undisturbed());
    let again = cluster.train("run", short(), NOTHING).succeeds();
    assert!(again.stdout.contains("is finished: "), "{again:#?}");
    assert_eq!(cluster.digest("run"), undisturbed());
}

#[test]
fn another_configuration_in_the_same_folder_is_refused_with_the_first_key() {
    let cluster = interrupted();
    let ended = cluster.train("run", experiment(2, 9_000), NOTHING).wait();
    ended.fails_with(78, &["holds a run with another configuration: `seed` is 2 and was 1", "`--fresh`"]);
}

#[test]
fn fresh_starts_anew_under_a_new_name() {
    let cluster = interrupted();
    cluster.train("run", short(), ["--fresh"]).succeeds();
    assert_eq!(cluster.digest("run-2"), undisturbed());
}

#[test]
fn a_broken_off_sweep_is_completed_by_the_same_command_and_by_resume() {
    for resume in [false, true] {
        let cluster = Cluster::new();
        let sweep = cluster.train("sweep", short(), ["--seeds=2", "--jobs=2"]);
        cluster.run("sweep/seed-1").reaches(2_000);
        cluster.run("sweep/seed-2").reaches(1_000);
        sweep.signal(Signal::SIGHUP);
        assert_eq!(sweep.wait().code, Some(75));
        if resume {
            cluster.resume("sweep").succeeds();
        } else {
            cluster.train("sweep", short(), ["--seeds=2", "--jobs=2"]).succeeds();
        }
        assert_eq!(cluster.digest("sweep/seed-1"), undisturbed());
        cluster.train("second", experiment(2, 9_000), ["--in-process"]).succeeds();
        assert_eq!(cluster.digest("sweep/seed-2"), cluster.digest("second"));
    }
}

#[test]
fn resume_refuses_an_edited_configuration_and_names_the_key() {
    let cluster = interrupted();
    let path = cluster.path("run").join("config.toml");
    let text = std::fs::read_to_string(&path).expect("a configuration");
    let gamma = text.lines().find(|line| line.starts_with("gamma = ")).expect("it has a discount");
    std::fs::write(&path, text.replace(gamma, "gamma = 0.5")).expect("written");
    let ended = cluster.resume("run").wait();
    ended.fails_with(
        78,
        &["is not the configuration that `world` was trained with: `algo.gamma` is 0.5 and was"],
    );
    std::fs::write(&path, text).expect("written");
    cluster.resume("run").succeeds();
    assert_eq!(cluster.digest("run"), undisturbed());
}

#[test]
fn a_finished_run_can_be_trained_longer_but_not_shorter() {
    let cluster = Cluster::new();
    cluster.train("run", short(), NOTHING).succeeds();
    let resume = |t_max: &str| cluster.resume_with("run", [t_max]);
    resume("--t-max=8000")
        .wait()
        .fails_with(78, &["a run cannot continue with this change: `t_max` is 8000 and was 9000"]);
    resume("--t-max=12000").succeeds();
    assert!(cluster.run("run").t_env() >= 12_000);
}
