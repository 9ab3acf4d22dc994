//! Reads and writes all file formats of gonio, with limits on the size of input.
//!
//! * [`picture`]: photographs, light maps and masks (OpenEXR, Radiance, PFM, PNG, JPEG, TIFF);
//! * [`normals`]: normal maps (OpenEXR, PFM, NPY, PNG);
//! * [`geometry`]: depth and position maps (OpenEXR, NPY, PNG);
//! * [`material`]: materials for renderers (Mitsuba, MaterialX, glTF, Blender);
//! * [`mesh`]: triangle meshes (OBJ, PLY, glTF);
//! * [`colour_space`]: named colour spaces and the matrices between them;
//! * [`camera`]: cameras and poses (`docs/camera.md`);
//! * [`brdf`]: measured BRDFs, of [`merl`] and [`rgl`]; [`bivariate`], [`fits`]: sets of them and
//!   published fits;
//! * [`model`]: trained models and their halves (`docs/model-format.md`);
//! * [`lights`]: lists of directional lights;
//! * [`posterior`]: what a photograph says of a material, to be combined;
//! * [`notes`]: numbers by name, of a folder of results; [`table`]: tables with commas;
//! * [`npy`]: arrays of numpy;
//! * [`folder`]: listing of folders; [`atomic`]: output that appears complete or not at all;
//! * [`cache`], [`plan`]: computed plans kept between runs.
//!
//! Invariants: no input makes this crate panic; sizes are checked before memory is taken for them;
//! an [`Error`] always names the file, the problem and a way out, on one line; this crate never
//! prints anything (a third party's decoder that panics on a damaged file is caught, but the panic
//! hook has written its message by then).

#![deny(clippy::print_stdout, clippy::print_stderr)]

pub mod atomic;
pub mod bivariate;
pub mod brdf;
pub mod cache;
pub mod camera;
pub mod colour_space;
mod error;
pub mod fits;
pub mod folder;
pub mod geometry;
mod guard;
pub mod lights;
mod little_endian;
pub mod material;
pub mod merl;
pub mod mesh;
pub mod model;
pub mod normals;
pub mod notes;
pub mod npy;
pub mod picture;
pub mod plan;
pub mod posterior;
pub mod rgl;
pub mod table;

pub use error::{Error, Kind};
