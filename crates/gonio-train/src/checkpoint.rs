//! State of an unfinished training.

/// State of a training after some steps; a training resumed from it gives the same result.
#[derive(Clone, Debug, PartialEq)]
pub struct Checkpoint {
    /// Number of completed steps.
    pub step: usize,
    /// Parameters.
    pub values: Vec<f32>,
    /// Moving averages of the gradient, of its square, and of the parameters.
    pub moments: [Vec<f32>; 3],
    /// Coordinates of the preceding materials, one after the other.
    pub others: Vec<f32>,
    /// Loss of each completed step, in nats.
    pub losses: Vec<f32>,
}
