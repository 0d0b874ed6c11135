//! The policy of an agent that is not part of the team.

use std::sync::Arc;

/// The policy of a task's opponent. Tasks without an opponent accept [`Opponent::Builtin`] only.
#[derive(Debug, Clone, Default, PartialEq)]
pub enum Opponent {
    /// The built-in frozen network, if the task needs one.
    #[default]
    Builtin,
    /// A uniformly random action in every step.
    Random,
    /// Always the action that does nothing.
    Still,
    /// The bytes of a safetensors file with a frozen network, in the form of [`crate::mpe::FrozenNetwork`]. Its scores
    /// mean: nothing, +x, -x, +y, -y; the world translates them.
    Weights(Arc<[u8]>),
}
