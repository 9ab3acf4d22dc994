//! Integration tests of the file formats.
//!
//! Damaged files never cause panics, full disks leave no partial files, and cache entries load
//! fast.

#![allow(missing_docs)]

mod colour;
mod corpus;
mod damage;
mod disk;
mod mutation;
mod public;
#[cfg(feature = "raw")]
mod raw;
mod rgl;
mod seeds;
