//! How the system shares its processors among the roles.

use thread_priority::unix::{
    set_thread_priority_and_policy, thread_native_id, NormalThreadSchedulePolicy, ThreadSchedulePolicy,
};
use thread_priority::{ThreadPriority, ThreadPriorityValue};

use crate::usage::niceness;

/// Keeps the threads of this process, when they wake up, from pushing others off their processor: they wait until
/// one is free, or until the others have had their share. Call it at the top of `main`; threads inherit it.
///
/// The roles wake one another several times in each tick. Without this an env-server that sends observations is
/// interrupted after the first by the agent that receives it, and the second agent waits meanwhile; two processors
/// then do a fifth fewer steps with ten copies, a third fewer with one. Needs no privileges (Linux: `SCHED_BATCH`);
/// where the system does not have it, nothing changes but the speed.
pub fn do_not_preempt() {
    let Some(unchanged) = niceness() else { return };
    let batch = ThreadSchedulePolicy::Normal(NormalThreadSchedulePolicy::Batch);
    if let Err(error) = set_thread_priority_and_policy(thread_native_id(), priority(unchanged), batch) {
        tracing::debug!(?error, "the system does not let threads stand back");
    }
}

/// A nice value in the words of `thread_priority`, which sets it along with the policy: from 99 for −20 to 0 for 19.
fn priority(niceness: i8) -> ThreadPriority {
    // It rounds down to a nice value, so the middle between two is meant.
    let value = 99.0 * (1.0 - (f32::from(niceness) + 20.5) / 39.0);
    let value = ThreadPriorityValue::try_from(value.max(0.0).round() as u8);
    ThreadPriority::Crossplatform(value.expect("at most 99"))
}

#[cfg(test)]
mod tests {
    use thread_priority::unix::thread_schedule_policy;

    use super::*;

    const BATCH: ThreadSchedulePolicy = ThreadSchedulePolicy::Normal(NormalThreadSchedulePolicy::Batch);

    #[test]
    #[cfg(target_os = "linux")]
    fn threads_stand_back_and_are_as_nice_as_before() {
        let before = niceness().expect("Linux tells");
        let seen = std::thread::spawn(|| {
            do_not_preempt();
            // Inherited by what this thread starts.
            std::thread::spawn(|| (thread_schedule_policy(), niceness())).join().expect("does not panic")
        });
        let (policy, after) = seen.join().expect("does not panic");
        assert_eq!(policy.expect("Linux tells"), BATCH);
        assert_eq!(after, Some(before));
    }

    #[test]
    fn every_nice_value_is_put_in_words_that_mean_it() {
        for niceness in -20..=19 {
            assert_eq!(priority(niceness).to_posix(BATCH), Ok(niceness.into()), "{niceness}");
        }
    }
}
