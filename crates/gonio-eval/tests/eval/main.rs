//! What needs the program as a whole, or the measured data.

mod bench;
mod captured;
mod data;
mod folds;
mod world;
