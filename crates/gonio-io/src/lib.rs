//! Reads and writes all file formats of gonio, with limits on the size of input.
//!
//! * [`picture`]: photographs, environment maps and masks (OpenEXR, Radiance, PFM, PNG, JPEG,
//!   TIFF);
//! * [`normals`]: normal maps (OpenEXR, PFM, NPY, and the integer formats of pictures);
//! * [`geometry`]: depth and position maps (OpenEXR, PFM, NPY, PNG, TIFF);
//! * [`material`]: materials for renderers (Mitsuba, MaterialX, glTF, Blender);
//! * [`mesh`]: triangle meshes (OBJ, PLY, glTF);
//! * [`colour_space`]: named colour spaces and the matrices between them;
//! * [`camera`]: cameras and poses (`docs/camera.md`);
//! * [`brdf`]: measured BRDFs in the formats of [`merl`], [`rgl`], [`mbsdf`] and [`brdf_csv`];
//!   [`bivariate`]: sets of bivariate tables;
//! * [`model`]: trained models and their parts (`docs/model-format.md`);
//! * [`lights`]: lists of directional lights;
//! * [`posterior`]: posteriors of single photographs, to be combined;
//! * [`result`]: the documents `result.json` and `export.json`; [`json`]: JSON files; [`table`]:
//!   comma-separated tables;
//! * [`npy`]: arrays of numpy; [`result_brdf`]: BRDFs of results, as archives of such arrays;
//! * [`folder`]: listing of folders; [`atomic`]: output that appears complete or not at all;
//!
//! Invariants: no input makes this crate panic; sizes are checked before memory is allocated. An
//! [`Error`] always names the file, the problem and the suggestion, on one line. This crate never
//! prints anything. It catches panics of third-party decoders on damaged files, but the panic hook
//! has printed its message by then.

#![deny(clippy::print_stdout, clippy::print_stderr)]

pub mod atomic;
pub mod bivariate;
pub mod brdf;
pub mod brdf_csv;
pub mod camera;
pub mod colour_space;
mod error;
pub mod folder;
pub mod geometry;
mod guard;
pub mod json;
pub mod lights;
mod little_endian;
pub mod material;
pub mod mbsdf;
pub mod merl;
pub mod mesh;
pub mod model;
pub mod normals;
pub mod npy;
pub mod picture;
pub mod posterior;
pub mod result;
pub mod result_brdf;
pub mod rgl;
pub mod table;

pub use error::{Error, Kind};
