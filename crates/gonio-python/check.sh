#!/usr/bin/env bash
# Builds the wheel, installs it into a new virtual environment, and checks tests, examples and types there.
#
#   check.sh [--all]
#
# --all: also run the tests that are marked as slow, and the tutorial.
# PYTHON_VENV: environment of tools, kept between runs. GONIO_CLI: program whose results the package must reproduce.
set -euo pipefail
cd "$(dirname "$0")"
target="${CARGO_TARGET_DIR:-$PWD/../../target}"
tools="${PYTHON_VENV:-$target/python-venv}"
case "${1:-}" in
    --all) all=1 tests=() ;;
    "") all= tests=(-m "not slow") ;;
    *) echo "usage: $0 [--all]" >&2; exit 2 ;;
esac
step() { echo "== python: $1 ($SECONDS s)"; }

step "tools"
[ -x "$tools/bin/pip" ] || python3 -m venv "$tools"
"$tools/bin/pip" install --quiet --disable-pip-version-check -r requirements.txt

# The profile of the workspace's tests, so that their libraries are reused.
step "wheel"
wheels="$(mktemp -d)"
trap 'rm -rf "$wheels"' EXIT
"$tools/bin/maturin" build --profile dev --locked --out "$wheels" --quiet

step "a new environment"
python3 -m venv "$wheels/new"
"$wheels/new/bin/pip" install --quiet --disable-pip-version-check "$wheels"/gonio-*.whl
# The path contains no compiler.
env -i PATH="$wheels/new/bin" "$wheels/new/bin/python" tests/installed.py

"$tools/bin/pip" install --quiet --disable-pip-version-check --force-reinstall --no-deps "$wheels"/gonio-*.whl

# Much of this code uses one core, so two parts of the checks run side by side.
second_part=(test_brdf.py test_outputs.py test_show.py test_train.py)
pytest=("$tools/bin/python" -m pytest -q --durations=10 -p no:cacheprovider)
step "tests, beside further tests, examples of the documentation and types"
beside() {
    set -e
    step "further tests"
    (cd tests && "${pytest[@]}" "${tests[@]}" "${second_part[@]}")

    # Runs the examples of the docstrings.
    step "examples of the documentation"
    (cd tests && PYTHONPATH=. "${pytest[@]}" -p conftest --doctest-modules --pyargs gonio)

    step "types"
    "$tools/bin/python" -m mypy --cache-dir "$wheels/mypy" python/gonio
    (cd tests && "$tools/bin/python" -m mypy --strict --cache-dir "$wheels/mypy-use" typed.py)
    echo 'gonio._gonio.__all__' > "$wheels/allowed"
    (cd "$wheels" && "$tools/bin/python" -m mypy.stubtest gonio._gonio --allowlist allowed)

    [ "$all" ] || return 0
    step "tutorial"
    "$tools/bin/python" - ../../docs/tutorial.ipynb <<'PYTHON'
import pathlib, sys, tempfile
import nbclient, nbformat

path = pathlib.Path(sys.argv[1]).resolve()
notebook = nbformat.read(path, as_version=4)
assert all(cell.outputs or cell.metadata.get("tags") == ["quiet"] for cell in notebook.cells if cell.cell_type == "code"), "a cell has no output"
nbclient.NotebookClient(notebook, timeout=600, kernel_name="python3", resources={"metadata": {"path": path.parent}}).execute()
PYTHON
    step "end of the tutorial"
}
(beside) >"$wheels/beside.log" 2>&1 &
other=$!
failed=0
(cd tests && "${pytest[@]}" "${tests[@]}" "${second_part[@]/#/--ignore=}" .) || failed=1
wait $other || failed=1
cat "$wheels/beside.log"
step "done"
exit $failed
