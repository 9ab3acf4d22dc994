#!/usr/bin/env bash
# Runs the slow checks, which .ci/run does not contain or contains in a short form:
#
#   tools/nightly.sh [SECONDS]
#
# 1. the fit of all measured materials against Cook-Torrance (requires GONIO_DATA);
# 2. kills, small disks, crowds of processes, and threads (the ignored tests of gonio-cli);
# 3. the feature `raw`, on a DNG that its test writes;
# 4. the interactive sphere of the report against brute-force integration, in Chromium;
# 5. the page that infers in a browser, in Chromium;
# 6. the Blender add-on in Blender;
# 7. the tutorial and the slow tests of the Python package;
# 8. each fuzz target for SECONDS (60 by default; requires a nightly toolchain).
#
# Run .ci/run first, which installs the packages.
set -euo pipefail
cd "$(dirname "$0")/.."
seconds=${1:-60}
if [ -z "${GONIO_DATA:-}" ] && [ -d ../shared/data ]; then
    GONIO_DATA="$(cd ../shared/data && pwd)"
    export GONIO_DATA
fi

echo "== measured materials"
if [ -n "${GONIO_DATA:-}" ]; then
    cargo test -p gonio-eval -p shared-features -- --ignored
else
    echo "not run: GONIO_DATA is not set"
fi

echo "== reliability"
GONIO_NO_PICTURES=0 cargo test -p gonio-cli -p shared-features --test cli -- --ignored reliability

echo "== raw"
# gonio-io is compiled once more, so without optimisation.
cargo test -p gonio-io -p shared-features --features gonio-io/raw --test io \
    --config profile.dev.package.gonio-io.opt-level=0 raw::

echo "== interactive sphere"
python="${MITSUBA_VENV:-$PWD/target/mitsuba-venv}"
browser=crates/gonio-report/tests/browser
page="$(mktemp -d)/viewer.html"
"$python/bin/python" $browser/viewer_example.py "$page"
node $browser/viewer.mjs "$page"

echo "== page of the browser"
cargo build -p gonio-cli -p shared-features
cargo test -p xtask --features web
pages="$(mktemp -d)"
cargo run -p xtask --features web -- web -o "$pages/web"
target/debug/gonio infer samples/ball.exr -o "$pages/ball"
target/debug/gonio export "$pages/ball" --to merl -o "$pages/merl"
# Drops the sample on the page, and compares its BRDF with that of the program.
node crates/gonio-web/tests/check.mjs "$pages/web/index.html" samples/ball.exr "$pages/merl/brdf.binary"

echo "== Blender"
# The module bpy 4.5 requires Python 3.11.
blender="${BLENDER_VENV:-$PWD/target/blender-venv}"
[ -x "$blender/bin/pip" ] || python3.11 -m venv "$blender"
"$blender/bin/pip" install --quiet --disable-pip-version-check bpy==4.5.15
"$blender/bin/python" crates/gonio-cli/tests/exports/addon.py target/debug/gonio samples/ball.exr

echo "== Python"
GONIO_CLI="$PWD/target/debug/gonio" crates/gonio-python/check.sh --all

echo "== fuzz"
out="$(mktemp -d)"
fuzz/build.sh "$out/bin"
fuzz/run.sh "$out/bin" fuzz/seeds "$out/found" "$seconds"
cat "$out/found/summary.txt"
