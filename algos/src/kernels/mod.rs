//! The arithmetic: matrix products, gates and their derivatives, each with a hand-written backward pass. `tests/`
//! checks them against finite differences and candle's autograd.

pub mod gemm;
pub mod gru;
pub mod linear;
pub mod math;
