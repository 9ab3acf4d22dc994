//! Trains the [`Encoder`](gonio::inference::learnt::Encoder) on an endless stream of simulated
//! images.
//!
//! Forward and backward passes use the same matrix products as the encoder itself. A batch is
//! divided into parts of a fixed size. One thread draws a part and runs both passes on it. The
//! gradients are summed in order, so that the result does not depend on the number of threads.

#![deny(clippy::print_stdout, clippy::print_stderr)]

mod checkpoint;
mod dense;
mod importance;
mod initial;
mod learn;
mod loss;
mod optimiser;
mod parameters;
mod pass;
mod photographs;
#[cfg(test)]
mod tests;
mod train;

pub use checkpoint::Checkpoint;
pub use initial::InitialPosterior;
pub use learn::{TrainingLosses, learn};
pub use photographs::Photographs;
pub use train::{MICRO_BATCH, Monitor, TrainError, Trained, TrainingSettings, train};

/// An endless stream of images with the targets to be estimated from them. Within a step of the
/// training, an index always gives the same sample.
pub trait Samples: Sync {
    /// Prepares the samples of a step; called before each step.
    fn advance(&mut self, _step: usize) {}

    /// Cells along a side of the images.
    fn side(&self) -> usize;
    /// Channels of the images.
    fn channels(&self) -> usize;
    /// Number of global values of an image.
    fn globals(&self) -> usize;
    /// Number of values to be estimated from an image.
    fn dimensions(&self) -> usize;
    /// Writes one sample: the image `[side][side][channels]`, its globals and the target, both with
    /// means near 0 and deviations near 1. All buffers are zero before the call.
    fn draw(&self, index: u64, image: &mut [f32], globals: &mut [f32], target: &mut [f32]);
}
