//! The arithmetic that takes the time: matrix products, gates and their derivatives, each with a hand
//! written backward pass. Checked against finite differences and candle's autograd in `tests/`.

pub mod gemm;
pub mod gru;
pub mod linear;
pub mod math;
