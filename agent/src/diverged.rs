//! Failures of a learner with infinite numbers or NaN (algorithms §3.5).
//!
//! Nothing of that update call is saved. A run that resumes from the last checkpoint computes the same numbers again,
//! so the exit code is [`exit::CONFIG`], not [`exit::AGAIN`].

use process::Failure;
use proto::exit;

/// An update call computed `value` in `quantity`: a reported scalar or a tensor.
pub fn by_learning(id: u32, update_call: u64, quantity: &str, value: f64) -> Failure {
    let hint = "start a new run with smaller rates (`--lr-fast`, `--lr-slow`), a smaller \
                `--set algo.max_grad_norm=`, or `--set algo.reward_standardisation=running`";
    failure(id, update_call, &format!("{quantity} is {value}"), hint)
}

/// The world gave `reward` for a step in a copy.
pub fn by_reward(id: u32, update_call: u64, reward: f32, (copy, step): (usize, usize)) -> Failure {
    let what = format!("the reward of step {step} in copy {copy} is {reward}");
    failure(id, update_call, &what, "the world has to give finite rewards; correct it, then start a new run")
}

fn failure(id: u32, update_call: u64, what: &str, hint: &str) -> Failure {
    let text = format!(
        "agent {id} diverged in update call {update_call}: {what}; nothing of this update call is saved, the last \
         checkpoint stays\nhint: resuming computes the same numbers; {hint}"
    );
    Failure::new(exit::CONFIG, text)
}
