//! Run folders and curve files as they are, and as they should not be.

use super::*;

/// A curve for tests of what is done with curves.
pub(crate) fn curve(label: &str, seed: u64, points: &[(u64, f64)]) -> Curve {
    Curve {
        label: label.to_owned(),
        task: "task".to_owned(),
        seed,
        settings: BTreeMap::new(),
        points: points.iter().map(|&(t_env, value)| Point { t_env, value }).collect(),
        source: PathBuf::from(format!("runs/{label}/seed-{seed}")),
    }
}

const ROWS: &str = concat!(
    "{\"t_env\":362,\"update_calls\":1,\"test_return_mean\":0.43,\"test_return_std\":0.5}\n",
    "{\"t_env\":900,\"update_calls\":2,\"return_mean\":0.1}\n",
    "{\"t_env\":1000,\"update_calls\":3,\"test_return_mean\":null}\n",
    "{\"t_env\":20528,\"update_calls\":40,\"test_return_mean\":-1e-3}\n",
);

fn config(seed: u64, rates: &str, more: &str) -> String {
    format!(
        "run = \"r-{seed}\"\nseed = {seed}\nt_max = {}\n[world]\ntask = \"lbf-8x8-2p-2f-coop\"\n\
         [algo]\nname = \"mtppo\"\n{more}\n[schedule]\nrates = {rates}\nswitch_period = 100\n",
        seed * 1000
    )
}

fn write_run(run: &Path, config: &str, rows: &str) {
    fs::create_dir_all(run.join("world")).unwrap();
    fs::write(run.join("config.toml"), config).unwrap();
    fs::write(run.join("world/metrics.jsonl"), rows).unwrap();
}

/// The only curve there.
fn load(path: &Path, metric: &str) -> Result<Curve, Error> {
    super::load(path, metric).map(|(curve, _)| curve)
}

fn points(curve: &Curve) -> Vec<(u64, f64)> {
    curve.points.iter().map(|point| (point.t_env, point.value)).collect()
}

#[test]
fn a_run_folder_becomes_a_labelled_curve_without_the_rows_that_lack_the_metric() {
    let folder = tempfile::tempdir().unwrap();
    write_run(folder.path(), &config(3, "[2e-4, 5e-5]", ""), ROWS);
    let curve = load(folder.path(), "test_return_mean").unwrap();
    assert_eq!(points(&curve), [(362, 0.43), (20528, -1e-3)]);
    assert_eq!((curve.seed, curve.task.as_str()), (3, "lbf-8x8-2p-2f-coop"));
    assert_eq!(curve.label, "mtppo lbf-8x8-2p-2f-coop, lr 2e-4 / 5e-5, s = 100");
    let keys: Vec<_> = curve.settings.keys().map(String::as_str).collect();
    assert_eq!(keys, ["algo.name", "schedule.rates", "schedule.switch_period", "world.task"]);
}

#[test]
fn equal_rates_are_named_once_and_a_rate_of_zero_is_zero() {
    let label = |rates| describe(&config(1, rates, "")).map_err(|e| e.to_string()).unwrap().label;
    assert_eq!(label("[1e-4, 1e-4]"), "mtppo lbf-8x8-2p-2f-coop, lr 1e-4");
    assert_eq!(label("[0.0003, 0]"), "mtppo lbf-8x8-2p-2f-coop, lr 3e-4 / 0, s = 100");
}

#[test]
fn a_metric_of_another_role_is_named_with_the_role() {
    let folder = tempfile::tempdir().unwrap();
    write_run(folder.path(), &config(1, "[1e-4]", ""), ROWS);
    fs::create_dir(folder.path().join("agent-1")).unwrap();
    fs::write(folder.path().join("agent-1/metrics.jsonl"), "{\"t_env\":5,\"loss\":2}\n").unwrap();
    assert_eq!(points(&load(folder.path(), "agent-1/loss").unwrap()), [(5, 2.0)]);
}

#[test]
fn a_folder_of_runs_stands_for_its_runs_in_the_order_of_their_numbers() {
    let folder = tempfile::tempdir().unwrap();
    for seed in [10, 1, 2] {
        write_run(&folder.path().join(format!("a/seed-{seed}")), &config(seed, "[1e-4]", ""), ROWS);
    }
    fs::create_dir(folder.path().join("empty")).unwrap();
    let load_all = |path: &Path| super::load_all(&[path.to_owned()], "test_return_mean");
    let found = load_all(folder.path());
    assert_eq!(found.curves.iter().map(|curve| curve.seed).collect::<Vec<_>>(), [1, 2, 10]);
    assert!(found.left_out.is_empty());
    for nothing in [folder.path().join("empty"), PathBuf::from("absent")] {
        let found = load_all(&nothing);
        assert!(found.curves.is_empty());
        assert!(matches!(found.left_out[..], [Error::NotARun { .. }]), "{:?}", found.left_out);
    }
    let both = [PathBuf::from("absent"), folder.path().join("empty")];
    assert_eq!(super::load_all(&both, "test_return_mean").left_out.len(), 2, "each is named");
}

