"""Pictures from and to files."""

from __future__ import annotations

import os
import warnings
from typing import cast

import numpy as np
from numpy.typing import ArrayLike

from . import _gonio
from ._arguments import Path, Picture, floats, is_path
from ._errors import GonioError, GonioWarning
from ._types import Floats


def read_image(path: Path, *, linear: bool = False, layer: str | None = None) -> Floats:
    """Reads a picture in any format that gonio knows (OpenEXR, Radiance, PFM, PNG, JPEG, TIFF).

    Returns linear radiance of shape (height, width, 3), or (height, width, 4) where the file has an alpha channel. Integer files are
    taken as sRGB-coded, with a warning, unless ``linear``. ``layer`` names one of several in an OpenEXR file.
    """
    rgb, alpha, _, said = _gonio.read_image(os.fspath(path), linear, layer)
    for message in said:
        warnings.warn(message, GonioWarning, stacklevel=2)
    return rgb if alpha is None else np.dstack([rgb, alpha])


def light_map(given: Picture, name: str = "the light") -> Floats:
    """A lat-long map: row 0 is up, the centre looks along -z, the right half is +x."""
    array = read_image(cast(Path, given)) if is_path(given) else np.asarray(given)
    if array.ndim == 2:
        array = np.repeat(array[:, :, np.newaxis], 3, axis=2)
    if array.ndim != 3 or array.shape[2] not in (3, 4):
        raise GonioError(f"{name}: has the shape {array.shape}; give (height, 2 height, 3)")
    return floats(array[:, :, :3])


def read_normals(path: Path) -> Floats:
    """Reads a picture of normals (OpenEXR, NPY, PFM, PNG): shape (height, width, 3), in camera space with x right, y up and z towards the
    camera; zero where there is no surface."""
    return _gonio.read_normals(os.fspath(path))


def write_image(path: Path, image: ArrayLike) -> None:
    """Writes linear radiance to a file, whole or not at all: ``.exr``, with alpha if there are four channels, ``.hdr`` or ``.pfm``."""
    array = np.asarray(image)
    if array.ndim == 2:
        array = np.repeat(array[:, :, np.newaxis], 3, axis=2)
    if array.ndim != 3 or array.shape[2] not in (3, 4):
        raise GonioError(f"the picture: has the shape {array.shape}; give (height, width), (height, width, 3) or (height, width, 4)")
    alpha = floats(array[:, :, 3]) if array.shape[2] == 4 else None
    _gonio.write_image(os.fspath(path), floats(array[:, :, :3]), alpha)

