//! `out = a · b` and `out += a · b` for row-major matrices: the safe wrapper of the `gemm` crate.
//!
//! `gemm` takes raw pointers, so this file is the only one in the workspace that contains `unsafe`.
//! The reason is speed: a safe loop reaches a tenth of the core's peak, `gemm` more than four fifths (it packs, blocks
//! and selects AVX-512, AVX2 or NEON at run time).
#![allow(unsafe_code)]

/// A view of a matrix: `rows × cols` numbers, element `(i, j)` at `i * row_stride + j * col_stride`.
#[derive(Clone, Copy, Debug)]
pub struct Matrix<'a> {
    data: &'a [f32],
    rows: usize,
    cols: usize,
    row_stride: usize,
    col_stride: usize,
}

impl<'a> Matrix<'a> {
    /// The first `rows * cols` numbers of `data`, row by row.
    ///
    /// # Panics
    /// If `data` is shorter than that.
    pub fn new(data: &'a [f32], rows: usize, cols: usize) -> Self {
        assert!(data.len() >= rows * cols, "{} numbers cannot hold {rows} x {cols}", data.len());
        Self { data, rows, cols, row_stride: cols, col_stride: 1 }
    }

    /// The transposed view of the same numbers.
    pub fn t(self) -> Self {
        Self {
            data: self.data,
            rows: self.cols,
            cols: self.rows,
            row_stride: self.col_stride,
            col_stride: self.row_stride,
        }
    }
}

/// `out = a · b`, overwriting `out` (`a.rows × b.cols`, row-major).
///
/// # Panics
/// If the inner sizes differ or `out` is too short.
pub fn product(out: &mut [f32], a: Matrix, b: Matrix) {
    multiply(out, a, b, false);
}

/// `out += a · b`.
///
/// # Panics
/// As [`product`].
pub fn add_product(out: &mut [f32], a: Matrix, b: Matrix) {
    multiply(out, a, b, true);
}

fn multiply(out: &mut [f32], a: Matrix, b: Matrix, accumulate: bool) {
    assert_eq!(a.cols, b.rows, "inner sizes of a matrix product");
    let (m, n, k) = (a.rows, b.cols, a.cols);
    assert!(out.len() >= m * n, "{} numbers cannot hold {m} x {n}", out.len());
    if m == 0 || n == 0 {
        return;
    }
    // SAFETY: `Matrix` is only built by `new`, which checks that `rows * cols` numbers are there, and
    // `t`, which swaps sizes together with strides; so every index the product reads is inside `data`.
    // `out` was checked above and is borrowed mutably, so it overlaps neither input. Strides fit isize
    // because the slices exist in memory.
    unsafe {
        gemm::gemm(
            m,
            n,
            k,
            out.as_mut_ptr(),
            1,
            n as isize,
            accumulate,
            a.data.as_ptr(),
            a.col_stride as isize,
            a.row_stride as isize,
            b.data.as_ptr(),
            b.col_stride as isize,
            b.row_stride as isize,
            1.0,
            1.0,
            false,
            false,
            false,
            gemm::Parallelism::None,
        );
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn plain(
        a: impl Fn(usize, usize) -> f32,
        b: impl Fn(usize, usize) -> f32,
        m: usize,
        n: usize,
        k: usize,
    ) -> Vec<f32> {
        let mut out = vec![0.0; m * n];
        for i in 0..m {
            for j in 0..n {
                out[i * n + j] = (0..k).map(|l| a(i, l) * b(l, j)).sum();
            }
        }
        out
    }

    #[test]
    fn products_of_views_and_their_transposes_equal_the_plain_sum() {
        // Small whole numbers: every order of summation is exact.
        for (m, n, k) in [(1, 1, 1), (3, 5, 7), (10, 384, 128), (17, 1, 33), (64, 6, 20)] {
            let a: Vec<f32> = (0..m * k).map(|i| (i % 7) as f32 - 3.0).collect();
            let b: Vec<f32> = (0..k * n).map(|i| (i % 5) as f32 - 2.0).collect();
            let expected = plain(|i, l| a[i * k + l], |l, j| b[l * n + j], m, n, k);
            let mut out = vec![9.0; m * n];
            product(&mut out, Matrix::new(&a, m, k), Matrix::new(&b, k, n));
            assert_eq!(out, expected);
            add_product(&mut out, Matrix::new(&a, m, k), Matrix::new(&b, k, n));
            assert!(out.iter().zip(&expected).all(|(o, e)| *o == 2.0 * e));

            // (aᵀ)ᵀ stored transposed gives the same product.
            let a_t: Vec<f32> = (0..m * k).map(|i| a[(i % m) * k + i / m]).collect();
            product(&mut out, Matrix::new(&a_t, k, m).t(), Matrix::new(&b, k, n));
            assert_eq!(out, expected);
        }
    }

    #[test]
    fn an_empty_inner_size_gives_zeros() {
        let mut out = vec![3.0; 4];
        product(&mut out, Matrix::new(&[], 2, 0), Matrix::new(&[], 0, 2));
        assert_eq!(out, [0.0; 4]);
    }

    #[test]
    #[should_panic(expected = "cannot hold")]
    fn a_matrix_larger_than_its_numbers_is_refused() {
        Matrix::new(&[0.0; 5], 2, 3);
    }
}
