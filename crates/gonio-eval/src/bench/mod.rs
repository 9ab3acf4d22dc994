//! `gonio-eval bench`: compares estimators and references over a grid of materials and lights.
//!
//! A run first renders all pictures, one light after the other because a light tree is large. Then
//! each thread estimates from one photograph at a time. Both halves store finished work: renders in
//! the cache, cells in the folder of the run.

mod errors;
mod estimators;
mod grid;
mod learning;
mod options;
mod progress;
mod renders;
mod report;
mod run;
mod store;
mod summary;
mod test_sphere;

pub(crate) use grid::{Protocol, id};
pub(crate) use options::BenchOptions;
pub(crate) use progress::Progress;
#[cfg(test)]
pub(crate) use renders::white;
pub(crate) use renders::{ACCURACY, DRAFT, add_noise};
pub(crate) use run::bench;
pub(crate) use test_sphere::TestSphere;
