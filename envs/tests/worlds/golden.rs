//! Replays traces recorded from the reference: excerpts always, all of them where `RONDO_GOLDEN` names the
//! folder that holds them.
//!
//! Three foraging excerpts are whole episodes of the full traces: the first six, and those in which players swap
//! places or share a cell. The fourth (`-pen`) was recorded from the same release with sight 2, a penalty of 0.1
//! and starts with two players in one cell, which none of the full traces has.
//!
//! Three warehouse excerpts are two whole episodes of a full trace each, which have every kind of event between
//! them. The others were recorded from the same releases: one with other numbers throughout, one with sixteen
//! robots in a crowd, whose ties need sets that grow.

use std::path::Path;

use crate::traces::{excerpts, foraging, replay_text, text, warehouse};

#[test]
fn the_excerpts_come_out_exactly_as_recorded() {
    let paths = [foraging(&excerpts()), warehouse(&excerpts())].concat();
    let reports: Vec<String> =
        paths.iter().map(|path| replay_text(&text(path)).unwrap().to_string()).collect();
    let expected = [
        "lbf-10x10-3p-3f: 13 episodes, 584 steps, 0 mismatches",
        "lbf-15x15-4p-3f: 20 episodes, 816 steps, 0 mismatches",
        "lbf-2s-6x6-4p-2f-pen: 8 episodes, 228 steps, 0 mismatches",
        "lbf-8x8-2p-2f-coop: 10 episodes, 453 steps, 0 mismatches",
        "rware-2s-2x1-4h-5ag-hard: 1 episodes, 500 steps, 0 mismatches",
        "rware-small-4ag: 2 episodes, 1000 steps, 0 mismatches",
        "rware-tiny-16ag-hard: 1 episodes, 500 steps, 0 mismatches",
        "rware-tiny-2ag: 2 episodes, 1000 steps, 0 mismatches",
        "rware-tiny-4ag: 2 episodes, 1000 steps, 0 mismatches",
    ];
    assert_eq!(reports, expected);
}

#[test]
fn the_full_traces_come_out_exactly_as_recorded() {
    let Some(folder) = std::env::var_os("RONDO_GOLDEN") else {
        eprintln!("skipped: RONDO_GOLDEN does not name the folder of the full traces");
        return;
    };
    let folder = Path::new(&folder);
    for (family, paths) in [("lbf", foraging(folder)), ("rware", warehouse(folder))] {
        assert!(
            !paths.is_empty(),
            "no {family}-*.jsonl.gz in {folder:?}, the folder that RONDO_GOLDEN names"
        );
        for path in paths {
            let replayed = replay_text(&text(&path));
            let report = replayed.unwrap_or_else(|error| panic!("{}: {error}", path.display()));
            println!("{report}");
            assert_eq!(report.mismatches, 0, "{}: {report}", path.display());
            assert!(report.steps > 0, "{}: {report}", path.display());
        }
    }
}
