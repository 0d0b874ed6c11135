//! Folders that are unlike a local disk: without locks, without sockets, of names that are no text, not writable.
//! What such a file system refuses is refused here by a library that stands between a program and the system.

use std::ffi::{OsStr, OsString};
use std::fs;
use std::os::unix::ffi::{OsStrExt, OsStringExt};
use std::os::unix::fs::symlink;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::OnceLock;

use tempfile::TempDir;

use crate::cluster::{experiment, role, rondo, short, undisturbed, wait_until, Cluster, Ended, Process};
use crate::hosts::Hosts;

const EPERM: i32 = 1;
const EACCES: i32 = 13;
const EINVAL: i32 = 22;
const ENOSPC: i32 = 28;
const EROFS: i32 = 30;
const ENAMETOOLONG: i32 = 36;
const ENOLCK: i32 = 37;
const ENOSYS: i32 = 38;
const ELOOP: i32 = 40;
const EOPNOTSUPP: i32 = 95;
const EDQUOT: i32 = 122;

/// Refuses calls with the error number that the environment gives, for sockets and folders only below `BELOW`.
const REFUSER: &str = r#"
#define _GNU_SOURCE
#include <errno.h>
#include <fcntl.h>
#include <stdlib.h>
#include <string.h>
#include <sys/file.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/syscall.h>
#include <sys/un.h>
#include <unistd.h>

static int refused(const char *call, const char *path) {
    const char *number = getenv(call), *below = getenv("BELOW");
    if (!number || (path && below && strncmp(path, below, strlen(below)))) return 0;
    errno = atoi(number);
    return 1;
}

int flock(int fd, int operation) {
    return refused("REFUSE_FLOCK", 0) ? -1 : syscall(SYS_flock, fd, operation);
}

int bind(int fd, const struct sockaddr *address, socklen_t length) {
    const char *path = ((const struct sockaddr_un *)address)->sun_path;
    if (address->sa_family == AF_UNIX && path[0] && refused("REFUSE_BIND", path)) return -1;
    return syscall(SYS_bind, fd, address, length);
}

int fsync(int fd) {
    struct stat about;
    if (!fstat(fd, &about) && S_ISDIR(about.st_mode) && refused("REFUSE_FSYNC_FOLDER", 0)) return -1;
    return syscall(SYS_fsync, fd);
}

int chmod(const char *path, mode_t mode) {
    return refused("REFUSE_CHMOD", path) ? -1 : syscall(SYS_fchmodat, AT_FDCWD, path, mode);
}

int mkdir(const char *path, mode_t mode) {
    return refused("REFUSE_MKDIR", path) ? -1 : syscall(SYS_mkdirat, AT_FDCWD, path, mode);
}
"#;

/// The library, compiled once. It stays loaded until the tests end, and its folder with it.
fn refuser() -> &'static Path {
    static LIBRARY: OnceLock<(TempDir, PathBuf)> = OnceLock::new();
    let (_, library) = LIBRARY.get_or_init(|| {
        let folder = tempfile::tempdir().expect("a folder");
        let (source, library) = (folder.path().join("refuse.c"), folder.path().join("refuse.so"));
        fs::write(&source, REFUSER).expect("written");
        let mut compile = Command::new("cc");
        compile.args(["-shared", "-fPIC", "-o"]).arg(&library).arg(&source);
        assert!(compile.status().expect("a C compiler").success());
        (folder, library)
    });
    library
}

/// Lets the system refuse `call` to this command and its children.
fn refuse<'a>(command: &'a mut Command, call: &str, errno: i32) -> &'a mut Command {
    command.env("LD_PRELOAD", refuser()).env(format!("REFUSE_{call}"), errno.to_string())
}

fn train(out: &Path) -> Command {
    let mut command = rondo();
    command.arg("train").args(short()).arg("--quiet").arg("--out").arg(out);
    command
}

/// `rondo COMMAND PATH`, quiet where that is an option.
fn on(command: &str, path: &Path) -> Command {
    let mut rondo = rondo();
    rondo.arg(command).arg(path);
    rondo
}

