//! Reads runs: learning curves, statistics over seeds, pictures. Also the analytic example, and pictures of worlds.
//! Nothing here is on the training path, and nothing here writes into a run folder.
//!
//! ```text
//! runs        folders and reference files -> curves, curves -> groups of seeds
//! rows        metric rows, also damaged ones
//! meaning     whether the returns of two runs can be compared
//! scores      the scores of each group of runs, as a table
//! stats       scores of a run, means over seeds                      (algorithms §8.3)
//! compare     our curves against a reference's, test point by test point
//! plot        learning curves as SVG or PNG
//! estimation  the analytic example, its report and its picture        (algorithms §10)
//! picture     worlds as stills, as films and in the terminal
//! ```

pub mod compare;
pub mod estimation;
pub mod meaning;
pub mod picture;
pub mod plot;
pub mod runs;
pub mod scores;
pub mod stats;

mod chart;
mod error;
mod estimation_picture;
mod estimation_report;
mod rows;
mod svg;

pub use compare::{compare, Comparison};
pub use error::Error;
pub use estimation_picture::estimation_plot;
pub use estimation_report::estimation_report;
pub use plot::{plot, PlotOptions};
pub use runs::{group, load_all, Curve, Found, Group, Point};
pub use scores::scores;
