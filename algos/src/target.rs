//! The update of a target network (algorithms §4.4).

/// Updates `target` after update call number `update_calls`, counted from 1.
///
/// `rule` above 1: a hard copy every that many update calls; `last_copy` is the update call of the last one.
/// Otherwise Polyak's τ, in every call. Update calls count, not gradient steps. The learning rate has no influence.
pub(crate) fn update(rule: f64, update_calls: u64, last_copy: &mut u64, target: &mut [f32], values: &[f32]) {
    if rule > 1.0 {
        if (update_calls - *last_copy) as f64 >= rule {
            target.copy_from_slice(values);
            *last_copy = update_calls;
        }
    } else {
        let tau = rule as f32;
        for (target, value) in target.iter_mut().zip(values) {
            *target = (1.0 - tau) * *target + tau * value;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_hard_copy_is_made_at_call_200_and_400_and_never_between() {
        let (mut target, mut last_copy, mut copies) = ([0.0], 0, vec![]);
        for call in 1..=450 {
            update(200.0, call, &mut last_copy, &mut target, &[call as f32]);
            if last_copy == call {
                assert_eq!(target, [call as f32]);
                copies.push(call);
            }
        }
        assert_eq!(copies, [200, 400]);
        assert_eq!(target, [400.0]);
    }

    #[test]
    fn polyak_averaging_moves_the_target_by_tau_in_every_call() {
        let (mut target, mut last_copy) = ([1.0, -2.0], 0);
        update(0.25, 1, &mut last_copy, &mut target, &[5.0, 2.0]);
        assert_eq!(target, [2.0, -1.0]);
        update(0.25, 2, &mut last_copy, &mut target, &[5.0, 2.0]);
        assert_eq!(target, [2.75, -0.25]);
        assert_eq!(last_copy, 0);
    }
}
