//! Algorithms, rules, rewards and opponents that do not exist or cannot be combined.

use crate::bad_input::refused;

#[test]
fn misspelt_algorithms_are_answered_with_the_nearest_one() {
    for (algo, nearest) in [("iqll", "iql"), ("mtqll", "mtql"), ("sq", "sql"), ("mtppo2", "mtppo")] {
        let says = format!(
            "error: unknown algorithm `{algo}`: expected ippo, mtppo, sppo, iql, mtql, sql; did you mean `{nearest}`?"
        );
        refused(&["train", &format!("--algo={algo}")]).fails_with(78, &[&says]);
    }
}

#[test]
fn keys_of_another_kind_of_learner_are_refused() {
    refused(&["train", "--algo=iql", "--set=ppo.clip=0.1"]).fails_with(
        78,
        &["error: `--set ppo.clip=0.1`: `ppo` has no meaning for `iql`, whose own keys are in `q`"],
    );
    refused(&["train", "--algo=ippo", "--set=q.batch=3"]).fails_with(
        78,
        &["error: `--set q.batch=3`: `q` has no meaning for `ippo`, whose own keys are in `ppo`"],
    );
    refused(&["train", "--algo=iql", "--set=q.bach=3"])
        .fails_with(78, &["error: `--set`: `q.bach` is not a key; did you mean `q.batch`?"]);
    // A new name does not add the section of another learner.
    refused(&["train", "--algo=iql", "--set=algo.name=ippo"]).fails_with(
        78,
        &["`ppo` is missing: `algo.name` = `ippo` needs that section", "remove that section"],
    );
}

#[test]
fn numbers_that_q_learning_cannot_use_are_refused() {
    for (setting, says) in [
        ("q.batch=0", "`q.batch` is 0: expected a number from 1 to 5000"),
        ("q.buffer=0", "`q.buffer` is 0: expected a number from 1 to 1000000"),
        ("q.buffer=10", "`q.batch` is 32: expected a number from 1 to 10"),
        ("q.epsilon_start=2", "`q.epsilon_start` is 2: expected a number from 0 to 1"),
        ("q.epsilon_start=0.01", "`q.epsilon_finish` is 0.05: expected at most `q.epsilon_start`"),
        ("q.test_epsilon=-1", "`q.test_epsilon` is -1: expected a number from 0 to 1"),
        (
            "algo.target_update=1.5",
            "`algo.target_update` is 1.5: expected a whole number of update calls above 1",
        ),
    ] {
        refused(&["train", "--algo=iql", "--set", setting]).fails_with(78, &[says]);
    }
}

#[test]
fn rates_that_belong_to_another_algorithm_are_refused_by_name() {
    refused(&["train", "--algo=iql", "--lr-fast=0.2", "--lr-slow=0.1"])
        .fails_with(78, &["`algo.name` = `iql`: expected equal rates; for other rates use `mtql`"]);
    refused(&["train", "--algo=sql", "--lr-slow=0.1"]).fails_with(
        78,
        &["`algo.name` = `sql`: expected a first rate above 0 and zero for the others; for other rates use `mtql`"],
    );
}

#[test]
fn rules_that_a_family_does_not_have_are_answered_with_those_that_it_has() {
    for (task, rules, known) in [
        ("lbf-5x5-2p-1f", "v9", "v3, v2, v1, v0"),
        ("rware-tiny-2ag", "v3", "v2, v1"),
        ("mpe-simple-speaker-listener", "2020", "current, epymarl, 2021"),
    ] {
        let says = format!("error: task `{task}` has no rules `{rules}`; there are {known}");
        refused(&["train", task, &format!("--rules={rules}")]).fails_with(78, &[&says]);
    }
}

#[test]
fn rewards_and_padding_are_chosen_by_known_words() {
    refused(&["train", "--reward=median"]).fails_with(
        78,
        &["error: unknown reward `median`: expected sum, mean, individual; did you mean `mean`?"],
    );
    refused(&["train", "--pad=maybe"]).fails_with(64, &["'maybe'", "[possible values: true, false]"]);
}

#[test]
fn an_opponent_is_known_readable_and_asked_for_where_there_is_one() {
    refused(&["train", "mpe-simple-tag", "--opponent=nofile"]).fails_with(
        74,
        &["error: `--opponent nofile`: expected builtin, random, still or a file of weights, which cannot be read: "],
    );
    refused(&["train", "--opponent=random"])
        .fails_with(78, &["error: task `lbf-5x5-2p-1f`: foraging has no opponent to choose"]);
    refused(&["train", "mpe-simple-speaker-listener", "--opponent=still"])
        .fails_with(78, &["error: task `mpe-simple-speaker-listener`: this game has no opponent to choose"]);
    refused(&["train", "rware-tiny-2ag", "--opponent=random"])
        .fails_with(78, &["error: task `rware-tiny-2ag`: ", "no opponent"]);
}

#[test]
fn misspelt_tasks_of_every_family_are_answered_with_the_form_of_its_names() {
    for (task, parts) in [
        ("rware-tny-2ag", ["found `tny`; the form is rware-", "the nearest known one is `rware-tiny-2ag`"]),
        (
            "mpe-simple-tog",
            ["found `simple-tog`; the form is mpe-simple-", "the nearest known one is `mpe-simple-tag`"],
        ),
        (
            "mpe-simple-spread",
            ["is a particle world that Rondo does not have", "it has `simple-speaker-listener`"],
        ),
        ("lbf-5x5-2p-1x", ["there is no task `lbf-5x5-2p-1x`", "the nearest known one is `lbf-5x5-2p-1f"]),
    ] {
        refused(&["train", task]).fails_with(78, &parts);
    }
}

#[test]
fn devices_that_do_not_exist_or_are_not_built_in_are_refused_before_anything_starts() {
    refused(&["train", "--device=gpu"])
        .fails_with(64, &["`gpu` is not a device: expected cpu, cuda or cuda:N with the number of a GPU"]);
    if cfg!(not(feature = "cuda")) {
        for command in [&["train", "--device=cuda:1"][..], &["resume", "run", "--device=cuda:1"]] {
            refused(command).fails_with(
                78,
                &[
                    "error: `cuda:1` was requested, but this build of Rondo computes on the CPU only",
                    "hint: `cargo build --release --features cuda` builds one for GPUs",
                ],
            );
        }
    }
}