fn ends(command: Command) -> Ended {
    Process::start(command).wait()
}

#[track_caller]
fn comes_to_the_usual_digest(cluster: &Cluster, run: &str, command: Command) -> Ended {
    let ended = Process::start(command).succeeds();
    assert_eq!(cluster.digest(run), undisturbed(), "{ended:#?}");
    ended
}

#[test]
fn a_run_trains_where_locks_are_refused() {
    for errno in [ENOLCK, EOPNOTSUPP, ENOSYS] {
        let cluster = Cluster::new();
        let mut command = train(&cluster.path("run"));
        refuse(&mut command, "FLOCK", errno);
        let ended = comes_to_the_usual_digest(&cluster, "run", command);
        for part in ["refuses locks", "no other host", "as with `--transport tcp`"] {
            assert!(ended.stderr.contains(part), "`{part}` is missing in {ended:#?}");
        }
    }
}

#[test]
fn a_second_command_is_kept_out_of_a_run_where_locks_are_refused() {
    let cluster = Cluster::new();
    let mut endless = rondo();
    endless
        .arg("train")
        .args(experiment(1, 100_000_000))
        .arg("--quiet")
        .arg("--out")
        .arg(cluster.path("run"));
    refuse(&mut endless, "FLOCK", ENOLCK);
    let first = Process::start(endless);
    wait_until("the run to begin", || cluster.path("run/world").exists());
    let mut second = on("resume", &cluster.path("run"));
    refuse(&mut second, "FLOCK", ENOLCK);
    ends(second).fails_with(75, &["error: another `rondo` process is running "]);
    first.kill_all();
    let mut third = on("resume", &cluster.path("run"));
    third.arg("--t-max=100000001").arg("--quiet");
    refuse(&mut third, "FLOCK", ENOLCK);
    let third = Process::start(third);
    wait_until("the run to be held again", || third.stderr().contains("refuses locks"));
    assert!(!third.stderr().contains("busy"), "{}", third.stderr());
    third.kill_all();
}

#[test]
fn a_run_trains_where_the_run_folder_holds_no_sockets() {
    for errno in [EPERM, EOPNOTSUPP, ENOSYS] {
        let cluster = Cluster::new();
        let mut command = train(&cluster.path("run"));
        refuse(&mut command, "BIND", errno).env("BELOW", cluster.path("run"));
        let ended = comes_to_the_usual_digest(&cluster, "run", command);
        assert_eq!(ended.stderr, "", "there are other folders");
        assert!(!cluster.path("run/bus").exists());
    }
}

#[test]
fn a_run_trains_where_no_folder_holds_sockets_unless_they_are_asked_for() {
    let cluster = Cluster::new();
    let mut command = train(&cluster.path("run"));
    refuse(&mut command, "BIND", EPERM);
    let ended = comes_to_the_usual_digest(&cluster, "run", command);
    assert!(ended.stderr.contains("ports of 127.0.0.1"), "{ended:#?}");

    let mut command = train(&cluster.path("other"));
    command.arg("--transport=unix");
    refuse(&mut command, "BIND", EPERM);
    let folder = format!("{}: Operation not permitted", cluster.path("other/bus").display());
    ends(command).fails_with(74, &["no folder can hold their Unix sockets", &folder, "`--transport tcp`"]);
}

#[test]
fn a_role_by_itself_says_which_socket_the_system_refuses() {
    for (call, errno, reason) in [("BIND", EPERM, "Operation not permitted"), ("FLOCK", ENOLCK, "ENOLCK")] {
        let hosts = Hosts::new(short());
        let mut command = role("rondo-env-server");
        command
            .arg("--config")
            .arg(hosts.cluster.path("config.toml"))
            .arg("--out")
            .arg(hosts.folder("world"));
        command.args(["--listen", &hosts.world]);
        refuse(&mut command, call, errno);
        let says = format!("error: cannot listen on `{}`: ", hosts.world);
        ends(command).fails_with(74, &[&says, reason, "hint: ", "`--transport tcp`"]);
    }
}

