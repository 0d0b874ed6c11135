//! Replays battles recorded from the reference: excerpts always, all of them where `RONDO_GOLDEN` names the folder
//! that holds them.

use std::path::Path;

use crate::traces::{battles, excerpts, replay_text, text};

#[test]
fn the_full_battles_come_out_as_recorded() {
    let Some(folder) = std::env::var_os("RONDO_GOLDEN") else {
        eprintln!("skipped: RONDO_GOLDEN does not name the folder of the full traces");
        return;
    };
    let folder = Path::new(&folder);
    let paths = battles(folder);
    assert!(!paths.is_empty(), "no smaclite-*.jsonl.gz in {folder:?}, the folder that RONDO_GOLDEN names");
    for path in paths {
        let replayed = replay_text(&text(&path));
        let report = replayed.unwrap_or_else(|error| panic!("{}: {error}", path.display()));
        println!("{report}");
        assert_eq!(report.mismatches, 0, "{}: {report}", path.display());
        assert!(report.steps > 0, "{}: {report}", path.display());
    }
}

#[test]
fn the_excerpts_of_battles_come_out_as_recorded() {
    for path in battles(&excerpts()) {
        let report = replay_text(&text(&path)).unwrap();
        assert_eq!(report.mismatches, 0, "{}: {report}", path.display());
    }
}
