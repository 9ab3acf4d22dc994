#!/usr/bin/env bash
# Runs the slow checks, which .ci/run does not contain or contains in a short form:
#
#   tools/nightly.sh [SECONDS]
#
# kills, small disks, crowds of processes and threads (ignored tests of gonio-cli), the Blender add-on
# in Blender, and each fuzz target for SECONDS (60 by default; requires a nightly toolchain).
set -euo pipefail
cd "$(dirname "$0")/.."
seconds=${1:-60}

echo "== reliability"
cargo test -p gonio-cli -p shared-features --test cli -- --ignored reliability

echo "== Blender"
# The module bpy 4.5 requires Python 3.11.
blender="${BLENDER_VENV:-$PWD/target/blender-venv}"
[ -x "$blender/bin/pip" ] || python3.11 -m venv "$blender"
"$blender/bin/pip" install --quiet --disable-pip-version-check bpy==4.5.15
cargo build -p gonio-cli -p shared-features
"$blender/bin/python" crates/gonio-cli/tests/exports/addon.py target/debug/gonio samples/ball.exr

echo "== fuzz"
out="$(mktemp -d)"
fuzz/build.sh "$out/bin"
fuzz/run.sh "$out/bin" fuzz/seeds "$out/found" "$seconds"
cat "$out/found/summary.txt"