#[test]
fn long_paths_of_the_run_and_of_temporary_files_do_not_matter() {
    let cluster = Cluster::new();
    let long = cluster.path(&"x".repeat(100));
    fs::create_dir(&long).expect("created");
    let run = format!("{}/run", "x".repeat(100));
    let mut command = train(&cluster.path(&run));
    command.env("TMPDIR", &long).env_remove("XDG_RUNTIME_DIR");
    let ended = comes_to_the_usual_digest(&cluster, &run, command);
    assert_eq!(ended.stderr, "");
}

#[test]
fn marks_that_an_endpoint_cannot_have_do_not_matter_in_a_run_folder() {
    let cluster = Cluster::new();
    let run = "a#b?c;d=e\nf";
    let ended = comes_to_the_usual_digest(&cluster, run, train(&cluster.path(run)));
    assert_eq!(ended.stderr, "");
}

#[test]
fn a_path_that_is_not_utf_8_is_the_folder_that_is_used() {
    let cluster = Cluster::new();
    let folder = cluster.path("").join(OsStr::from_bytes(b"caf\xe9"));
    let [run, seeds, picture, film] = ["run", "seeds", "curve.svg", "film.png"].map(|name| folder.join(name));
    Process::start(train(&run)).succeeds();
    let digest = {
        let mut digest = on("digest", &run);
        digest.arg("--json");
        Process::start(digest).succeeds().stdout
    };
    assert_eq!(digest, undisturbed());
    let mut sweep = rondo();
    sweep.args(["train", "--seeds=2", "--quiet"]).args(experiment(1, 1_000)).arg("--out").arg(&seeds);
    Process::start(sweep).succeeds();
    let resume = |path: &Path| {
        let mut resume = on("resume", path);
        resume.args(["--quiet", "--t-max=12000"]);
        Process::start(resume).succeeds()
    };
    resume(&run);
    resume(&seeds);
    let with_option = |command: &str, option: &str, file: &Path| {
        let mut words = option.to_owned().into_bytes();
        words.extend(file.as_os_str().as_bytes());
        let mut command = on(command, &run);
        command.arg(OsString::from_vec(words));
        command
    };
    Process::start(with_option("plot", "--out=", &picture)).succeeds();
    Process::start(with_option("compare", "--reference=", &seeds.join("seed-1"))).succeeds();
    let mut render = with_option("render", "--out=", &film);
    render.arg("--episodes=1");
    Process::start(render).succeeds();
    let mut eval = on("eval", &run);
    eval.arg("--episodes=2");
    Process::start(eval).succeeds();
    for file in [&picture, &folder.join("film-0001.png"), &run.join("evaluation.json")] {
        assert!(file.exists(), "{}", file.display());
    }
    // Nothing went to a folder of a similar name.
    let names: Vec<_> = fs::read_dir(cluster.path("")).expect("listed").collect();
    assert_eq!(names.len(), 1, "{names:?}");
}

#[test]
fn roles_by_themselves_take_paths_that_are_not_utf_8() {
    let hosts = Hosts::new(short());
    let folder = hosts.cluster.path("").join(OsStr::from_bytes(b"caf\xe9"));
    fs::create_dir(&folder).expect("created");
    let config = folder.join("config.toml");
    fs::copy(hosts.cluster.path("config.toml"), &config).expect("copied");
    let start = |program: &str, more: &[&str]| {
        let mut command = role(program);
        command.arg("--config").arg(&config).arg("--out").arg(folder.join("run")).args(more);
        Process::start(command)
    };
    let dial = ["--connect", &hosts.world, "--connect", &hosts.coordinator];
    let everybody = [
        start("rondo-env-server", &["--listen", &hosts.world]),
        start("rondo-coordinator", &["--listen", &hosts.coordinator]),
        start("rondo-agent", &[&["--id=0"][..], &dial].concat()),
        start("rondo-agent", &[&["--id=1"][..], &dial].concat()),
    ];
    everybody.into_iter().for_each(|process| drop(process.succeeds()));
    let mut digest = on("digest", &folder.join("run"));
    digest.arg("--json");
    assert_eq!(Process::start(digest).succeeds().stdout, undisturbed());
}

