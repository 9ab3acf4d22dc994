//! `gonio-eval bench`: compares estimators and references over a grid of materials and lights.
//!
//! A run first renders all pictures, one light after the other because a light tree is large. Then
//! each thread estimates from one photograph at a time. Both halves store finished work: renders in
//! the cache, cells in the folder of the run.

mod estimators;
mod grid;
mod judge;
mod learning;
mod merge;
mod options;
mod progress;
mod renders;
mod report;
mod run;
mod stage;
mod store;
mod summary;

pub(crate) use grid::Protocol;
pub(crate) use merge::{MergeOptions, merge};
pub(crate) use options::Options;
pub(crate) use progress::Progress;
#[cfg(test)]
pub(crate) use renders::white;
pub(crate) use renders::{ACCURACY, DRAFT, add_noise};
pub(crate) use run::bench;
pub(crate) use stage::Stage;
