#!/usr/bin/env bash
# Builds a model from sources that all allow commercial use (docs/licences.md):
#   tools/commercial_model.sh LIGHTS MATERIALS OUTPUT [OPTION of gonio train posterior ...]
# LIGHTS: folder with the lights of tools/cc0_lights.txt, as NAME.hdr, NAME.exr or NAME.pfm. Others in
# the same folder are not used. MATERIALS: folder of the MERL database. GONIO: the program for
# the training; by default the script builds it.
set -euo pipefail

fail() { echo "error: $1" >&2; exit 2; }
[ $# -ge 3 ] || fail "usage: $0 LIGHTS MATERIALS OUTPUT [OPTION ...]"
lights=$1 materials=$2 output=$3
shift 3
for option in "$@"; do
    case "$option" in --initial*) fail "--initial: other models have other terms" ;; esac
done
tools="$(cd "$(dirname "$0")" && pwd)"
[ -d "$lights" ] || fail "$lights: not a folder"
lights="$(cd "$lights" && pwd)"

parts="$(mktemp -d)"
trap 'rm -rf "$parts"' EXIT
mkdir "$parts/lights"
missing=
for name in $(grep -v '^#' "$tools/cc0_lights.txt"); do
    found=
    for kind in hdr exr pfm; do
        [ -n "$found" ] || ! [ -f "$lights/$name.$kind" ] || found="$name.$kind"
    done
    if [ -n "$found" ]; then ln -s "$lights/$found" "$parts/lights/"; else missing="$missing $name"; fi
done
[ -z "$missing" ] || fail "$lights: does not hold$missing; polyhaven.com has them"

if [ -z "${GONIO:-}" ]; then
    cargo build --release --locked --manifest-path "$tools/../Cargo.toml" --package gonio-cli
    GONIO="$tools/../target/release/gonio"
fi
"$GONIO" train lighting "$parts/lights" -o "$parts/light.prior"
"$GONIO" train reflectance "$materials" -o "$parts/reflectance.basis"
"$GONIO" train posterior --lights "$parts/lights" --materials "$materials" -o "$parts/posterior" "$@"
"$GONIO" train model --lighting "$parts/light.prior" --reflectance "$parts/reflectance.basis" \
    --posterior "$parts/posterior" -o "$output"
