"""Exceptions and warnings. The messages are those of the library and of the program ``gonio``."""

from __future__ import annotations


class GonioError(ValueError):
    """Something given is not what it should be; the message says what, and what to do about it."""


# OSError goes first: what makes and unpickles exceptions asks the first base for its memory.
class FileError(OSError, GonioError):
    """The operating system refused to open, read or write a file."""


class MissingFileError(FileError, FileNotFoundError):
    """A file or a folder is not there."""


class GonioWarning(UserWarning):
    """There is an answer, but something speaks against it."""
