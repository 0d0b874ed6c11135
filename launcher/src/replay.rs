//! `rondo replay`: compares recorded traces of the reference environments with ours.

use std::fs::File;
use std::io::{BufRead, BufReader};
use std::path::{Path, PathBuf};
use std::process::ExitCode;

use flate2::read::MultiGzDecoder;
use process::Failure;
use proto::exit;

/// Replay recorded traces and compare every number
#[derive(Debug, Clone, clap::Args)]
pub struct Replay {
    /// Trace files, .jsonl or .jsonl.gz
    #[arg(required = true)]
    files: Vec<PathBuf>,
}

impl Replay {
    /// Prints a line for each file, and the first mismatch in full. Every file is tried.
    pub fn run(&self) -> Result<ExitCode, Failure> {
        let mut worst = exit::DONE;
        for path in &self.files {
            let name = path.display().to_string();
            match open(path).and_then(|lines| {
                envs::replay::replay(lines, &name).map_err(|e| Failure::new(exit::CONFIG, e))
            }) {
                Ok(report) => {
                    println!("{name}: {report}");
                    if report.mismatches > 0 {
                        worst = worst.max(1);
                    }
                }
                Err(failure) => {
                    eprintln!("error: {failure}");
                    worst = worst.max(failure.code);
                }
            }
        }
        Ok(ExitCode::from(worst))
    }
}

fn open(path: &Path) -> Result<Box<dyn BufRead>, Failure> {
    let file = File::open(path)
        .map_err(|error| Failure::new(exit::IO, format!("cannot open {}: {error}", path.display())))?;
    let mut file = BufReader::new(file);
    // By content rather than by name.
    let zipped = file.fill_buf().is_ok_and(|bytes| bytes.starts_with(&[0x1f, 0x8b]));
    Ok(if zipped { Box::new(BufReader::new(MultiGzDecoder::new(file))) } else { Box::new(file) })
}
