//! A disk that fills up in the middle of a run: a clear message, nothing lost, and the same digest afterwards.

use std::process::Command;

use crate::cluster::{role, rondo, short, undisturbed, Cluster, Process};
use crate::hosts::Hosts;
use crate::q_learning;

/// In a new mount namespace: a small disk, a run on it, and a file that fills the disk after the first checkpoint.
/// Then the file is removed and the run is resumed.
const STORY: &str = r#"
disk=$1; rondo=$2; shift 2
mount -t tmpfs -o size=16m tmpfs "$disk" || exit 99
"$rondo" train "$@" --quiet --out "$disk/run" & run=$!
until ls -d "$disk"/run/agent-1/checkpoints/round-* >/dev/null 2>&1; do
    kill -0 $run || exit 98
done
cat /dev/zero >"$disk/filler" 2>/dev/null
wait $run; echo "code $?"
ls "$disk"/run/*/checkpoints
rm "$disk/filler"
"$rondo" resume "$disk/run" --quiet >/dev/null; echo "code $?"
"$rondo" digest "$disk/run" --json
"#;

#[test]
fn a_full_disk_ends_the_run_with_its_checkpoints_intact() {
    disk_fills_up(short(), undisturbed());
}

#[test]
fn a_full_disk_costs_no_experience_that_a_checkpoint_counts_on() {
    disk_fills_up(q_learning::foraging(), q_learning::undisturbed());
}

/// Runs the test with an experiment whose undisturbed digest is `expected`.
#[track_caller]
fn disk_fills_up(experiment: Vec<String>, expected: &str) {
    let may_mount =
        Command::new("unshare").args(["-m", "true"]).output().is_ok_and(|done| done.status.success());
    if !may_mount {
        println!("skipped: this user may not make a mount namespace");
        return;
    }
    let cluster = Cluster::new();
    let mut command = Command::new("unshare");
    std::fs::create_dir(cluster.path("disk")).expect("created");
    command.args(["-m", "sh", "-c", STORY, "sh"]).arg(cluster.path("disk")).arg(rondo().get_program());
    command.args(experiment);
    let ended = Process::start(command).wait();
    if ended.code == Some(99) {
        println!("skipped: this user may not mount: {}", ended.stderr);
        return;
    }
    assert_eq!(ended.code, Some(0), "{ended:#?}");
    assert!(ended.stdout.starts_with("code 74\n"), "{ended:#?}");
    for part in ["no space left: could not ", "No space left on device", "the last checkpoint is intact"] {
        assert!(ended.stderr.contains(part), "`{part}` is missing in {ended:#?}");
    }
    let resumed = ended.stdout.split("code 0\n").nth(1).unwrap_or_else(|| panic!("not resumed: {ended:#?}"));
    assert_eq!(resumed, expected);
}

/// No file of this process may grow beyond `$1` times 512 bytes.
const SMALL_FILES: &str = r#"trap '' XFSZ; ulimit -f "$1"; shift; exec "$@""#;

/// Starts a role as on one of several hosts, with a limit of `kib` for its files.
fn start_with_small_files(hosts: &Hosts, program: &str, folder: &str, kib: u32, more: &[&str]) -> Process {
    let mut command = Command::new("sh");
    command.args(["-c", SMALL_FILES, "sh", &(2 * kib).to_string()]).arg(role(program).get_program());
    command.arg("--config").arg(hosts.cluster.path("config.toml")).arg("--out").arg(hosts.folder(folder));
    command.args(more);
    Process::start(command)
}

/// Starts all roles without limits; the run must complete.
fn goes_on(hosts: &Hosts) {
    let everybody = [
        hosts.start_env_server(&[]),
        hosts.start_coordinator(&[]),
        hosts.start_agent(0, &[]),
        hosts.start_agent(1, &[]),
    ];
    for process in everybody {
        process.succeeds();
    }
}

#[test]
fn an_edge_whose_metric_row_could_not_be_written_is_not_saved() {
    let hosts = Hosts::new(short());
    // Room for a checkpoint of the env-server, which has no weights, but not for all of its metric rows.
    let world = start_with_small_files(&hosts, "rondo-env-server", "world", 1, &["--listen", &hosts.world]);
    let others = [hosts.start_coordinator(&[]), hosts.start_agent(0, &[]), hosts.start_agent(1, &[])];
    world.wait().fails_with(74, &["File too large"]);
    for other in others {
        other.wait();
    }
    goes_on(&hosts);
    assert_eq!(hosts.merged_digest(), undisturbed());
}

#[test]
fn an_episode_that_could_not_be_remembered_ends_the_run_before_anything_is_learned_from_it() {
    let hosts = Hosts::new(q_learning::foraging());
    let (world, coordinator) = (hosts.start_env_server(&[]), hosts.start_coordinator(&[]));
    let other = hosts.start_agent(0, &[]);
    // Room for a checkpoint, but not for all episodes.
    let dial = ["--id=1", "--connect", &hosts.world, "--connect", &hosts.coordinator];
    let agent = start_with_small_files(&hosts, "rondo-agent", "agent-1", 64, &dial);
    let experience = hosts.folder("agent-1").join("agent-1/replay/episodes-000000000000.bin");
    let says = format!("error: could not append an episode to `{}`: File too large", experience.display());
    agent.wait().fails_with(74, &[&says]);
    for other in [world, coordinator, other] {
        other.wait();
    }
    // The incomplete part is gone; the part before is complete.
    let bytes = std::fs::metadata(&experience).expect("it is there").len();
    assert!(bytes < 64 * 1024, "the episode that failed was cut off: {bytes} bytes");
    goes_on(&hosts);
    assert_eq!(hosts.merged_digest(), q_learning::undisturbed());
}
