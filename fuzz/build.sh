#!/usr/bin/env bash
# Builds all fuzz targets as `cargo fuzz build` does, without a sanitizer, and writes the stripped
# programs to fuzz/device (or to the given folder). They require only the C library, not the C++
# library.
set -euo pipefail
cd "$(dirname "$0")"
to=${1:-device}
coverage="-Cpasses=sancov-module -Cllvm-args=-sanitizer-coverage-level=4"
coverage="$coverage -Cllvm-args=-sanitizer-coverage-inline-8bit-counters"
coverage="$coverage -Cllvm-args=-sanitizer-coverage-pc-table -Cllvm-args=-sanitizer-coverage-trace-compares"
# With a static C library, libFuzzer could not intercept its functions.
library="-Lnative=$(dirname "$(g++ -print-file-name=libstdc++.a)")"
export CXXSTDLIB=static=stdc++
export RUSTFLAGS="--cfg fuzzing $coverage -Ccodegen-units=1 -Cdebug-assertions -Coverflow-checks $library"
cargo +nightly build --release --target x86_64-unknown-linux-gnu --bins
mkdir -p "$to"
for source in fuzz_targets/*.rs; do
    target=$(basename "$source" .rs)
    strip -o "$to/$target" "target/x86_64-unknown-linux-gnu/release/$target"
done
du -sh "$to"
