//! What the processes of all roles share: common arguments, logs, signals, the watch over the launcher, exit codes.
//! Nothing here affects a run's result.

mod allocator;
mod arguments;
mod failure;
mod ignored;
mod logs;
mod record;
mod role;
mod scalars;
mod signals;
mod usage;
mod watch;

pub use allocator::allocations;
pub use arguments::Common;
pub use failure::{exit_on_panic, parse_arguments, report, Failure};
pub use ignored::Ignored;
pub use logs::start_logs;
pub use role::{check_unchanged, Role};
pub use scalars::Scalars;
pub use signals::{on_stop_request, stop_signals, StopRequest};
pub use usage::{cpu_seconds, peak_memory_bytes};
pub use watch::{when_stdin_closes, LEAVE_NOW, LISTENING};
