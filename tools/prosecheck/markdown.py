"""Markdown files, and comments, which are Markdown too: their passages, links and wide lines."""

import re
from collections.abc import Iterable, Iterator
from pathlib import Path

from .passage import Kind, Passage

Lines = Iterable[tuple[int, str]]

FENCE = re.compile(r"```+|~~~+")
LIST_ITEM = re.compile(r"(?:[*+-]|\d+[.)])\s+(?:\[[ x]\]\s+)?")
HEADING = re.compile(r"#+\s+")
# Rules, reference definitions, pictures, HTML and the prompts of Python examples.
SKIPPED = re.compile(r"[-=*_]{3,}$|\[[^\]]+\]:\s|!\[|<(?!https?:)|>>> |\.\.\. ")
CELL = re.compile(r"(?<!\\)\|")


class _Paragraph:
    """The lines of the passage being read."""

    def __init__(self) -> None:
        self.lines: list[tuple[int, str]] = []
        self.indent = 0
        self.is_item = False

    def start(self, indent: int, is_item: bool) -> None:
        self.lines, self.indent, self.is_item = [], indent, is_item

    def ends_before(self, indent: int) -> bool:
        """Whether a line of this indent starts a new passage: a definition below its term."""
        return not self.lines or (indent != self.indent and not self.is_item)

    def passages(self) -> Iterator[Passage]:
        if self.lines:
            yield Passage(Kind.PROSE, tuple(self.lines))
        self.lines = []


def passages(lines: Lines) -> Iterator[Passage]:
    """The paragraphs, headings, list items and table cells among numbered lines."""
    paragraph = _Paragraph()
    for number, line in without_code_blocks(lines):
        text = line.strip().removeprefix("> ")
        item, heading = LIST_ITEM.match(text), HEADING.match(text)
        indent = len(line) - len(line.lstrip())
        if not text or heading or text.startswith("|") or SKIPPED.match(text):
            yield from paragraph.passages()
            if heading:
                yield Passage(Kind.HEADING, ((number, text[heading.end() :]),))
            elif text.startswith("|"):
                yield from cells(number, text)
            continue
        if item or paragraph.ends_before(indent):
            yield from paragraph.passages()
            paragraph.start(indent, item is not None)
        paragraph.lines.append((number, text[item.end() :] if item else text))
    yield from paragraph.passages()


def without_code_blocks(lines: Lines) -> Iterator[tuple[int, str]]:
    """The lines outside fenced code; an empty line replaces each block."""
    fence = None
    for number, line in lines:
        mark = FENCE.match(line.strip())
        if fence is None and mark:
            fence = mark.group()
            yield number, ""
        elif fence is None:
            yield number, line
        elif line.strip() == fence:
            fence = None


def cells(number: int, row: str) -> Iterator[Passage]:
    """The cells of a row of a table that contain words."""
    for cell in CELL.split(row):
        if re.search(r"[A-Za-z]{2}", cell):
            yield Passage(Kind.PROSE, ((number, cell.strip()),))


def file_passages(text: str) -> Iterator[Passage]:
    """The passages of a Markdown file."""
    yield from passages(enumerate(text.splitlines(), 1))


def wrapped_lines(text: str) -> Iterator[tuple[int, str]]:
    """The lines of a Markdown file that can be wrapped: no code, tables, pictures and headings."""
    for number, line in without_code_blocks(enumerate(text.splitlines(), 1)):
        if not line.strip().startswith(("|", "![", "#", "<")):
            yield number, line


def anchors(text: str) -> set[str]:
    """The anchors of the headings of a Markdown file."""
    headings = re.findall(r"^#+ +(.*)$", without_code(text, spans=False), flags=re.M)
    return {re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-") for heading in headings}


def without_code(text: str, spans: bool = True) -> str:
    """A Markdown file without code blocks, and without code spans."""
    text = re.sub(r"^```.*?^```", "", text, flags=re.M | re.S)
    return re.sub(r"`[^`\n]*`", "", text) if spans else text


def broken_links(path: Path, text: str) -> Iterator[tuple[str, str]]:
    """The links of a Markdown file to missing files or headings, each with its reason."""
    for link in re.findall(r"\]\(([^)\s]+)\)", without_code(text)):
        file, _, anchor = link.partition("#")
        if re.match(r"[a-z]+:", link):
            continue
        target = path.parent / file
        if file and not target.exists():
            yield link, "link to a missing file"
        elif anchor and anchor not in anchors(target.read_text(encoding="utf-8") if file else text):
            yield link, "link to a missing heading"
