#!/usr/bin/env python3
"""Checks that prose is at most 100 columns wide: comments of Rust files, paragraphs of Markdown files."""

import subprocess
import sys

WIDTH = 100


def prose(path, text):
    """Lines of prose with their numbers: no code, tables, pictures, links alone or headings."""
    code = False
    for number, line in enumerate(text.splitlines(), 1):
        stripped = line.strip()
        if path.endswith(".rs"):
            if stripped.startswith("//"):
                yield number, line
            continue
        if stripped.startswith("```"):
            code = not code
        elif not code and not stripped.startswith(("|", "![", "#", "<")):
            yield number, line


def main():
    files = subprocess.run(["git", "ls-files", "*.rs", "*.md"], check=True, capture_output=True, text=True).stdout
    wide = []
    for path in files.splitlines():
        with open(path, encoding="utf-8") as file:
            # A word that is too long, such as an address, cannot be wrapped.
            lines = [(n, line) for n, line in prose(path, file.read()) if len(line) > WIDTH and len(line.split()) > 3]
        wide += [f"{path}:{n}: {len(line)} columns" for n, line in lines]
    for line in wide:
        print(line)
    if wide:
        sys.exit(f"{len(wide)} lines of prose are wider than {WIDTH} columns")


main()
