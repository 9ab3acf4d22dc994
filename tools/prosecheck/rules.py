"""The rules of prose, as data. tools/tests/test_prose.py has a fault and an innocent for each."""

import re
from collections.abc import Iterator
from dataclasses import dataclass

from .passage import Kind, Passage

MAX_WORDS = 30


@dataclass(frozen=True)
class Rule:
    """A pattern that prose must not match; `opening` means at the start of a sentence only."""

    name: str
    reason: str
    pattern: re.Pattern[str]
    opening: bool = False


def opening(word: str, pattern: str | None = None) -> Rule:
    """A rule on the first words of a sentence."""
    reason = f"the sentence opens with '{word}'; start with the subject"
    return Rule(f"opening {word}", reason, re.compile(pattern or rf"{word}\b"), opening=True)


def words(name: str, reason: str, pattern: str) -> Rule:
    """A rule on words anywhere in a passage."""
    return Rule(name, reason, re.compile(rf"\b(?:{pattern})\b"))


def not_after(*before: str) -> str:
    """The pattern of no such word before: people and cameras may do what programs cannot."""
    return "".join(rf"(?<!\b{word} )" for word in before)


PERSON = not_after("who", "user", "reader", "caller")
VIEWER = PERSON + not_after("camera", "camera that", "observer", "point", "pixel")
# After "of its own": the end of the phrase, not a noun ("none of their own code").
PHRASE_END = r"(?=\W*$|[.,;:)]|,? (?:and|as|at|by|for|from|in|is|of|on|or|so|that|to|which|with)\b)"

SPEECH = "programs and files do not speak; use 'print', 'report' or 'state'"
MIND = "programs and files have no mind; use 'store', 'estimate', 'detect' or 'require'"
PRONOUN = "a pronoun replaces the noun; repeat the noun"

RULES = (
    opening("Of", r"Of\b(?! course)"),
    opening("What", r"What\b(?![^?]*\?)"),
    opening("Whatever"),
    opening("As", r"As\b(?! (?:in|of)\b)"),
    opening("Being"),
    words("tell", SPEECH, r"[Tt]ells?|[Tt]elling|[Tt]old"),
    words("say", SPEECH, rf"{PERSON}says|[Ss]ay(?!,)|said|saying"),
    words("speak of", SPEECH, r"(?:speaks?|speaking|spoken) of"),
    words("ask for", SPEECH, rf"{PERSON}asks (?:for|of)|asked (?:for|of)"),
    words("know", MIND, rf"{PERSON}knows|knew"),
    words("want", MIND, rf"{PERSON}wants|wanted"),
    words("believe", MIND, rf"{PERSON}(?:believes|thinks)|believed"),
    words("see", MIND, rf"{VIEWER}sees"),
    words("look at", MIND, rf"{PERSON}looks at"),
    words(
        "none", PRONOUN, r"(?:am|is|are|was|were|be|been|being|has|have|had|there) none|none of it"
    ),
    words("ours", PRONOUN, r"ours"),
    words(
        "of its own",
        "use 'its own' before the noun",
        rf"of (?:its|our|their|his|her) own{PHRASE_END}",
    ),
    words("by heart", "a metaphor; use 'store' or 'cache'", r"by heart"),
    words("nobody", "the actor has no name", r"[Nn]obody"),
)


@dataclass(frozen=True)
class Finding:
    """A place in a file that breaks a rule."""

    line: int
    reason: str
    excerpt: str


def findings(passage: Passage) -> Iterator[Finding]:
    """The places of a passage that break a rule."""
    for rule in RULES:
        if not rule.opening:
            for match in rule.pattern.finditer(passage.text):
                yield finding(passage, rule.reason, match.start(), before=30)
    if passage.kind is not Kind.HEADING:
        yield from sentence_findings(passage)


def sentence_findings(passage: Passage) -> Iterator[Finding]:
    """The sentences of a passage that open wrongly or are too long."""
    capital = passage.kind is Kind.PROSE
    for sentence in passage.sentences():
        # Names and messages have no capital; in prose, a table cell or item may be no sentence.
        text = sentence.text if capital else sentence.text[:1].upper() + sentence.text[1:]
        for rule in RULES:
            if rule.opening and rule.pattern.match(text):
                yield finding(passage, rule.reason, sentence.start)
        count = sentence.words()
        if count > MAX_WORDS:
            yield finding(passage, f"a sentence of {count} words", sentence.start)


def finding(passage: Passage, reason: str, offset: int, before: int = 0) -> Finding:
    """A finding at an offset, with an excerpt of whole words around it."""
    text = passage.source
    start, end = max(0, offset - before), min(len(text), offset + 60)
    if start > 0 and start < offset:
        start = text.find(" ", start, offset) + 1 or offset
    if end < len(text):
        end = max(text.rfind(" ", offset, end), offset) if " " in text[offset:end] else end
    excerpt = f"{'... ' if start else ''}{text[start:end]}{' ...' if end < len(text) else ''}"
    return Finding(passage.line(offset), reason, excerpt)
