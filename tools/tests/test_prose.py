"""Tests of tools/prose.py: rules by example, the prose of each kind of file."""

import sys
import unittest
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1]))

import prose
from prosecheck import clike, markdown, scripts
from prosecheck.passage import Kind, Passage, is_message
from prosecheck.rules import MAX_WORDS, RULES, findings

# For each rule, a sentence that breaks it and an innocent one.
EXAMPLES = {
    "opening Of": (
        "Of the difference, grey is nothing.",
        "The mean of the difference. Of course not.",
    ),
    "opening What": ("It works. What is missing stays.", "What is missing? Read what follows."),
    "opening Whatever": ("Whatever the object hides.", "It ignores whatever the object hides."),
    "opening As": (
        "As the noise falls, it converges.",
        "As in the paper, noise is known. As of 2.0.",
    ),
    "opening Being": ("Being a sphere, it is round.", "A human being is no sphere."),
    "tell": ("The mask tells the pixels apart.", "The storyteller and the teller."),
    "say": ("The header says little.", "A user who says no."),
    "speak of": ("The paper speaks of lobes.", "The user speaks French."),
    "ask for": ("The error asks for a mask.", "The prompt asks whether to continue."),
    "know": ("The encoder knows only MERL.", "A reader who knows MERL; a known light."),
    "want": ("The solver wants a start.", "A user who wants a start."),
    "believe": ("The model believes the light.", "The reader believes the plot."),
    "see": ("The network sees a disk.", "The camera sees the disk."),
    "look at": ("The step looks at the result.", "Look at the result."),
    "none": ("A cone is none.", "None of the cones is valid; the value `None` is of no use."),
    "ours": ("The folder is ours.", "Two hours and four colours."),
    "of its own": (
        "It has a scale of its own, and more.",
        "It has its own scale, none of its own files.",
    ),
    "by heart": ("It learns the seeds by heart.", "The heart of the solver."),
    "nobody": ("There is nobody to warn.", "There is no user to warn."),
}


def prose_of(*lines: str) -> list[Passage]:
    """The passages of lines of Markdown."""
    return list(markdown.passages(enumerate(lines, 1)))


def reasons(*lines: str) -> list[str]:
    """The reasons of the findings in lines of Markdown."""
    return [it.reason for passage in prose_of(*lines) for it in findings(passage)]


class Rules(unittest.TestCase):
    def test_every_rule_finds_its_fault_only(self) -> None:
        self.assertEqual(set(EXAMPLES), {rule.name for rule in RULES})
        for rule in RULES:
            fault, innocent = EXAMPLES[rule.name]
            with self.subTest(rule.name):
                self.assertEqual(reasons(fault), [rule.reason])
                self.assertEqual(reasons(innocent), [])

    def test_long_sentences_are_found(self) -> None:
        words = ["word"] * MAX_WORDS
        self.assertEqual(reasons(" ".join(words) + "."), [])
        self.assertEqual(
            reasons(" ".join(words), "more."), [f"a sentence of {MAX_WORDS + 1} words"]
        )
        code = "`three code words` 3.5 [text](https://example.org/a-b) e.g. 12 %"
        self.assertEqual(reasons(" ".join(words[2:]), code), [])
        self.assertEqual(reasons(" ".join(words) + ". The " + " ".join(words[1:])), [])

    def test_findings_have_the_line_of_the_fault(self) -> None:
        (found,) = (
            it
            for passage in prose_of("", "One line, ends.", "It tells.")
            for it in findings(passage)
        )
        self.assertEqual((found.line, found.excerpt), (3, "One line, ends. It tells."))


class Markdown(unittest.TestCase):
    def test_paragraphs_items_headings_and_cells_are_apart(self) -> None:
        text = [
            "# What",
            "one",
            "two",
            "* three",
            "  four",
            "* five",
            "",
            "| a six | `b` seven |",
            "|---|",
        ]
        found = [(it.kind, it.source) for it in prose_of(*text)]
        expected = ["one two", "three four", "five", "a six", "`b` seven"]
        self.assertEqual(found, [(Kind.HEADING, "What")] + [(Kind.PROSE, it) for it in expected])

    def test_code_quotes_and_addresses_are_no_prose(self) -> None:
        self.assertEqual(
            reasons("```sh", "gonio tells", "```", '`it tells`, "tells" <https://tells.org>'), []
        )

    def test_broken_links_and_wide_lines_are_found(self) -> None:
        path = Path("README.md")
        text = "[a](nowhere.md) [b](#no-heading) [c](#heading)\n\n# Heading\n" + "wide " * 21
        self.assertEqual(
            [link for link, _ in markdown.broken_links(path, text)], ["nowhere.md", "#no-heading"]
        )
        self.assertEqual([it.line for it in prose.wide_lines(path, text)], [4])


RUST = r"""
//! The first line
//! goes on.

/// A doc comment.
fn documented<'a>(x: &'a str) -> char { // trailing
    let quote = '"';
    bail!("the {first} message of {} is \
           continued // here\nand ends");
    let raw = r#"a raw "string" of five words"#;
    /* a block */
    let json = "{\"key\": \"a value of some words\"}";
    let html = "<p>one two three four five</p>";
    "three words only"
}

#[cfg(test)]
mod tests {
    #[test]
    fn what_is_tested() { assert!(true, "a message of a test module"); }
}

const AFTER: &str = "a message after the tests";
"""


class Sources(unittest.TestCase):
    def test_rust_has_comments_messages_and_names_of_tests(self) -> None:
        found = {it.source: it.lines[0][0] for it in clike.file_passages(RUST, ".rs", True)}
        expected = {
            "The first line goes on.": 2,
            "A doc comment.": 5,
            "trailing": 6,
            "the {first} message of {} is continued // here": 8,
            "and ends": 9,
            'a raw "string" of five words': 10,
            "a block": 11,
            "what is tested": 20,
            "a message after the tests": 23,
        }
        self.assertEqual(found, expected)
        names = [it for it in clike.file_passages(RUST, ".rs", False) if it.kind is Kind.NAME]
        self.assertEqual([it.reason for it in findings(names[0])], [RULES[1].reason])

    def test_javascript_has_comments_and_messages(self) -> None:
        text = "// one\n// two\nfetch('https://a.b'); /* three */\nfail(`a message of ${n} words`);"
        found = {it.source for it in clike.file_passages(text, ".js", True)}
        self.assertEqual(found, {"one two", "three", "a message of ${n} words"})

    def test_python_has_comments_docstrings_and_messages(self) -> None:
        text = '"""Doc."""\n# one\n# two\ndef f():\n    """Line.\n\n    End."""\n'
        text += '    fail(f"a message of {n} words")\n'
        found = {it.source: it.lines[0][0] for it in scripts.python_passages(text, True)}
        self.assertEqual(
            found, {"one two": 2, "Doc.": 1, "Line.": 5, "End.": 7, "a message of {} words": 8}
        )

    def test_shell_has_comments(self) -> None:
        text = "#!/bin/sh\n# one\n# two\necho '# no' \"$#\" ${a#b} # three\n"
        self.assertEqual([it.source for it in scripts.hash_passages(text)], ["one two", "three"])

    def test_messages_are_prose(self) -> None:
        for text in (
            "the file has no pixels",
            "{path}: expected {n} numbers per line",
            "see `gonio check`, to find out",
        ):
            self.assertTrue(is_message(text), text)
        for text in (
            "M 0 0 L 1 1 Z",
            "<div class='a b'>",
            "var a = f(b); return c",
            "three words only",
        ):
            self.assertFalse(is_message(text), text)


if __name__ == "__main__":
    unittest.main()
