//! Tests that need the whole program, or the measured data.

mod bench;
mod captured;
mod data;
mod folds;
mod world;
