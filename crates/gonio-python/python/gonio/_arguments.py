"""Types of arguments."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping, Sequence
from typing import Any, Protocol, TypeAlias

from numpy.typing import ArrayLike


class HasArrayInterface(Protocol):
    """Interface of PIL images."""

    @property
    def __array_interface__(self) -> dict[str, Any]: ...


class HasDLPack(Protocol):
    """Interface of tensors of PyTorch, JAX and others."""

    def __dlpack__(self) -> Any: ...


class Readable(Protocol):
    """A file opened in binary mode."""

    def read(self) -> bytes: ...


Path: TypeAlias = "str | os.PathLike[str]"
Array: TypeAlias = "ArrayLike | HasArrayInterface | HasDLPack"
"""NumPy arrays and convertible types: lists, PIL images, xarray's DataArray, tensors."""
Picture: TypeAlias = "Path | Array"
"""A file, or an array of shape (height, width), (height, width, 3) or (height, width, 4)."""
Photograph: TypeAlias = "Picture | bytes | Readable | Sequence[Path]"
"""A picture, the bytes of a file, or the files of exposures of one scene."""
Shape: TypeAlias = "Path | Array | tuple[Array, Array]"
"""``"sphere"``, ``"ellipsoid"``, ``"outline"``, ``"blob"``, ``"bunny"``, ``"bowl"``, a file of a mesh, (vertices, faces), or an array of normals."""
Camera: TypeAlias = "Path | Mapping[str, Any]"
"""A file in the format of docs/camera.md, or its contents as a dictionary."""
Progress: TypeAlias = "Callable[[str, float], object]"
"""Receives the name of a stage and its completed fraction."""


def is_path(value: object) -> bool:
    """Returns whether a value is a path."""
    return isinstance(value, (str, os.PathLike))
