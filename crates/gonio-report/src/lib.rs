//! Reports on an estimate: one page to read ([`report`]), and its pictures ([`panels`],
//! [`summary`], [`uncertainty`], [`combined`], [`regions`]). [`probe`] draws what was made of a
//! mirror ball, [`check`] what was found in a photograph before anything is inferred; [`compare`]
//! is a page of several results.
//!
//! This crate reads and writes no files: pictures are linear display values, which `gonio-io`
//! encodes. [`page`] is the frame of all reports.

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
