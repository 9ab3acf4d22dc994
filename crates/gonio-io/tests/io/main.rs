//! What the file formats promise as a whole: damaged files never panic, full disks leave no trace, entries load fast.

#![allow(missing_docs)]

mod damage;
mod disk;
#[cfg(feature = "raw")]
mod raw;
mod rgl;
mod speed;
