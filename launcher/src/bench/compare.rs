//! `rondo bench --compare OLD.json`: speed relative to an earlier measurement.

use std::path::Path;

use process::Failure;
use proto::exit;

use super::Report;

/// Reads the file of an earlier `--json`.
///
/// # Errors
/// If the file cannot be read or is of another form.
pub fn read(path: &Path) -> Result<Report, Failure> {
    let text = std::fs::read_to_string(path)
        .map_err(|e| Failure::new(exit::IO, format!("cannot read {}: {e}", path.display())))?;
    serde_json::from_str(&text).map_err(|e| {
        let text = format!("{} is not what `rondo bench --json` writes: {e}", path.display());
        Failure::new(exit::CONFIG, text)
    })
}

/// New over old for every case that both have measured.
pub fn ratios(before: &Report, after: &Report) -> String {
    let peaks = after.machine.sgemm_gflops_all_cores / before.machine.sgemm_gflops_all_cores;
    let mut text = format!("new over old; sgemm of all cores: {peaks:.2}\n");
    text += &format!(
        "{:<28} {:<6} {:>6} {:<12} {:>11} {:>14}\n",
        "task", "algo", "copies", "place", "env steps/s", "share of limit"
    );
    let mut missing = 0;
    for new in &after.cases {
        let same = |old: &&super::Measured| (old.case(), &old.beside) == (new.case(), &new.beside);
        let Some(old) = before.cases.iter().find(same) else {
            missing += 1;
            continue;
        };
        text += &format!(
            "{:<28} {:<6} {:>6} {:<12} {:>11.2} {:>14.2}\n",
            new.task,
            new.algo,
            new.copies,
            new.place,
            new.env_steps_per_second.median / old.env_steps_per_second.median,
            new.share_of_limit / old.share_of_limit
        );
    }
    if missing > 0 {
        text += &format!("{missing} cases are not in the old file\n");
    }
    text
}
