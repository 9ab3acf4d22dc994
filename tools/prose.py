#!/usr/bin/env python3
"""Checks prose: at most 100 columns wide (comments of Rust files, paragraphs of Markdown files), and no
link in Markdown files to a file or heading of the repository that is not there."""

import re
import subprocess
import sys
from pathlib import Path

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


def without_code(text):
    """Text of a Markdown file without its blocks of code and its code in lines."""
    return re.sub(r"`[^`\n]*`", "", re.sub(r"^```.*?^```", "", text, flags=re.M | re.S))


def anchors(text):
    """What links to the headings of a Markdown file are called."""
    headings = re.findall(r"^#+ +(.*)$", re.sub(r"^```.*?^```", "", text, flags=re.M | re.S), flags=re.M)
    return {re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-") for heading in headings}


def broken(path):
    """Links of a Markdown file that lead nowhere."""
    for link in re.findall(r"\]\(([^)\s]+)\)", without_code(Path(path).read_text(encoding="utf-8"))):
        file, _, anchor = link.partition("#")
        if re.match(r"[a-z]+:", link):
            continue
        target = Path(path).parent / file if file else Path(path)
        if not target.exists():
            yield f"{path}: {link}: there is no such file"
        elif anchor and anchor not in anchors(target.read_text(encoding="utf-8")):
            yield f"{path}: {link}: there is no such heading"


def main():
    files = subprocess.run(["git", "ls-files", "*.rs", "*.md"], check=True, capture_output=True, text=True).stdout
    wide = []
    for path in files.splitlines():
        with open(path, encoding="utf-8") as file:
            # A word that is too long, such as an address, cannot be wrapped.
            lines = [(n, line) for n, line in prose(path, file.read()) if len(line) > WIDTH and len(line.split()) > 3]
        wide += [f"{path}:{n}: {len(line)} columns" for n, line in lines]
    links = [it for path in files.splitlines() if path.endswith(".md") for it in broken(path)]
    for line in wide + links:
        print(line)
    if wide or links:
        sys.exit(f"{len(wide)} lines of prose are wider than {WIDTH} columns, {len(links)} links are broken")


main()
