//! The parameters of a network as one flat vector, and the names and shapes inside it.
//!
//! With one vector, clipping and Adam are one pass each. Gradients and moments have the same layout.

use rand::Rng;

/// A named tensor inside a flat vector.
#[derive(Clone, Debug, PartialEq)]
pub struct Block {
    /// For example `fc1.weight`.
    pub name: &'static str,
    /// `[in, out]` of a weight (the transpose of PyTorch's), `[out]` of a bias.
    pub shape: Vec<usize>,
    /// Initial values are uniform on `[-bound, bound]` (algorithms §1.3).
    pub bound: f32,
}

impl Block {
    /// Number of elements.
    pub fn len(&self) -> usize {
        self.shape.iter().product()
    }

    /// True for a tensor without elements.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }
}

/// Draws initial values for `blocks`, in order, from `rng`.
pub fn initial(blocks: &[Block], rng: &mut impl Rng) -> Vec<f32> {
    let mut values = Vec::with_capacity(blocks.iter().map(Block::len).sum());
    for block in blocks {
        values.extend((0..block.len()).map(|_| (2.0 * rng.random::<f32>() - 1.0) * block.bound));
    }
    values
}

/// Removes the first `n` numbers from `rest` and returns them.
pub(crate) fn take<'a>(rest: &mut &'a [f32], n: usize) -> &'a [f32] {
    let (head, tail) = rest.split_at(n);
    *rest = tail;
    head
}

/// As [`take`], mutable.
pub(crate) fn take_mut<'a>(rest: &mut &'a mut [f32], n: usize) -> &'a mut [f32] {
    let (head, tail) = std::mem::take(rest).split_at_mut(n);
    *rest = tail;
    head
}
