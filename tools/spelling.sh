#!/usr/bin/env bash
# Checks the spelling of all files and file names, by the rules of typos.toml. Uses an installed
# `typos`, or downloads the pinned version to target/supply-venv.
set -euo pipefail
cd "$(dirname "$0")/.."

typos="$(command -v typos || true)"
if [ -z "$typos" ]; then
    tools="$PWD/target/supply-venv"
    [ -x "$tools/bin/pip" ] || python3 -m venv "$tools"
    "$tools/bin/pip" install --quiet --disable-pip-version-check --require-hashes --only-binary :all: \
        --requirement tools/typos.txt
    typos="$tools/bin/typos"
fi
"$typos" --version
"$typos"
