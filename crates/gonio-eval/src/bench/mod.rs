//! `gonio-eval bench`: estimators and references against each other over a grid of materials and
//! lights.
//!
//! First everything is rendered, light by light (a tree of light is large), then the photographs
//! are worked on, one by each thread. Both halves keep what is finished: renders in the cache,
//! cells in the folder of the run.

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
pub(crate) use renders::{ACCURACY, DRAFT, add_noise};
pub(crate) use run::bench;
pub(crate) use stage::Stage;
