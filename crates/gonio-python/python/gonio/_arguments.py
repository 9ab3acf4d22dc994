"""From what people give to the arrays that the extension takes. What fits already is not copied."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping
from typing import Any, TypeAlias, cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ._errors import GonioError
from ._types import Floats, GivenPicture, GivenShape

Path: TypeAlias = "str | os.PathLike[str]"
Picture: TypeAlias = "Path | ArrayLike"
"""A file, or an array of shape (height, width), (height, width, 3) or (height, width, 4)."""
Shape: TypeAlias = "Path | ArrayLike | tuple[ArrayLike, ArrayLike]"
"""``"sphere"``, ``"ellipsoid"``, ``"blob"``, ``"bunny"``, ``"bowl"``, a file of a mesh, (vertices, faces), or an array of normals."""
Camera: TypeAlias = "Path | Mapping[str, Any]"
"""A file as docs/camera.md describes it, or the same as a dictionary."""


def is_path(value: object) -> bool:
    """Whether it names a file."""
    return isinstance(value, (str, os.PathLike))


def floats(array: NDArray[Any]) -> Floats:
    """The values as native float32 in C order: the array itself if it has them so, else a copy."""
    return np.require(array, np.float32, ["C_CONTIGUOUS", "ALIGNED"])


def decoded(array: NDArray[Any], name: str, linear: bool, warnings: list[str]) -> Floats:
    """Radiance of an array of any type; integers are sRGB-coded unless they are said to be linear."""
    if array.dtype == np.bool_ or array.dtype.kind not in "fiu":
        raise GonioError(f"{name}: has values of type {array.dtype}; give radiance as floating-point numbers")
    if array.dtype.kind == "f":
        return floats(array)
    if array.dtype not in (np.uint8, np.uint16):
        raise GonioError(f"{name}: has values of type {array.dtype}; give float32, or uint8 or uint16 as in picture files")
    values = array.astype(np.float32) / np.float32(np.iinfo(array.dtype).max)
    if linear:
        return values
    warnings.append(
        f"{name}: {8 * array.dtype.itemsize}-bit sRGB-coded picture, decoded as such; its highlights are probably clipped and its tone "
        "curve unknown: prefer an HDR picture, or give linear=True if its values are linear radiance"
    )
    curve = np.where(values <= 0.04045, values / 12.92, ((values + 0.055) / 1.055) ** 2.4)
    return floats(curve)


def picture(given: Picture, name: str, linear: bool, warnings: list[str]) -> GivenPicture:
    """A photograph. Float32 of shape (height, width, 3) in C order is read where it is; grey pictures and alpha channels are taken
    apart into new arrays."""
    if is_path(given):
        return os.fspath(cast(Path, given))
    array = np.asarray(given)
    if array.ndim == 2:
        grey = decoded(array, name, linear, warnings)
        return np.repeat(grey[:, :, np.newaxis], 3, axis=2)
    if array.ndim == 3 and array.shape[2] == 3:
        return decoded(array, name, linear, warnings)
    if array.ndim == 3 and array.shape[2] == 4:
        colours = decoded(array[:, :, :3], name, linear, warnings)
        alpha = array[:, :, 3]
        scale = 1.0 if alpha.dtype.kind == "f" else float(np.iinfo(alpha.dtype).max)
        return colours, floats(alpha / scale)
    raise GonioError(f"{name}: has the shape {array.shape}; give (height, width), (height, width, 3) or (height, width, 4)")


def light_map(given: Picture, warnings: list[str]) -> str | Floats:
    """A light map: a file, or an array of shape (height, 2 height, 3)."""
    light = picture(given, "light", False, warnings)
    return light[0] if isinstance(light, tuple) else light


def mask(given: Picture | None) -> str | Floats | None:
    """Where the object is: float32 of shape (height, width) is read where it is."""
    if given is None:
        return None
    if is_path(given):
        return os.fspath(cast(Path, given))
    array = np.asarray(given)
    if array.ndim != 2:
        raise GonioError(f"the mask: has the shape {array.shape}; give (height, width)")
    if array.dtype.kind in "iu" and array.size and array.max() > 1:
        array = array / np.iinfo(array.dtype).max
    values = floats(array)
    if not (np.isfinite(values).all() and values.min(initial=0) >= 0 and values.max(initial=0) <= 1):
        raise GonioError("the mask: has values outside of 0 to 1")
    return values


def json_or_file(given: Camera | None) -> str | bytes | None:
    """A camera or a pose."""
    if given is None:
        return None
    if isinstance(given, Mapping):
        return json.dumps(given).encode()
    return os.fspath(given)


def shape(
    given: Shape,
    *,
    normals: Picture | None = None,
    camera: Camera | None = None,
    pose: Camera | None = None,
    circle: tuple[float, float, float] | None = None,
    depth_axis: float | None = None,
    trust_normals: bool = False,
) -> GivenShape:
    """What is known of an object's shape."""
    name = "mesh"
    mesh: str | tuple[NDArray[np.float64], NDArray[np.uint32]] | None = None
    if is_path(given):
        text = os.fspath(cast(Path, given))
        name = text if text in ("sphere", "ellipsoid") else "mesh"
        mesh = text if name == "mesh" else None
    elif isinstance(given, tuple) and len(given) == 2:
        mesh = triangles(given[0], given[1])
    elif normals is None:
        normals = cast(ArrayLike, given)
    if mesh is not None and normals is not None:
        raise GonioError("give a mesh or normals, not both")
    if circle is not None and (len(circle) != 3 or not circle[2] > 0):
        raise GonioError("circle: give three numbers, x, y and radius, in pixels")
    if depth_axis is not None and not depth_axis > 0:
        raise GonioError("depth_axis: give a positive number")
    if circle is not None and (mesh is not None or normals is not None or name != "sphere"):
        raise GonioError("circle is the outline of a sphere; it does not go with other shapes")
    directions: str | Floats | None = None
    if normals is not None and is_path(normals):
        directions = os.fspath(cast(Path, normals))
    elif normals is not None:
        array = np.asarray(normals)
        if array.ndim != 3 or array.shape[2] != 3:
            raise GonioError(f"the normals: have the shape {array.shape}; give (height, width, 3)")
        directions = floats(array)
    return {
        "shape": name,
        "mesh": mesh,
        "normals": directions,
        "camera": json_or_file(camera),
        "pose": json_or_file(pose),
        "circle": circle,
        "depth_axis": depth_axis,
        "trust_normals": trust_normals,
    }


def triangles(vertices: ArrayLike, faces: ArrayLike) -> tuple[NDArray[np.float64], NDArray[np.uint32]]:
    """A mesh in memory, which is copied."""
    places, corners = np.asarray(vertices, np.float64), np.asarray(faces)
    if places.ndim != 2 or places.shape[1] != 3:
        raise GonioError(f"the mesh: has vertices of shape {places.shape}; give (count, 3)")
    if corners.ndim != 2 or corners.shape[1] != 3 or corners.dtype.kind not in "iu":
        raise GonioError(f"the mesh: has faces of shape {corners.shape} and type {corners.dtype}; give integers of shape (count, 3)")
    if corners.size and corners.min() < 0:
        raise GonioError("the mesh: has faces with negative indices")
    return places, corners.astype(np.uint32)
