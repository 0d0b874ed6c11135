//! Replays battles recorded from the reference: excerpts always, all of them where `RONDO_GOLDEN` names the folder
//! that holds them.
//!
//! The excerpts are whole episodes of each map: battles won, starts along a wall and in a heap, healing and revival; and
//! the first steps of an episode of each, tick by tick.

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
    let reports: Vec<String> =
        battles(&excerpts()).iter().map(|path| replay_text(&text(path)).unwrap().to_string()).collect();
    let expected = [
        "smaclite-3s5z: 2 episodes, 72 steps, 0 mismatches",
        "smaclite-3s_vs_5z: 3 episodes, 76 steps, 0 mismatches",
        "smaclite-mmm2: 3 episodes, 66 steps, 0 mismatches",
        "smaclite-ticks: 3 episodes, 22 steps, 0 mismatches",
    ];
    assert_eq!(reports, expected);
}
