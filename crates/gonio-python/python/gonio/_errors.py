"""Exceptions and warnings."""

from __future__ import annotations


class GonioError(ValueError):
    """Invalid input. The message states the input, the problem, and what to do."""


# OSError is the first base, because its memory layout is used to create and unpickle exceptions.
class FileError(OSError, GonioError):
    """The operating system refused to open, read or write a file."""


class MissingFileError(FileError, FileNotFoundError):
    """A file or folder does not exist."""


class GonioWarning(UserWarning):
    """The result may be unreliable; the message states the reason."""
