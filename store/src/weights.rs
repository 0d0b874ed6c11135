//! Named tensors as the bytes of a safetensors file, which other tools can open.

use std::borrow::Cow;

use safetensors::{Dtype, SafeTensors, View};

/// One array of a role's state: a weight, a moment of the optimiser, a running statistic.
#[derive(Debug, Clone, PartialEq)]
pub struct Tensor {
    /// Such as `actor.fc1.weight`. Names that start with `adam.` are not part of the digest.
    pub name: String,
    pub shape: Vec<usize>,
    /// Row-major; the product of `shape` is their number.
    pub data: Vec<f32>,
}

impl Tensor {
    /// The elements in files and digests: little-endian.
    pub(crate) fn bytes(&self) -> Vec<u8> {
        let mut bytes = vec![0; 4 * self.data.len()];
        for (bytes, number) in bytes.chunks_exact_mut(4).zip(&self.data) {
            bytes.copy_from_slice(&number.to_le_bytes());
        }
        bytes
    }
}

/// The same bytes for the same tensors in any order.
///
/// # Errors
/// Names the tensor whose name or shape cannot be stored.
pub(crate) fn encode(tensors: &[Tensor]) -> Result<Vec<u8>, String> {
    let mut names: Vec<&str> = tensors.iter().map(|tensor| tensor.name.as_str()).collect();
    names.sort_unstable();
    if let Some(pair) = names.windows(2).find(|pair| pair[0] == pair[1]) {
        return Err(format!("two tensors are named `{}`", pair[0]));
    }
    for Tensor { name, shape, data } in tensors {
        if name == "__metadata__" {
            return Err("a tensor cannot be named `__metadata__` in a safetensors file".to_owned());
        }
        let elements = shape.iter().try_fold(1_usize, |product, &size| product.checked_mul(size));
        if elements != Some(data.len()) {
            return Err(format!("tensor `{name}` has the shape {shape:?}, but {} elements", data.len()));
        }
    }
    safetensors::serialize(tensors.iter().map(|tensor| (tensor.name.as_str(), Stored(tensor))), None)
        .map_err(|error| error.to_string())
}

/// The tensors of a file in the order of their names.
pub(crate) fn decode(bytes: &[u8]) -> Result<Vec<Tensor>, String> {
    let file = SafeTensors::deserialize(bytes).map_err(|error| error.to_string())?;
    let mut tensors = Vec::with_capacity(file.len());
    for (name, view) in file.iter() {
        if view.dtype() != Dtype::F32 {
            return Err(format!("tensor `{name}` holds {}, expected F32", view.dtype()));
        }
        let number = |bytes: &[u8]| f32::from_le_bytes(bytes.try_into().expect("chunks of 4 bytes"));
        let data = view.data().chunks_exact(4).map(number).collect();
        tensors.push(Tensor { name: name.to_owned(), shape: view.shape().to_vec(), data });
    }
    tensors.sort_by(|a, b| a.name.cmp(&b.name));
    Ok(tensors)
}

struct Stored<'a>(&'a Tensor);

impl View for Stored<'_> {
    fn dtype(&self) -> Dtype {
        Dtype::F32
    }
    fn shape(&self) -> &[usize] {
        &self.0.shape
    }
    fn data(&self) -> Cow<'_, [u8]> {
        self.0.bytes().into()
    }
    fn data_len(&self) -> usize {
        4 * self.0.data.len()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn tensor(name: &str, shape: &[usize], data: &[f32]) -> Tensor {
        Tensor { name: name.to_owned(), shape: shape.to_vec(), data: data.to_vec() }
    }

    #[test]
    fn every_bit_comes_back_in_the_order_of_names() {
        let odd = [f32::MIN_POSITIVE / 4.0, -0.0, f32::NEG_INFINITY, f32::from_bits(0x7fc0_1234)];
        let (b, a, none) =
            (tensor("b", &[2, 2], &odd), tensor("a", &[], &[1.5]), tensor("none", &[0, 3], &[]));
        let bytes = encode(&[b.clone(), none.clone(), a.clone()]).unwrap();
        assert_eq!(bytes, encode(&[a.clone(), b.clone(), none.clone()]).unwrap());
        let back = decode(&bytes).unwrap();
        assert_eq!((&back[0], &back[2]), (&a, &none));
        assert_eq!((&back[1].name, &back[1].shape), (&b.name, &b.shape));
        assert_eq!(back[1].bytes(), b.bytes());
        assert_eq!(decode(&encode(&[]).unwrap()).unwrap(), []);
    }

    #[test]
    fn tensors_that_cannot_be_stored_are_named() {
        for (tensors, problem) in [
            (vec![tensor("w", &[2, 3], &[0.0; 5])], "tensor `w` has the shape [2, 3], but 5 elements"),
            (
                vec![tensor("w", &[usize::MAX, 2], &[])],
                "tensor `w` has the shape [18446744073709551615, 2], but 0 elements",
            ),
            (vec![tensor("w", &[], &[0.0]), tensor("w", &[1], &[0.0])], "two tensors are named `w`"),
            (
                vec![tensor("__metadata__", &[], &[0.0])],
                "a tensor cannot be named `__metadata__` in a safetensors file",
            ),
        ] {
            assert_eq!(encode(&tensors).unwrap_err(), problem);
        }
    }
}
