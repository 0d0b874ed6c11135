//! A disk that fills up in the middle of a run: a clear message, nothing lost, and the same digest afterwards.

use std::process::Command;

use crate::cluster::{role, rondo, short, undisturbed, Cluster, Process};
use crate::hosts::Hosts;

/// In a mount namespace of its own: a small disk, a run on it, and a file that takes what is left of it as
/// soon as there is a checkpoint. Then the file goes and the run is resumed.
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
    command.args(short());
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
    assert_eq!(resumed, undisturbed());
}

/// No file of this process may grow beyond 2 KiB: room for a checkpoint of the env-server, which has no
/// weights, but not for all of its metric rows.
const SMALL_FILES: &str = r#"trap '' XFSZ; ulimit -f 4; exec "$@""#;

#[test]
fn an_edge_whose_metric_row_could_not_be_written_is_not_saved() {
    let hosts = Hosts::new(short());
    let mut command = Command::new("sh");
    command.args(["-c", SMALL_FILES, "sh"]).arg(role("rondo-env-server").get_program());
    command.arg("--config").arg(hosts.cluster.path("config.toml")).arg("--out").arg(hosts.folder("world"));
    command.args(["--listen", &hosts.world]);
    let world = Process::start(command);
    let others = [hosts.start_coordinator(&[]), hosts.start_agent(0, &[]), hosts.start_agent(1, &[])];
    world.wait().fails_with(74, &["File too large"]);
    for other in others {
        other.wait();
    }

    let everybody = [
        hosts.start_env_server(&[]),
        hosts.start_coordinator(&[]),
        hosts.start_agent(0, &[]),
        hosts.start_agent(1, &[]),
    ];
    for process in everybody {
        process.succeeds();
    }
    assert_eq!(hosts.merged_digest(), undisturbed());
}
