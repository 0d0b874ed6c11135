//! A learner's vectors as the named tensors of a checkpoint, and back.

use crate::kernels::math::all_finite;
use crate::network::Network;
use crate::params::take;

/// A named tensor borrowed from a learner: name, shape, values.
pub type NamedTensor<'a> = (String, Vec<usize>, &'a [f32]);

/// A saved learner does not fit this one.
#[derive(Debug, thiserror::Error, PartialEq)]
pub enum RestoreError {
    /// A tensor is missing.
    #[error("the checkpoint has no tensor `{0}`; it was written by a learner of another kind")]
    Missing(String),
    /// A tensor has another size.
    #[error("tensor `{name}` has {found} numbers, this learner needs {expected}; network or task differ")]
    Size {
        /// Its name.
        name: String,
        /// Numbers this learner needs.
        expected: usize,
        /// Numbers in the checkpoint.
        found: usize,
    },
}

/// A vector with the layout of a network's parameters, with the prefix of its tensors' names.
pub(crate) type Vector<'a> = (&'static str, &'a Network, &'a [f32]);

/// All tensors of `vectors`, in order; those of `critic` are called `critic.fc1.weight` and so on.
pub(crate) fn tensors<'a>(vectors: &[Vector<'a>]) -> Vec<NamedTensor<'a>> {
    let mut tensors = Vec::new();
    for &(owner, network, values) in vectors {
        let mut rest = values;
        for block in network.blocks() {
            let values = take(&mut rest, block.len());
            tensors.push((format!("{owner}.{}", block.name), block.shape, values));
        }
    }
    tensors
}

/// The first tensor with an infinite number or NaN, and that number.
pub(crate) fn first_not_finite(vectors: &[Vector]) -> Option<(String, f32)> {
    let bad = vectors.iter().position(|(_, _, values)| !all_finite(values))?;
    let of_bad = tensors(&vectors[bad..=bad]).into_iter();
    let mut numbers = of_bad.flat_map(|(name, _, values)| values.iter().map(move |&x| (name.clone(), x)));
    numbers.find(|(_, x)| !x.is_finite())
}

/// The saved numbers of `vectors`, in order; `tensor` returns the numbers of a name.
///
/// # Errors
/// If a tensor is missing or has another size.
pub(crate) fn restored<'a, const N: usize>(
    vectors: [Vector; N],
    tensor: impl Fn(&str) -> Option<&'a [f32]>,
) -> Result<[Vec<f32>; N], RestoreError> {
    let mut found = Vec::with_capacity(N);
    for (owner, network, values) in vectors {
        let mut whole = Vec::with_capacity(values.len());
        for block in network.blocks() {
            let name = format!("{owner}.{}", block.name);
            let numbers = tensor(&name).ok_or_else(|| RestoreError::Missing(name.clone()))?;
            if numbers.len() != block.len() {
                return Err(RestoreError::Size { name, expected: block.len(), found: numbers.len() });
            }
            whole.extend_from_slice(numbers);
        }
        found.push(whole);
    }
    Ok(found.try_into().expect("one vector was read for each"))
}
