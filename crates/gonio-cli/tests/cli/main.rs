//! Tests of the program: its output for valid input, and one-line errors without output for invalid
//! input.

#![allow(missing_docs)]

mod asking;
mod batch;
mod check;
mod colour;
mod combine;
mod compare;
mod export;
mod finding;
mod folders;
mod help;
mod hostile;
mod infer;
mod learnt;
mod light;
mod merge;
mod pictures;
mod public;
mod references;
mod refusals;
mod regions;
mod reliability;
mod render;
mod report;
mod shapes;
mod spaces;
mod support;
mod train;