#[test]
fn a_file_system_without_permissions_or_flushed_folders_is_good_enough() {
    for (call, errno) in
        [("CHMOD", EPERM), ("CHMOD", ENOSYS), ("FSYNC_FOLDER", EINVAL), ("FSYNC_FOLDER", ENOSYS)]
    {
        let cluster = Cluster::new();
        let mut command = train(&cluster.path("run"));
        refuse(&mut command, call, errno).env("BELOW", cluster.path("run"));
        comes_to_the_usual_digest(&cluster, "run", command);
    }
}

#[test]
fn a_folder_that_cannot_be_made_is_named_with_what_to_do() {
    for (errno, hint) in [
        (EACCES, "give this user the right to it, or choose another folder with --out"),
        (EROFS, "choose another folder with --out"),
        (ENOSPC, "no space left"),
        (EDQUOT, "no space left"),
        (ENAMETOOLONG, "choose a shorter name"),
        (ELOOP, "links lead in a circle"),
    ] {
        let cluster = Cluster::new();
        let run = cluster.path("parent/run");
        let mut command = train(&run);
        refuse(&mut command, "MKDIR", errno).env("BELOW", cluster.path(""));
        let path = run.display().to_string();
        ends(command).fails_with(74, &["could not create the folder", &path, hint]);
        assert!(!cluster.path("parent").exists());
    }
}

#[test]
fn an_out_that_cannot_be_a_folder_is_refused_before_anything_is_written() {
    let cluster = Cluster::new();
    fs::write(cluster.path("file"), "mine").expect("written");
    symlink("nowhere", cluster.path("link")).expect("a link");
    symlink("circle", cluster.path("circle")).expect("a link");
    let long = "x".repeat(300);
    for (out, code, part) in [
        ("file", 78, "is a file, a run needs a folder"),
        ("file/run", 74, "a part of this path is a file"),
        ("link", 78, "is a link to nothing, a run needs a folder"),
        ("circle", 74, "Too many levels of symbolic links"),
        (&long, 74, "choose a shorter name"),
    ] {
        let path = cluster.path(out);
        ends(train(&path)).fails_with(code, &[&path.display().to_string(), part, "hint: "]);
        let mut sweep = train(&path);
        sweep.arg("--seeds=2");
        let ended = ends(sweep);
        assert!(matches!(ended.code, Some(74 | 78)), "{ended:#?}");
        assert!(ended.stderr.contains(&path.display().to_string()), "{ended:#?}");
    }
    assert_eq!(fs::read_to_string(cluster.path("file")).expect("it is there"), "mine");
    assert_eq!(fs::read_dir(cluster.path("")).expect("listed").count(), 3);
}

#[test]
fn a_file_in_the_place_of_the_folder_of_runs_is_named() {
    let cluster = Cluster::new();
    fs::write(cluster.path("runs"), "mine").expect("written");
    let mut command = rondo();
    command.arg("train").args(short()).current_dir(cluster.path(""));
    ends(command).fails_with(74, &["runs/lbf-5x5-2p-1f-mtppo-seed-1", "a part of this path is a file"]);
}

#[test]
fn no_home_is_needed() {
    for home in [Some("/nowhere"), None] {
        let cluster = Cluster::new();
        let mut command = train(&cluster.path("run"));
        match home {
            Some(home) => command.env("HOME", home),
            None => command.env_remove("HOME"),
        };
        let ended = comes_to_the_usual_digest(&cluster, "run", command);
        assert_eq!(ended.stderr, "");
    }
}

/// Runs `$3…` in a mount namespace of its own in which the folder `$1` is read-only.
const READ_ONLY: &str = r#"
mount --bind "$1" "$1" && mount -o remount,bind,ro "$1" || exit 99
shift; exec "$@"
"#;

