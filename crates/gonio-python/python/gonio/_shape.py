"""Converts arguments for the shape of an object."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping
from itertools import permutations
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from ._arguments import Array, Camera, Path, is_path
from ._arrays import array_of, doubles, floats
from ._validation import choice, circle, flag, number, numbers, positive, shown
from ._errors import GonioError
from ._types import Doubles, Floats, GivenNormals, GivenShape

ORDERS = tuple("".join(order) for order in permutations("xyz"))
"""Possible orders of the axes in the channels of a normal map."""

FORM: dict[str, Any] = {
    "shape": "sphere",
    "normals": None,
    "normals_order": "xyz",
    "normals_flip_x": False,
    "normals_flip_y": False,
    "normals_flip_z": False,
    "trust_normals": False,
    "normals_error": 0.0,
    "depth": None,
    "depth_range": None,
    "depth_along_rays": False,
    "positions": None,
    "circle": None,
    "depth_axis": None,
    "camera": None,
    "pose": None,
}
"""Arguments for the shape, with their defaults."""

OF_NORMALS = (
    "normals_order", "normals_flip_x", "normals_flip_y", "normals_flip_z", "trust_normals", "normals_error", "depth", "depth_range", "depth_along_rays",
    "positions",
)
"""Arguments that require normals."""


def json_or_file(given: Camera | None, name: str) -> str | bytes | None:
    """Converts a camera or a pose."""
    if given is None:
        return None
    if is_path(given):
        return os.fspath(cast(Path, given))
    if not isinstance(given, Mapping):
        raise TypeError(f"{name}: must be a file or a dictionary, not {shown(given)}")
    try:
        return json.dumps(given, default=plain).encode()
    except (TypeError, ValueError) as error:
        raise GonioError(f"{name}: cannot be encoded as JSON: {error}") from None


def plain(value: object) -> object:
    """Converts arrays and numbers of NumPy for JSON."""
    if isinstance(value, (np.ndarray, np.generic)):
        return value.tolist()
    raise TypeError(f"{shown(value)} is not a number, list or string")


def given_shape(options: Mapping[str, Any]) -> GivenShape:
    """Returns the shape described by the arguments in :data:`FORM`; missing ones have their defaults."""
    chosen = {**FORM, **{key: value for key, value in options.items() if key in FORM}}
    name, mesh, normals = split_shape(chosen)
    outline = None if chosen["circle"] is None else circle(chosen["circle"])
    if outline is not None and (mesh is not None or normals is not None or name != "sphere"):
        raise GonioError("circle is the outline of a sphere; it cannot be combined with other shapes")
    if chosen["depth_axis"] is not None:
        if not (isinstance(chosen["depth_axis"], (int, float, np.number)) and chosen["depth_axis"] > 0):
            raise GonioError("depth_axis: must be a positive number")
        if name != "ellipsoid":
            raise GonioError('depth_axis requires shape="ellipsoid"')
    if chosen["pose"] is not None and mesh is None:
        raise GonioError("pose requires a mesh; specify it with shape=")
    return {
        "shape": name,
        "mesh": mesh,
        "normals": given_normals(normals, chosen),
        "camera": json_or_file(chosen["camera"], "camera"),
        "pose": json_or_file(chosen["pose"], "pose"),
        "circle": outline,
        "depth_axis": None if chosen["depth_axis"] is None else float(chosen["depth_axis"]),
    }


def split_shape(chosen: Mapping[str, Any]) -> tuple[str, str | tuple[Doubles, NDArray[np.uint32]] | None, Any]:
    """Returns the name of the form, the mesh, and the normals."""
    given, normals = chosen["shape"], chosen["normals"]
    if is_path(given):
        text = os.fspath(given)
        if text in ("sphere", "ellipsoid", "outline"):
            if normals is not None and text != "sphere":
                raise GonioError(f'shape="{text}" and normals both define the shape; use only one of them')
            return text, None, normals
        if normals is not None:
            raise GonioError("a mesh and normals both define the shape; use only one of them")
        return "mesh", text, None
    if isinstance(given, tuple) and len(given) == 2:
        if normals is not None:
            raise GonioError("a mesh and normals both define the shape; use only one of them")
        return "mesh", triangles(given[0], given[1]), None
    if given is None:
        raise TypeError('shape: must be "sphere", "ellipsoid", "outline", a mesh file, (vertices, faces) or normals, not None')
    if normals is not None:
        raise GonioError("shape and normals are both normal maps; use only one of them")
    return "sphere", None, given


def degrees(error: object) -> float:
    """Checks the expected error of normals."""
    angle = number(error, "normals_error")
    if not 0 <= angle <= 45:
        raise GonioError(f"normals_error: must be an angle from 0 to 45 degrees, not {angle}")
    return angle


def given_normals(normals: Any, chosen: Mapping[str, Any]) -> GivenNormals | None:
    """Converts a normal map and its conventions."""
    if normals is None:
        # Arrays are never the default; scalars are compared by value.
        given = [key for key in OF_NORMALS if chosen[key] is not FORM[key] and (not np.isscalar(chosen[key]) or chosen[key] != FORM[key])]
        if given:
            raise GonioError(f"{given[0]} requires normals; specify them with normals=")
        return None
    if chosen["depth"] is None and (chosen["depth_range"] is not None or chosen["depth_along_rays"]):
        raise GonioError("depth_range and depth_along_rays require depth=")
    if chosen["normals_error"] and (chosen["depth"] is not None or chosen["positions"] is not None):
        raise GonioError("normals_error and a depth or position map cannot be combined: the shadows would not match the refined normals")
    if chosen["depth"] is not None and chosen["positions"] is not None:
        raise GonioError("depth and positions both define the surface; use only one of them")
    ends = None
    if chosen["depth_range"] is not None:
        near, far = numbers(chosen["depth_range"], "depth_range", "two numbers, near and far", 2)
        if near == far:
            raise GonioError("depth_range: must be two different numbers, near and far")
        ends = (near, far)
    return {
        "picture": file_or(normals, "the normals", 3),
        "order": choice(chosen["normals_order"], "normals_order", ORDERS),
        "flip_x": flag(chosen["normals_flip_x"], "normals_flip_x"),
        "flip_y": flag(chosen["normals_flip_y"], "normals_flip_y"),
        "flip_z": flag(chosen["normals_flip_z"], "normals_flip_z"),
        "trusted": flag(chosen["trust_normals"], "trust_normals"),
        "error": float(np.radians(degrees(chosen["normals_error"]))),
        "depth": depths(chosen["depth"], ends),
        "depth_range": ends,
        "depth_along_rays": flag(chosen["depth_along_rays"], "depth_along_rays"),
        "positions": places(chosen["positions"]),
    }


def file_or(given: Any, name: str, channels: int) -> str | Floats:
    """Converts a file, or an array with a number of channels."""
    if is_path(given):
        return os.fspath(cast(Path, given))
    array = array_of(given, name)
    if array.ndim != 3 or array.shape[2] != channels:
        raise GonioError(f"{name}: have the shape {array.shape}; use (height, width, {channels})")
    if array.dtype.kind != "f":
        raise GonioError(f"{name}: have values of type {array.dtype}; use floating-point numbers")
    return floats(array)


def depths(given: Any, ends: tuple[float, float] | None) -> str | Doubles | None:
    """Converts depths; integers are codes within a range."""
    if given is None or is_path(given):
        return None if given is None else os.fspath(given)
    array = array_of(given, "the depths")
    if array.ndim != 2:
        raise GonioError(f"the depths: have the shape {array.shape}; use (height, width)")
    if array.dtype.kind == "f":
        return doubles(array)
    if array.dtype != np.uint16:
        raise GonioError(f"the depths: have values of type {array.dtype}; use floating-point numbers, or uint16 with depth_range")
    if ends is None:
        raise GonioError("the depths: are integer codes; specify their range with depth_range=(near, far)")
    surface = (array > 0) & (array < 65535)
    near, far = ends
    return doubles(np.where(surface, near + (far - near) * (array / 65535), np.nan))


def places(given: Any) -> str | Doubles | None:
    """Converts positions in camera coordinates."""
    if given is None or is_path(given):
        return None if given is None else os.fspath(given)
    array = array_of(given, "the positions")
    if array.ndim != 3 or array.shape[2] != 3 or array.dtype.kind != "f":
        has = f"the shape {array.shape} and type {array.dtype}"
        raise GonioError(f"the positions: have {has}; use floating-point numbers of shape (height, width, 3)")
    return doubles(array)


def triangles(vertices: Array, faces: Array) -> tuple[Doubles, NDArray[np.uint32]]:
    """Converts a mesh in memory, with a copy."""
    places, corners = array_of(vertices, "the mesh"), array_of(faces, "the mesh")
    if places.ndim != 2 or places.shape[1] != 3:
        raise GonioError(f"the mesh: has vertices of shape {places.shape}; use (count, 3)")
    if corners.ndim != 2 or corners.shape[1] != 3 or corners.dtype.kind not in "iu":
        raise GonioError(f"the mesh: has faces of shape {corners.shape} and type {corners.dtype}; use integers of shape (count, 3)")
    if corners.size and corners.min() < 0:
        raise GonioError("the mesh: has faces with negative indices; export the mesh again")
    return doubles(places), corners.astype(np.uint32)
