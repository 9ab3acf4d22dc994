"""Python and shell files, and others with comments after `#`: comments, docstrings, messages."""

import ast
import io
import re
import tokenize
from collections.abc import Iterator

from . import markdown
from .clike import Comment, comment_passages
from .passage import Kind, Passage, is_message

# A quote in the code before a `#` may contain it, unless the quote is closed.
HASH_COMMENT = re.compile(
    r"(?P<code>(?:[^#\"'\\]|\\.|\"[^\"]*\"|'[^']*'|(?<!\s)#)*?)(?<!\S)#(?P<text>.*)"
)


def hash_passages(text: str) -> Iterator[Passage]:
    """The passages of the comments of a shell, TOML or YAML file or a Containerfile."""
    comments = []
    for number, line in enumerate(text.splitlines(), 1):
        match = HASH_COMMENT.fullmatch(line)
        if match and not line.startswith("#!"):
            alone = not match["code"].strip()
            comments.append(Comment(number, "#", match["text"].removeprefix(" "), alone))
    yield from comment_passages(comments)


def python_passages(text: str, messages: bool) -> Iterator[Passage]:
    """The passages of a Python file; `messages` includes string literals."""
    yield from comment_passages(list(python_comments(text)))
    docstrings: set[ast.AST] = set()
    tree = ast.parse(text)
    for node in ast.walk(tree):
        if isinstance(node, ast.Expr) and (docstring := text_of(node.value)) is not None:
            docstrings.add(node.value)
            yield from markdown.passages(docstring_lines(docstring, node.lineno))
        elif isinstance(node, ast.FunctionDef) and node.name.startswith("test_"):
            words = node.name.removeprefix("test_").replace("_", " ")
            yield Passage(Kind.NAME, ((node.lineno, words),))
    if messages:
        yield from message_passages(tree, docstrings)


def python_comments(text: str) -> Iterator[Comment]:
    """The comments of a Python file."""
    for token in tokenize.generate_tokens(io.StringIO(text).readline):
        if token.type == tokenize.COMMENT and not token.string.startswith("#!"):
            alone = not token.line[: token.start[1]].strip()
            yield Comment(token.start[0], "#", token.string[1:].removeprefix(" "), alone)


def text_of(node: ast.AST) -> str | None:
    """The value of a string literal."""
    if isinstance(node, ast.Constant) and isinstance(node.value, str):
        return node.value
    return None


def docstring_lines(docstring: str, number: int) -> list[tuple[int, str]]:
    """The numbered lines of a docstring without its indent."""
    first, *rest = docstring.split("\n")
    indent = min((len(it) - len(it.lstrip()) for it in rest if it.strip()), default=0)
    return list(enumerate([first.lstrip(), *(it[indent:] for it in rest)], number))


def message_passages(tree: ast.AST, docstrings: set[ast.AST]) -> Iterator[Passage]:
    """The passages of the string literals that are messages."""
    parts = set(docstrings)
    for node in ast.walk(tree):
        if isinstance(node, ast.JoinedStr):
            parts.update(node.values)
            literals = (text_of(it) for it in node.values)
            yield from message(node.lineno, "".join("{}" if it is None else it for it in literals))
        elif isinstance(node, ast.Constant) and node not in parts:
            yield from message(node.lineno, text_of(node) or "")


def message(number: int, text: str) -> Iterator[Passage]:
    """The passages of a string, if it is a message; all of them at its first line."""
    if is_message(text):
        for line in filter(None, map(str.strip, text.split("\n"))):
            yield Passage(Kind.MESSAGE, ((number, line),))
