//! Contains only dependencies: the features of libraries that the workspace as a whole enables. The
//! program, the Python package and xtask are therefore built with the libraries of the tests.
//! `cargo hakari generate` writes the manifest.
