//! State of an unfinished training run.

/// State of a training run after some steps. A run that is resumed from it gives the same result as
/// an uninterrupted one.
#[derive(Clone, Debug, PartialEq)]
pub struct Checkpoint {
    /// Parameters.
    pub values: Vec<f32>,
    /// Moving averages of the gradient, of its square, and of the parameters.
    pub moments: [Vec<f32>; 3],
    /// Coordinates of the preceding materials, one after the other.
    pub negatives: Vec<f32>,
    /// Loss of each completed step, in nats.
    pub losses: Vec<f32>,
}

impl Checkpoint {
    /// Returns the number of completed steps.
    pub fn step(&self) -> usize {
        self.losses.len()
    }
}
