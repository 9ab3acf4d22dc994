#!/usr/bin/env python3
"""Runs all benches, prints their times as ratios, and fails if a row became slower.

    tools/bench.py [--quick] [--record] [BENCH ...]

A ratio is the time of a row over that of three products of 2,000 x 2,000 matrices in the same run,
so that machines can be compared. `tools/bench.csv` contains the ratios of an earlier run. A row
whose ratio is more than 20 % larger is a regression, and the exit code is 1. `--record` writes the
ratios of this run to that file. BENCH is app, library, paper or training; the default is all.
"""

import argparse
import csv
import re
import subprocess
import sys
from pathlib import Path

PACKAGES = {"app": "gonio-app", "library": "gonio", "paper": "gonio-paper", "training": "gonio-train"}
RECORD = Path(__file__).with_name("bench.csv")
TOLERANCE = 1.2
# Width of the names in the table of the bench app.
NAME = 42

SECONDS = {"s": 1.0, "ms": 1e-3, "µs": 1e-6, "us": 1e-6, "ns": 1e-9}
UNIT = re.compile(r"products of .*: ([\d.]+) s, (\d+) GFLOP/s")
DURATION = re.compile(r"([\d.]+) (s|ms|µs|us|ns)$")


def unit_of(text: str) -> tuple[float, int]:
    """Seconds of the products, and their rate in GFLOP/s, in the output of the bench `app`."""
    found = UNIT.search(text)
    if found is None:
        raise ValueError("the bench of gonio-app did not print the time of the products")
    return float(found[1]), int(found[2])


def app_rows(text: str) -> dict[str, float]:
    """Seconds of each row of the table of stages, in its column `total`."""
    rows, end = {}, 0
    for line in text.splitlines():
        if line.startswith(" ") and "total" in line:
            end = line.index("total") + len("total")
        elif end:
            # Columns are right-aligned. The name is left of the first of them.
            time = line[:end].rsplit(maxsplit=1)
            if len(line) > end and re.fullmatch(r"[\d.]+", time[-1] if time else ""):
                rows[line[:NAME].strip()] = float(time[-1])
    found = re.search(r"^(sphere of .*): ([\d.]+) s", text, re.MULTILINE)
    if found:
        rows[found[1]] = float(found[2])
    return rows


def divan_rows(text: str) -> dict[str, float]:
    """Seconds of the fastest sample of each row in the tree that divan prints."""
    rows, parents = {}, []
    for line in text.splitlines():
        found = re.match(r"^((?:[│ ]  )*)[├╰]─ (\S+)\s*(.*)$", line)
        if not found:
            continue
        depth = len(found[1]) // 3
        parents[depth:] = [found[2]]
        time = DURATION.search(found[3].split("│")[0].strip())
        if time:
            rows[" ".join(parents)] = float(time[1]) * SECONDS[time[2]]
    return rows


def plain_rows(text: str) -> dict[str, float]:
    """Seconds of rows such as `512 photographs      2.3000 s`."""
    found = re.findall(r"^(\S.*?) {2,}([\d.]+) s$", text, re.MULTILINE)
    return {name: float(seconds) for name, seconds in found}


ROWS = {"app": app_rows, "library": divan_rows, "paper": divan_rows, "training": plain_rows}


def regressions(ratios: dict[str, float], recorded: dict[str, float]) -> list[str]:
    """Describes the rows that are slower than recorded by more than the tolerance."""
    slower = ((name, ratio, recorded.get(name)) for name, ratio in ratios.items())
    return [
        f"{name}: {ratio:.3g} units, {100 * (ratio / before - 1):.0f} % more than the recorded {before:.3g}"
        for name, ratio, before in slower
        if before is not None and ratio > TOLERANCE * before
    ]


def run(package: str, words: list[str]) -> str:
    """Runs the benches of a package and returns their output."""
    command = ["cargo", "bench", "--quiet", "-p", package, "-p", "shared-features"] + (["--", *words] if words else [])
    done = subprocess.run(command, stdout=subprocess.PIPE, text=True, cwd=RECORD.parents[1], check=False)
    if done.returncode != 0:
        sys.exit(f"{' '.join(command)}: failed with exit code {done.returncode}")
    return done.stdout


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="leave out the largest inputs of the bench app")
    parser.add_argument("--record", action="store_true", help=f"write the ratios to tools/{RECORD.name}")
    parser.add_argument("bench", nargs="*", choices=[*PACKAGES, []], metavar="BENCH")
    given = parser.parse_args()
    chosen = given.bench or list(PACKAGES)
    recorded = {}
    if RECORD.exists():
        with RECORD.open(newline="") as file:
            recorded = {row["row"]: float(row["units"]) for row in csv.DictReader(file)}
    # The bench app also measures the unit; a word that selects no row leaves out everything else.
    outputs = {"app": run(PACKAGES["app"], ["quick"] if given.quick else [] if "app" in chosen else ["no row"])}
    unit, rate = unit_of(outputs["app"])
    print(f"unit: {unit:.3f} s ({rate} GFLOP/s in f64)")
    ratios = {}
    for bench in chosen:
        text = outputs.get(bench) or run(PACKAGES[bench], [])
        rows = ROWS[bench](text)
        if not rows:
            sys.exit(f"the bench {bench} printed no rows:\n{text}")
        for name, seconds in rows.items():
            ratios[f"{bench}: {name}"] = seconds / unit
            before = recorded.get(f"{bench}: {name}")
            print(f"{bench}: {name:50} {seconds:10.4g} s {seconds / unit:10.4g} units", f"(recorded {before:.4g})" if before else "")
    if given.record:
        with RECORD.open("w", newline="") as file:
            writer = csv.writer(file, lineterminator="\n")
            writer.writerow(["row", "units"])
            writer.writerows((name, f"{ratio:.4g}") for name, ratio in sorted({**recorded, **ratios}.items()))
        return 0
    slower = regressions(ratios, recorded)
    for line in slower:
        print(f"slower: {line}", file=sys.stderr)
    return 1 if slower else 0


if __name__ == "__main__":
    sys.exit(main())
