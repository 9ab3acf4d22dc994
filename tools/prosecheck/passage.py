"""Passages: the unit in which prose is checked."""

import re
from collections.abc import Iterator
from dataclasses import dataclass
from enum import Enum, auto
from functools import cached_property

# Stands for text that is not prose: code, placeholders, quoted words, targets of links.
FILLER = "\ufffc"

NOT_PROSE = re.compile(
    r"``.+?``|`[^`]*`"  # code
    r"|(?<=\])\([^)\s]*\)"  # the target of a link
    r"|<?\bhttps?://\S+"
    r"|\"[^\"]{1,40}\"|“[^”]{1,40}”"  # a mention of a word, or a value
)
PLACEHOLDER = re.compile(r"\{[^{}]*\}")

# HTML, JSON, CSS and JavaScript.
NOT_MESSAGE = re.compile(
    r"</|<\w+[ >]|[\[{,]\s*\\?\"[\w ]+\\?\":|=>|;\s*\}|\w\(\);|\w;\s*\w+ ?[:=]"
    r"|;\s*(?:const|let|return|var)\b"
)

# A sentence may begin with a lower-case name ("gonio").
SENTENCE_END = re.compile(r"[.!?][)\]\"'*_”]*\s+")
ABBREVIATION = re.compile(
    r"(?:\b(?:e\.g|i\.e|cf|vs|al|approx|etc|[Ff]ig|[Ee]q|[Ss]ec|No|pp|p)|\b[A-Z])\.$"
)
FIRST_WORD = re.compile(r"[^\w" + FILLER + r"]*")
WORD = re.compile(r"[\w'’/.-]*[^\W\d_][\w'’/.-]*")


class Kind(Enum):
    """The role of a passage decides which rules apply to it."""

    PROSE = auto()
    HEADING = auto()
    MESSAGE = auto()
    NAME = auto()


@dataclass(frozen=True)
class Sentence:
    """A sentence of a passage, without code, and its offset there."""

    start: int
    text: str

    def words(self) -> int:
        """The number of words; code, links and numbers do not count."""
        return len(WORD.findall(self.text))


@dataclass(frozen=True)
class Passage:
    """A paragraph, a list item, a table cell, a message or a name, by numbered lines."""

    kind: Kind
    lines: tuple[tuple[int, str], ...]

    @cached_property
    def source(self) -> str:
        """The text as written, in one line."""
        return " ".join(text for _, text in self.lines)

    @cached_property
    def text(self) -> str:
        """The text with fillers of equal length for everything that is not prose."""
        text = NOT_PROSE.sub(fill, self.source)
        return PLACEHOLDER.sub(fill, text) if self.kind is Kind.MESSAGE else text

    def line(self, offset: int) -> int:
        """The line number of an offset of the text."""
        for number, text in self.lines:
            if offset <= len(text):
                return number
            offset -= len(text) + 1
        return self.lines[-1][0]

    def sentences(self) -> Iterator[Sentence]:
        """The sentences of the passage, each from its first word or code."""
        start = 0
        for end in SENTENCE_END.finditer(self.text):
            if not ABBREVIATION.search(self.text, start, end.start() + 1):
                yield self._sentence(start, end.end())
                start = end.end()
        yield self._sentence(start, len(self.text))

    def _sentence(self, start: int, end: int) -> Sentence:
        if first := FIRST_WORD.match(self.text, start, end):
            start = first.end()
        return Sentence(start, self.text[start:end].rstrip())


def fill(match: re.Match[str]) -> str:
    """A filler as long as the match."""
    return FILLER * len(match.group())


def is_message(text: str) -> bool:
    """Whether a string literal is prose: at least four words, and no HTML, JSON, CSS or code."""
    if NOT_MESSAGE.search(text):
        return False
    prose = NOT_PROSE.sub("", PLACEHOLDER.sub("", text)).strip()
    words = re.findall(r"(?<![\w#.$-])[A-Za-z][a-z'’-]*(?![\w(=])", prose)
    letters = len(re.findall(r"[A-Za-z\s,.'’()-]", prose))
    return len(words) >= 4 and letters >= 0.85 * len(prose)
