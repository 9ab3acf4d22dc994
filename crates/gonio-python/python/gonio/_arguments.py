"""What people give: the types of arguments."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping, Sequence
from typing import Any, Protocol, TypeAlias

from numpy.typing import ArrayLike


class HasArrayInterface(Protocol):
    """What a PIL image has."""

    @property
    def __array_interface__(self) -> dict[str, Any]: ...


class HasDLPack(Protocol):
    """What tensors of PyTorch, JAX and others have."""

    def __dlpack__(self) -> Any: ...


class Readable(Protocol):
    """A file that is open for reading bytes."""

    def read(self) -> bytes: ...


Path: TypeAlias = "str | os.PathLike[str]"
Array: TypeAlias = "ArrayLike | HasArrayInterface | HasDLPack"
"""NumPy arrays and what becomes one: lists, PIL images, xarray's DataArray, tensors."""
Picture: TypeAlias = "Path | Array"
"""A file, or an array of shape (height, width), (height, width, 3) or (height, width, 4)."""
Photograph: TypeAlias = "Picture | bytes | Readable | Sequence[Path]"
"""A picture, the bytes of a file, or the files of exposures of one scene."""
Shape: TypeAlias = "Path | Array | tuple[Array, Array]"
"""``"sphere"``, ``"ellipsoid"``, ``"blob"``, ``"bunny"``, ``"bowl"``, a file of a mesh, (vertices, faces), or an array of normals."""
Camera: TypeAlias = "Path | Mapping[str, Any]"
"""A file as docs/camera.md describes it, or the same as a dictionary."""
Progress: TypeAlias = "Callable[[str, float], object]"
"""Told the name of a stage and the fraction of it that is done."""


def is_path(value: object) -> bool:
    """Whether it names a file."""
    return isinstance(value, (str, os.PathLike))
