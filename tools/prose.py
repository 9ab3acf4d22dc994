#!/usr/bin/env python3
"""Checks the prose of the repository: wording, length of sentences, width of lines, links.

Checks Markdown files, comments, docstrings and messages of the files under version control, and
prints `file:line: reason: excerpt` for each finding. The rules are in tools/prosecheck/rules.py.
"""

import argparse
import subprocess
import sys
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

from prosecheck import clike, markdown, scripts
from prosecheck.passage import Passage
from prosecheck.rules import Finding, findings

MAX_COLUMNS = 100

C_LIKE = {".rs", ".js", ".mjs", ".css"}
PYTHON = {".py", ".pyi"}
HASH = {".sh", ".sbatch", ".toml", ".yml"}
HASH_NAMES = {"run", "Containerfile"}


def passages(path: Path, text: str) -> Iterator[Passage]:
    """The prose of a file; strings of tests are not messages."""
    messages = "tests" not in path.parts and path.name != "tests.rs"
    if path.suffix == ".md":
        yield from markdown.file_passages(text)
    elif path.suffix in C_LIKE:
        yield from clike.file_passages(text, path.suffix, messages)
    elif path.suffix in PYTHON:
        yield from scripts.python_passages(text, messages)
    elif path.suffix in HASH or path.name in HASH_NAMES:
        yield from scripts.hash_passages(text)


def wide_lines(path: Path, text: str) -> Iterator[Finding]:
    """The lines of prose that are too wide; a single long word cannot be wrapped."""
    for number, line in wrapped_lines(path, text):
        if len(line) > MAX_COLUMNS and len(line.split()) > 3:
            yield Finding(number, f"a line of {len(line)} columns", line.strip()[:60] + " ...")


def wrapped_lines(path: Path, text: str) -> Iterator[tuple[int, str]]:
    """The lines of a Markdown file, and the comments of a Rust file, that can be wrapped."""
    if path.suffix == ".md":
        yield from markdown.wrapped_lines(text)
    elif path.suffix == ".rs":
        for number, line in enumerate(text.splitlines(), 1):
            if line.strip().startswith("//"):
                yield number, line


def check(path: Path) -> list[Finding]:
    """The findings of a file, in the order of its lines."""
    text = path.read_text(encoding="utf-8")
    found = list(wide_lines(path, text))
    found += [it for passage in passages(path, text) for it in findings(passage)]
    if path.suffix == ".md":
        for link, reason in markdown.broken_links(path, text):
            line = text.count("\n", 0, text.find(f"]({link})")) + 1
            found.append(Finding(line, reason, link))
    return sorted(found, key=lambda it: it.line)


def tracked_files(paths: list[str]) -> list[Path]:
    """The files under version control, or those of them below the given paths."""
    command = ["git", "ls-files", "-z", "--", *paths]
    names = subprocess.run(command, check=True, capture_output=True, text=True).stdout
    suffixes = {".md"} | C_LIKE | PYTHON | HASH
    files = (Path(name) for name in names.split("\0") if name)
    checked = (it for it in files if it.suffix in suffixes or it.name in HASH_NAMES)
    return [it for it in checked if it.is_file()]


def arguments() -> argparse.Namespace:
    """The arguments of the command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("paths", nargs="*", help="files or folders (default: all)")
    parser.add_argument(
        "--counts", action="store_true", help="print the number of findings per file only"
    )
    return parser.parse_args()


def main() -> None:
    """Prints the findings; the exit status is 1 if there are any."""
    args = arguments()
    counts: Counter[str] = Counter()
    for path in tracked_files(args.paths):
        for found in check(path):
            counts[str(path)] += 1
            if not args.counts:
                print(f"{path}:{found.line}: {found.reason}: {found.excerpt}")
    if args.counts:
        for name, count in counts.most_common():
            print(f"{count:5} {name}")
    if counts:
        sys.exit(f"{counts.total()} findings in {len(counts)} files")


if __name__ == "__main__":
    main()