#[test]
fn a_run_folder_that_is_read_only_can_be_read() {
    let cluster = Cluster::new();
    let run = cluster.path("run");
    Process::start(train(&run)).succeeds();
    let stops = cluster.train("stopped", experiment(1, 100_000_000), [""; 0]);
    wait_until("the run to begin", || cluster.path("stopped/agent-1").exists());
    stops.kill_all();
    let read_only = |folder: &Path, words: &[&str]| {
        let mut command = Command::new("unshare");
        command.args(["-m", "sh", "-c", READ_ONLY, "sh"]).arg(folder).arg(rondo().get_program());
        command.args(words).current_dir(cluster.path(""));
        ends(command)
    };
    let first = read_only(&run, &["digest", "run", "--json"]);
    if first.code == Some(99) || first.stderr.starts_with("unshare:") {
        println!("skipped: this user may not mount: {}", first.stderr);
        return;
    }
    assert_eq!((first.code, first.stdout.as_str()), (Some(0), undisturbed()));
    for words in [
        &["plot", "run", "--out=curve.svg"][..],
        &["compare", "run"],
        &["render", "run", "--episodes=1", "--out=film.gif"],
        &["eval", "run", "--episodes=2", "--json=result.json"],
    ] {
        let ended = read_only(&run, words);
        assert_eq!((ended.code, ended.stderr.as_str()), (Some(0), ""), "{words:?}: {ended:#?}");
    }
    let evaluation = read_only(&run, &["eval", "run", "--episodes=2"]);
    assert_eq!(evaluation.code, Some(0), "{evaluation:#?}");
    assert!(evaluation.stdout.contains("return_mean"), "{evaluation:#?}");
    assert!(evaluation.stderr.starts_with("not written to run/evaluation.json: "), "{evaluation:#?}");
    assert!(evaluation.stderr.contains("`--json FILE` writes it elsewhere"), "{evaluation:#?}");
    // A finished run is left as it is, and one that is not says why it cannot go on.
    let resumed = read_only(&run, &["resume", "run"]);
    assert!(resumed.code == Some(0) && resumed.stdout.contains("is finished"), "{resumed:#?}");
    let stopped = cluster.path("stopped");
    read_only(&stopped, &["resume", "stopped", "--quiet"])
        .fails_with(74, &["stopped/config.toml", "Read-only file system", "hint: "]);
    // Below a parent that is read-only.
    read_only(&stopped, &["train", "--quiet", "--out=stopped/new/run"])
        .fails_with(74, &["stopped/new", "Read-only file system", "choose another folder with --out"]);
}

#[test]
fn a_limit_on_open_files_is_no_bug() {
    for limit in [5, 8, 11, 14, 17, 20, 25, 30] {
        let cluster = Cluster::new();
        let mut command = Command::new("sh");
        command.args(["-c", r#"ulimit -n "$1"; shift; exec "$@""#, "sh", &limit.to_string()]);
        command.arg(rondo().get_program()).arg("train").args(experiment(1, 500)).arg("--quiet");
        command.arg("--out").arg(cluster.path("run"));
        let ended = ends(command);
        assert!(matches!(ended.code, Some(0 | 74)), "{limit} files: {ended:#?}");
        let says = ["Too many open files", "`ulimit -n`"].map(|part| ended.stderr.contains(part));
        assert!(ended.code == Some(0) || says.contains(&true), "{limit} files: {ended:#?}");
        assert!(!ended.stderr.contains("panicked"), "{limit} files: {ended:#?}");
    }
}

#[test]
fn a_full_disk_behind_stdout_is_no_bug() {
    let mut command = rondo();
    command.arg("tasks").stderr(std::process::Stdio::piped());
    command.stdout(fs::File::create("/dev/full").expect("it is there"));
    let ended = command.output().expect("it ends");
    let stderr = String::from_utf8_lossy(&ended.stderr);
    assert_eq!(ended.status.code(), Some(74), "{stderr}");
    assert!(stderr.contains("No space left on device") && !stderr.contains("panicked"), "{stderr}");
}
