//! Reports on an estimate: the HTML page ([`report`]) and its pictures ([`panels`], [`summary`],
//! [`uncertainty`], [`combined`], [`regions`]). [`probe`] draws the result of a light probe,
//! [`check`] the detected object in a photograph; [`compare`] is a page of several results.
//!
//! This crate does not access files: pictures are linear display values, which `gonio-io` encodes.
//! [`page`] is the common frame of all reports.

pub mod canvas;
pub mod check;
pub mod combined;
pub mod compare;
pub mod page;
pub mod panels;
pub mod probe;
pub mod regions;
pub mod report;
pub mod summary;
pub mod uncertainty;
