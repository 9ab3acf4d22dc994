"""Rust, JavaScript and CSS files: comments, messages and the names of tests."""

import re
from collections.abc import Iterable, Iterator
from dataclasses import dataclass

from . import markdown
from .passage import Kind, Passage, is_message

# Tolerant: what these patterns do not match is skipped, one character at a time.
TOKENS = {
    ".rs": re.compile(
        r"""
        (?P<comment>//[^\n]*)
        | (?P<block>/\*.*?\*/)
        | \b[bc]?r(?P<hashes>\#*)"(?P<raw>.*?)"(?P=hashes)
        | "(?P<string>(?:[^"\\]|\\.)*)"
        | '(?:[^'\\\n]|\\u\{\w+\}|\\x\w\w|\\.)'
        | (?P<test>\#!?\[cfg\(test\)\])
        | [{};]
        """,
        re.X | re.S,
    ),
    ".js": re.compile(
        r"""
        (?<![:\\/])(?P<comment>//[^\n]*)
        | (?P<block>/\*.*?\*/)
        | (?P<quote>["'])(?P<string>(?:(?!(?P=quote))[^\\\n]|\\.)*)(?P=quote)
        | `(?P<raw>(?:[^`\\]|\\.)*)`
        | (?P<test>(?!))
        """,
        re.X | re.S,
    ),
    ".css": re.compile(r"(?P<comment>(?!))|(?P<block>/\*.*?\*/)|(?P<test>(?!))", re.S),
}
TOKENS[".mjs"] = TOKENS[".js"]

TEST_NAME = re.compile(r"#\[test\]\s*(?:#\[[^\n]*\]\s*)*fn (\w+)")


@dataclass(frozen=True)
class Comment:
    """A line comment; `alone` means that no code precedes it on its line."""

    number: int
    mark: str
    text: str
    alone: bool

    def continues(self, other: "Comment") -> bool:
        """Whether this comment continues the one of the line before."""
        follows = self.number == other.number + 1 and self.mark == other.mark
        return follows and self.alone and other.alone


def file_passages(text: str, suffix: str, messages: bool) -> Iterator[Passage]:
    """The passages of a file; `messages` includes string literals outside test modules."""
    comments: list[Comment] = []
    for match, is_test in with_test_items(TOKENS[suffix].finditer(text)):
        if match["comment"]:
            comments.append(line_comment(text, match))
        elif match["block"]:
            yield from block_comment(text, match)
        elif messages and suffix != ".css" and not is_test:
            yield from string_passages(text, match)
    yield from comment_passages(comments)
    if suffix == ".rs":
        for name in TEST_NAME.finditer(text):
            words = name[1].replace("_", " ")
            yield Passage(Kind.NAME, ((line_of(text, name.start(1)), words),))


def with_test_items(tokens: Iterable[re.Match[str]]) -> Iterator[tuple[re.Match[str], bool]]:
    """Each token, and whether it belongs to an item under `#[cfg(test)]`."""
    depth, test_depth = 0, None
    for token in tokens:
        mark = token.group()
        if token["test"] and test_depth is None:
            test_depth = -1 if mark.startswith("#!") else depth
        elif mark == "{":
            depth += 1
        elif mark == "}":
            depth -= 1
        yield token, test_depth is not None
        if mark in (";", "}") and depth == test_depth:
            test_depth = None


def line_of(text: str, offset: int) -> int:
    """The number of the line that contains an offset."""
    return text.count("\n", 0, offset) + 1


def line_comment(text: str, match: re.Match[str]) -> Comment:
    """The line comment of a token."""
    mark = match["comment"][: 3 if match["comment"][2:3] in ("/", "!") else 2]
    before = text[text.rfind("\n", 0, match.start()) + 1 : match.start()]
    words = match["comment"][len(mark) :].removeprefix(" ")
    return Comment(line_of(text, match.start()), mark, words, not before.strip())


def comment_passages(comments: list[Comment]) -> Iterator[Passage]:
    """The passages of line comments; comments of consecutive lines belong together."""
    group: list[Comment] = []
    for comment in comments:
        if group and not comment.continues(group[-1]):
            yield from markdown.passages([(it.number, it.text) for it in group])
            group = []
        group.append(comment)
    yield from markdown.passages([(it.number, it.text) for it in group])


def block_comment(text: str, match: re.Match[str]) -> Iterator[Passage]:
    """The passages of a comment between `/*` and `*/`."""
    lines = match["block"].strip("/*!").splitlines()
    stripped = (re.sub(r"^\s*\* ?", "", line).strip() for line in lines)
    yield from markdown.passages(enumerate(stripped, line_of(text, match.start())))


def string_passages(text: str, match: re.Match[str]) -> Iterator[Passage]:
    """The passages of a string literal that is a message."""
    group = "raw" if match["raw"] is not None else "string"
    literal = match[group]
    if literal is None or not is_message(literal):
        return
    part: list[tuple[int, str]] = []
    for number, line in message_lines(literal, line_of(text, match.start(group))):
        if line:
            part.append((number, line))
        elif part:
            yield Passage(Kind.MESSAGE, tuple(part))
            part = []


def message_lines(literal: str, first: int) -> Iterator[tuple[int, str]]:
    """The lines of a string literal with their numbers; an empty line ends a passage."""
    for number, row in enumerate(literal.split("\n"), first):
        for index, part in enumerate(row.removesuffix("\\").split(r"\n")):
            if index > 0:
                yield number, ""
            yield number, re.sub(r"\\(?=[\"'\\])", "", part).strip()
        if not row.endswith("\\"):
            yield number, ""
