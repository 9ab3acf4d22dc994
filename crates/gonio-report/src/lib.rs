//! What an estimate looks like: one page to read ([`report`]), its pictures ([`panels`],
//! [`summary`], [`uncertainty`]).
//!
//! Nothing is read or written here: pictures are linear display values, which `gonio-io` encodes.
//! [`page`] is the frame of all reports.

pub mod canvas;
pub mod page;
pub mod panels;
pub mod report;
pub mod summary;
pub mod uncertainty;
