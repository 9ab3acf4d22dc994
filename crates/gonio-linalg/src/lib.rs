//! Linear algebra and vectorised loops whose results do not depend on the number of threads.
//!
//! * [`eigenvectors`], [`solve_positive`], [`principal_axes`], [`weighted_gram`]: symmetric
//!   matrices, on one thread;
//! * [`multiply`], [`product`]: products of matrices, on one thread;
//! * [`Cholesky`]: factors of large matrices, in bands of columns on all threads;
//! * [`column_bands`], [`each_column`]: columns of a matrix, processed concurrently;
//! * [`dispatch`]: runs a loop with the widest vector instructions of the processor;
//! * [`clear_registers`]: clears the vector registers after calls of faer.

mod cholesky;
mod columns;
mod kernels;
mod products;
mod symmetric;

pub use cholesky::{Cholesky, bands_of};
pub use columns::{column_bands, each_column, squared_norms};
pub use kernels::{add_product, axpy, dispatch, dot};
pub use products::{clear_registers, multiply, product};
pub use symmetric::{eigenvectors, principal_axes, project, solve_positive, weighted_gram};
