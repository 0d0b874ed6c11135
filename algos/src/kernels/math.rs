//! Elementary functions that vectorise, and loops compiled once per instruction set.
//!
//! The standard library's `exp` and `tanh` call the system's scalar routines. They are ten times slower here and differ
//! between C libraries. These functions use only additions, multiplications and bit shifts, in one order and without
//! fused multiply-add, so AVX-512, AVX2 and plain SSE give the same bits.

/// Runs `f` with the widest vector instructions that the processor has (chosen at run time).
#[inline]
pub fn vectorized<R>(f: impl FnOnce() -> R) -> R {
    pulp::Arch::new().dispatch(f)
}

/// `e^x`, relative error below 3e-7 for `x` in [-87, 88]; clamped outside.
#[inline(always)]
pub fn exp(x: f32) -> f32 {
    /// Adding and subtracting it rounds to the nearest whole number.
    const ROUND: f32 = 12_582_912.0;
    const LN2_HIGH: f32 = 0.693_359_4;
    const LN2_LOW: f32 = -2.121_944_4e-4;
    let x = x.clamp(-87.0, 88.0);
    let shifted = x * std::f32::consts::LOG2_E + ROUND;
    let n = shifted - ROUND;
    let r = (x - n * LN2_HIGH) - n * LN2_LOW;
    // Taylor to r^7; |r| <= ln2 / 2, so the remainder is below 6e-9.
    let p = 1.0 / 5040.0;
    let p = p * r + 1.0 / 720.0;
    let p = p * r + 1.0 / 120.0;
    let p = p * r + 1.0 / 24.0;
    let p = p * r + 1.0 / 6.0;
    let p = p * r + 0.5;
    let p = p * r + 1.0;
    let p = p * r + 1.0;
    let exponent = shifted.to_bits().wrapping_sub(ROUND.to_bits()).wrapping_add(127) << 23;
    p * f32::from_bits(exponent)
}

/// `1 / (1 + e^-x)`.
#[inline(always)]
pub fn sigmoid(x: f32) -> f32 {
    1.0 / (1.0 + exp(-x))
}

/// `tanh x = 1 - 2 / (e^2x + 1)`, absolute error below 3e-7.
#[inline(always)]
pub fn tanh(x: f32) -> f32 {
    1.0 - 2.0 / (exp(2.0 * x) + 1.0)
}

/// Natural logarithm, the same bits on every host (not the C library's).
#[inline]
pub fn ln(x: f32) -> f32 {
    libm::logf(x)
}

/// Copies `bias` (`cols` numbers) into every row of `out` (`rows × cols`).
pub fn fill_rows(out: &mut [f32], bias: &[f32]) {
    for row in out.chunks_exact_mut(bias.len()) {
        row.copy_from_slice(bias);
    }
}

/// `out[j] += Σ_i rows[i, j]`, top to bottom.
pub fn add_rows(out: &mut [f32], rows: &[f32]) {
    vectorized(|| {
        for row in rows.chunks_exact(out.len()) {
            for (o, x) in out.iter_mut().zip(row) {
                *o += x;
            }
        }
    });
}

/// `Σ x²`, in 16 interleaved partial sums per block of 4096, blocks in double precision.
pub fn sum_of_squares(x: &[f32]) -> f64 {
    vectorized(|| {
        let mut total = 0.0f64;
        for block in x.chunks(4096) {
            let mut lanes = [0.0f32; 16];
            let mut groups = block.chunks_exact(16);
            for group in &mut groups {
                for (lane, x) in lanes.iter_mut().zip(group) {
                    *lane += x * x;
                }
            }
            for (lane, x) in lanes.iter_mut().zip(groups.remainder()) {
                *lane += x * x;
            }
            total += lanes.iter().map(|&l| f64::from(l)).sum::<f64>();
        }
        total
    })
}

/// Whether no number is infinite or NaN.
pub fn all_finite(x: &[f32]) -> bool {
    const INFINITE: u32 = f32::INFINITY.to_bits();
    // The largest magnitude as an integer: without an early exit this becomes vector instructions.
    vectorized(|| x.iter().fold(0, |largest, x| x.abs().to_bits().max(largest))) < INFINITE
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sweep(from: f64, to: f64) -> impl Iterator<Item = f32> {
        (0..=200_000).map(move |i| (from + (to - from) * f64::from(i) / 200_000.0) as f32)
    }

    #[test]
    fn one_number_that_is_none_is_found_wherever_it_stands() {
        assert!(all_finite(&[]) && all_finite(&[f32::MAX, f32::MIN, -0.0, f32::MIN_POSITIVE / 2.0]));
        for bad in [f32::NAN, -f32::NAN, f32::INFINITY, f32::NEG_INFINITY] {
            for at in [0, 1, 7, 63, 99] {
                let mut numbers = vec![1.0; 100];
                numbers[at] = bad;
                assert!(!all_finite(&numbers), "{bad} at {at}");
            }
        }
    }

    #[test]
    fn exp_agrees_with_double_precision() {
        for x in sweep(-87.0, 88.0) {
            let exact = f64::from(x).exp();
            assert!((f64::from(exp(x)) / exact - 1.0).abs() < 3e-7, "exp({x}) = {}", exp(x));
        }
        assert_eq!(exp(0.0), 1.0);
        assert!(exp(-1e10) < 2e-38 && exp(1e10).is_finite());
    }

    #[test]
    fn sigmoid_and_tanh_agree_with_double_precision() {
        for x in sweep(-30.0, 30.0) {
            let x64 = f64::from(x);
            assert!((f64::from(sigmoid(x)) - 1.0 / (1.0 + (-x64).exp())).abs() < 3e-7);
            assert!((f64::from(tanh(x)) - x64.tanh()).abs() < 3e-7, "tanh({x}) = {}", tanh(x));
        }
        assert_eq!((tanh(0.0), sigmoid(0.0)), (0.0, 0.5));
    }

    #[test]
    fn vectorized_and_plain_loops_give_the_same_bits() {
        let x: Vec<f32> = sweep(-20.0, 20.0).collect();
        let mut wide = x.clone();
        vectorized(|| wide.iter_mut().for_each(|x| *x = tanh(*x) + sigmoid(*x)));
        assert!(x.iter().zip(&wide).all(|(x, w)| (tanh(*x) + sigmoid(*x)).to_bits() == w.to_bits()));
    }

    #[test]
    fn sums_are_exact_on_small_whole_numbers() {
        let x: Vec<f32> = (0..10_001).map(|i| (i % 5) as f32).collect();
        assert_eq!(sum_of_squares(&x), x.iter().map(|x| f64::from(x * x)).sum::<f64>());
        let mut columns = [100.0, 0.0, 0.0];
        add_rows(&mut columns, &[1.0, 2.0, 3.0, 10.0, 20.0, 30.0]);
        assert_eq!(columns, [111.0, 22.0, 33.0]);
    }
}
