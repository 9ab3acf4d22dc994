//! What an estimate looks like: pictures of it ([`summary`], [`uncertainty`]), and its numbers by name ([`notes`]).
//!
//! Nothing is read or written here: pictures are linear display values, which `gonio-io` encodes.

pub mod canvas;
pub mod notes;
pub mod summary;
pub mod uncertainty;
