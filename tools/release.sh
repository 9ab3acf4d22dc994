#!/usr/bin/env bash
# Builds the files of a release for this system into the folder OUTPUT:
#   tools/release.sh OUTPUT
# - gonio-VERSION-HOST.tar.gz (.zip on Windows): the program, manual pages, completions, licences;
# - gonio-VERSION.html: the page that infers in a browser;
# - gonio-VERSION.cdx.json: the software bill of materials;
# - gonio-*.whl: the Python package, if maturin is installed;
# - SHA256SUMS: the checksums of these files.
set -euo pipefail
[ $# -eq 1 ] || { echo "error: usage: $0 OUTPUT" >&2; exit 2; }
mkdir -p "$1"
output="$(cd "$1" && pwd)"
[ -z "$(ls -A "$output")" ] || { echo "error: $output: is not empty; specify a new folder" >&2; exit 2; }
cd "$(dirname "$0")/.."
target="${CARGO_TARGET_DIR:-target}"

cargo build --release --locked --package gonio-cli
gonio="$target/release/gonio"
version="$("$gonio" --version | sed -n '1s/^gonio \([^ ]*\).*/\1/p')"
host="$(rustc -vV | sed -n 's/^host: //p')"
name="gonio-$version-$host"
parts="$(mktemp -d)"
trap 'rm -rf "$parts"' EXIT
mkdir -p "$parts/$name/completions"
cp README.md CHANGELOG.md LICENSE-MIT LICENSE-APACHE "$parts/$name/"
cp crates/gonio-io/model/PROVENANCE.md "$parts/$name/MODEL.md"
"$gonio" man -o "$parts/$name/man"
for shell in bash zsh fish powershell; do "$gonio" completions "$shell" > "$parts/$name/completions/gonio.$shell"; done
if [ -f "$gonio.exe" ]; then
    cp "$gonio.exe" "$parts/$name/"
    (cd "$parts" && 7z a -bso0 "$output/$name.zip" "$name")
else
    cp "$gonio" "$parts/$name/"
    tar -czf "$output/$name.tar.gz" -C "$parts" "$name"
fi

cargo run --quiet --locked --package xtask -- sbom -o "$output/gonio-$version.cdx.json"
rustup target add wasm32-unknown-unknown
cargo run --quiet --locked --package xtask --features web -- web -o "$parts/web"
cp "$parts/web/index.html" "$output/gonio-$version.html"
if command -v maturin > /dev/null; then
    (cd crates/gonio-python && maturin build --release --locked --out "$output")
else
    echo "no wheel: maturin is not installed"
fi
sums() { if command -v sha256sum > /dev/null; then sha256sum -- "$@"; else shasum -a 256 -- "$@"; fi; }
(cd "$output" && sums * > "$parts/sums" && mv "$parts/sums" SHA256SUMS && cat SHA256SUMS)
