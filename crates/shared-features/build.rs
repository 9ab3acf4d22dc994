//! Cargo considers the dependencies of build scripts only where there is a build script.

fn main() {}