#[test]
fn runs_that_cannot_be_read_are_left_out_and_named() {
    let folder = tempfile::tempdir().unwrap();
    let sweep = folder.path().join("sweep");
    for seed in 1..=8 {
        write_run(&sweep.join(format!("seed-{seed}")), &config(seed, "[1e-4]", ""), ROWS);
    }
    let seed = |seed: u64| sweep.join(format!("seed-{seed}"));
    fs::remove_dir_all(seed(2).join("world")).unwrap(); // young
    fs::remove_file(seed(3).join("config.toml")).unwrap(); // half copied
    fs::write(seed(4).join("config.toml"), "seed = 4\n[wor").unwrap();
    fs::write(seed(5).join("world/metrics.jsonl"), "").unwrap();
    fs::write(seed(6).join("world/metrics.jsonl"), ROWS.replace("0.43", "NaN")).unwrap();
    fs::write(seed(7).join("world/metrics.jsonl"), format!("\u{0}\n{ROWS}{ROWS}")).unwrap();
    fs::write(seed(8).join("config.toml"), config(1, "[1e-4]", "")).unwrap(); // a copy of seed 1
    fs::create_dir(seed(9)).unwrap(); // made, and nothing in it yet

    let found = super::load_all(std::slice::from_ref(&sweep), "test_return_mean");
    let curves: Vec<_> = found.curves.iter().map(|curve| (curve.seed, curve.points.len())).collect();
    assert_eq!(curves, [(1, 2), (6, 1), (7, 2)]);
    let messages: Vec<String> =
        found.left_out.iter().map(|e| e.to_string().replace(&*sweep.to_string_lossy(), "S")).collect();
    let starts = [
        "cannot read S/seed-2/world/metrics.jsonl: No such file",
        "cannot read S/seed-3/config.toml: No such file",
        "S/seed-4/config.toml: TOML parse error",
        "no row of S/seed-5/world/metrics.jsonl has a number named `test_return_mean`; it has no rows",
        "3 rows of S/seed-7/world/metrics.jsonl, the first at line 1: not a JSON object",
        "S/seed-8 is seed 1 of `mtppo lbf-8x8-2p-2f-coop, lr 1e-4` once more; S/seed-1 is the one that counts",
        "cannot read S/seed-9/config.toml: No such file",
    ];
    assert_eq!(messages.len(), starts.len(), "{messages:#?}");
    for (message, start) in messages.iter().zip(starts) {
        assert!(message.starts_with(start), "{message}");
    }
    let groups = group(found.curves);
    assert_eq!((groups.len(), groups[0].curves.len()), (1, 3));
}

#[test]
fn a_file_without_any_usable_row_says_why() {
    let folder = tempfile::tempdir().unwrap();
    let message = |rows: &str| {
        write_run(folder.path(), &config(1, "[1e-4]", ""), rows);
        let text = load(folder.path(), "x").unwrap_err().to_string();
        text.replace(&*folder.path().to_string_lossy(), "RUN")
    };
    let start = "no row of RUN/world/metrics.jsonl has a number named `x`; ";
    assert_eq!(message("{\"t_env\":1,\"y\":1}\n"), format!("{start}there are `t_env`, `y`"));
    assert_eq!(message(""), format!("{start}it has no rows with a value yet"));
    assert_eq!(
        message("{\"t_env\":2,\"x\":\"1\"}\n"),
        format!("{start}1 rows cannot be used, the first at line 1: expected a number for `x`, got \"1\"")
    );
    assert!(message("\n{\"x\":1}\n").contains("at line 2: expected a whole number `t_env`"));
}

#[test]
fn a_last_row_that_is_still_being_written_is_skipped() {
    let folder = tempfile::tempdir().unwrap();
    write_run(folder.path(), &config(1, "[1e-4]", ""), "{\"t_env\":1,\"x\":1}\n{\"t_env\":2,\"x\"");
    let (curve, left_out) = super::load(folder.path(), "x").unwrap();
    assert_eq!(points(&curve), [(1, 1.0)]);
    assert!(left_out.is_none());
}

