//! Nothing but dependencies: the features of libraries that the workspace has as a whole, so that
//! the program, the Python package and xtask are built with the libraries of the tests. Its
//! manifest is written by `cargo hakari generate`.