#[test]
fn a_config_without_what_the_label_needs_is_an_error_that_says_what() {
    let folder = tempfile::tempdir().unwrap();
    let message = |config: &str| {
        write_run(folder.path(), config, ROWS);
        load(folder.path(), "test_return_mean").unwrap_err().to_string()
    };
    assert!(message("seed = 1\n").ends_with("config.toml: expected a text `name` in section `algo`"));
    assert!(message(&config(1, "[]", "").replace("seed = 1\n", "seed = -1\n")).ends_with("`seed` from 0 up"));
    assert!(message("seed = \n").contains("config.toml: TOML parse error at line 1"));
}

#[test]
fn a_reference_file_becomes_a_curve_named_after_its_program() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("ippo.json");
    let text = "{\"source\":\"EPyMARL 2024-09 (commit x)\",\"algorithm\":\"ippo_ns\",\"task\":\"lbf\",\
                \"seed\":4,\"settings\":{\"lr\":\"0.0003\",\"n\":5},\
                \"rows\":[{\"t_env\":362,\"test_return_mean\":0.5},{\"t_env\":400,\"test_return_mean\":1}]}";
    fs::write(&path, text).unwrap();
    let curve = load(&path, "test_return_mean").unwrap();
    assert_eq!((curve.label.as_str(), curve.seed), ("ippo_ns lbf (EPyMARL 2024-09)", 4));
    assert_eq!(points(&curve), [(362, 0.5), (400, 1.0)]);
    assert_eq!(
        curve.settings.iter().map(|(k, v)| format!("{k}={v}")).collect::<Vec<_>>(),
        ["lr=0.0003", "n=5"]
    );

    fs::write(&path, text.replace("\"t_env\":400", "\"t_env\":1").replace("0.5", "NaN,\"y\":-Infinity"))
        .unwrap();
    assert_eq!(points(&load(&path, "test_return_mean").unwrap()), [(1, 1.0)]);
    fs::write(&path, text.replace("\"t_env\":400", "\"t_env\":1")).unwrap();
    let (curve, left_out) = super::load(&path, "test_return_mean").unwrap();
    assert_eq!(points(&curve), [(362, 0.5)]);
    let left_out = left_out.unwrap().to_string();
    assert!(left_out.contains("ippo.json, the first at rows[1]: t_env 1 comes after 362"), "{left_out}");
    fs::write(&path, "{\n\"source\":1}").unwrap();
    let message = load(&path, "test_return_mean").unwrap_err().to_string();
    assert!(message.contains("ippo.json is not a curve file: invalid type: integer `1`"), "{message}");
}

#[test]
fn runs_are_grouped_by_label_and_kept_apart_where_other_settings_differ() {
    let with = |seed, hidden: Option<&str>| {
        let mut curve = curve("mtppo lbf", seed, &[(0, 0.0)]);
        curve.settings.extend(hidden.map(|hidden| ("algo.hidden".to_owned(), hidden.to_owned())));
        curve.settings.insert("algo.gamma".to_owned(), "0.99".to_owned());
        curve
    };
    let other = curve("ippo lbf", 1, &[(0, 0.0)]);
    let groups =
        group(vec![with(1, Some("64")), other, with(2, Some("64")), with(1, Some("128")), with(1, None)]);
    let found: Vec<_> = groups.iter().map(|group| (group.label.as_str(), group.curves.len())).collect();
    assert_eq!(
        found,
        [
            ("mtppo lbf, algo.hidden=64", 2),
            ("ippo lbf", 1),
            ("mtppo lbf, algo.hidden=128", 1),
            ("mtppo lbf, algo.hidden=unset", 1)
        ]
    );
}

#[test]
fn a_label_says_what_a_return_means_where_that_differs() {
    let with = |label: &str, reward: &str| {
        let mut curve = curve(label, 1, &[(0, 0.0)]);
        curve.settings.insert("world.reward".to_owned(), reward.to_owned());
        curve
    };
    let labels = |curves: Vec<Curve>| group(curves).into_iter().map(|group| group.label).collect::<Vec<_>>();
    assert_eq!(
        labels(vec![with("ippo", "sum"), with("mtppo", "mean")]),
        ["ippo, world.reward=sum", "mtppo, world.reward=mean"]
    );
    assert_eq!(labels(vec![with("ippo", "sum"), with("mtppo", "sum")]), ["ippo", "mtppo"]);
}
