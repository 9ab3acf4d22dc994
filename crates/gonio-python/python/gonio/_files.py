"""Reads and writes image files."""

from __future__ import annotations

import os
import warnings
from typing import cast

import numpy as np

from . import _gonio
from ._arguments import Array, Path, Picture, is_path
from ._arrays import array_of, floats
from ._validation import flag, positive, space_if_given, text
from ._errors import GonioError, GonioWarning
from ._types import Floats


def read_image(path: Path, *, linear: bool = False, layer: str | None = None, colorspace: str | None = None) -> Floats:
    """Read an image file (OpenEXR, Radiance HDR, PFM, PNG, JPEG, TIFF).

    Parameters
    ----------
    path : str or os.PathLike
        The file.
    linear : bool, default False
        Interpret integer values as linear radiance, not as sRGB (with a warning).
    layer : str, optional
        Layer of a multi-layer OpenEXR file.
    colorspace : str, optional
        Colour space of files that state none, as for :func:`infer`.

    Returns
    -------
    ndarray of float32
        Linear Rec. 709 radiance of shape (height, width, 3), or (height, width, 4) if the file has an
        alpha channel; row 0 is at the top.

    Examples
    --------
    >>> gonio.read_image("samples/ball.exr").shape
    (256, 256, 4)
    """
    name = None if layer is None else text(layer, "layer")
    rgb, alpha, _, messages = _gonio.read_image(os.fspath(path), flag(linear, "linear"), name, space_if_given(colorspace, "colorspace"))
    for message in messages:
        warnings.warn(message, GonioWarning, stacklevel=2)
    return rgb if alpha is None else np.dstack([rgb, alpha])


def environment_map(given: Picture, name: str = "the light", colorspace: str | None = None) -> Floats:
    """Reads or converts a lat-long map: row 0 is up, the centre is -z, the right half is +x."""
    if is_path(given):
        return _gonio.read_light(os.fspath(cast(Path, given)), colorspace)
    array = array_of(cast(Array, given), name)
    if array.ndim == 2:
        array = np.repeat(array[:, :, np.newaxis], 3, axis=2)
    if array.ndim != 3 or array.shape[2] not in (3, 4):
        raise GonioError(f"{name}: has the shape {array.shape}; use (height, 2 height, 3)")
    light = floats(array[:, :, :3])
    return light if colorspace is None else np.maximum(_gonio.convert_colours(light, colorspace, "rec709"), 0)


def read_normals(path: Path) -> Floats:
    """Read a normal map (OpenEXR, NPY, PFM, PNG).

    Parameters
    ----------
    path : str or os.PathLike
        The file.

    Returns
    -------
    ndarray of float32
        Normals of shape (height, width, 3) in camera coordinates: x points right, y up, and z towards
        the camera. Pixels without a surface are zero.

    Examples
    --------
    >>> np.save(folder / "flat.npy", np.full((16, 16, 3), (0, 0, 1), np.float32))
    >>> gonio.read_normals(folder / "flat.npy")[0, 0].tolist()
    [0.0, 0.0, 1.0]
    """
    return _gonio.read_normals(os.fspath(path))


def write_image(path: Path, image: Array, *, clip: float | None = None, colorspace: str | None = None) -> None:
    """Write an image to a file, atomically.

    Parameters
    ----------
    path : str or os.PathLike
        The file: ``.exr`` (with alpha if there are four channels), ``.hdr`` or ``.pfm`` for linear
        radiance; ``.png`` for 8-bit samples of shape (height, width, 3), as :func:`tonemapped`
        returns them.
    image : array
        Shape (height, width), (height, width, 3) or (height, width, 4).
    clip : float, optional
        For ``.exr``: clip level; :func:`infer` ignores pixels at or above it.
    colorspace : str, optional
        For ``.exr``: colour space of the image, stored in the file. The colours are not converted.

    Examples
    --------
    >>> gonio.write_image(folder / "ball.exr", found.relight(size=64))
    >>> gonio.write_image(folder / "ball.png", gonio.tonemapped(found.relight(size=64)))
    """
    array = array_of(image, "the image")
    if array.ndim == 2:
        array = np.repeat(array[:, :, np.newaxis], 3, axis=2)
    if array.ndim != 3 or array.shape[2] not in (3, 4):
        raise GonioError(f"the image: has the shape {array.shape}; use (height, width), (height, width, 3) or (height, width, 4)")
    name = os.fspath(path)
    is_png = name.lower().endswith(".png")
    level = None if clip is None else positive(clip, "clip", "radiance")
    if level is not None and not name.lower().endswith(".exr"):
        raise GonioError(f"{name}: clip requires an .exr file")
    stated = space_if_given(colorspace, "colorspace")
    if stated is not None and not name.lower().endswith(".exr"):
        raise GonioError(f"{name}: colorspace requires an .exr file")
    if is_png != (array.dtype == np.uint8):
        asked = "write 8-bit samples, such as tonemapped(image), to .png, and radiance to .exr, .hdr or .pfm"
        raise GonioError(f"{name}: {asked}")
    if is_png:
        if array.shape[2] != 3:
            raise GonioError(f"the image: has the shape {array.shape}; use (height, width, 3) for .png")
        _gonio.write_file(name, _gonio.encode_png(np.ascontiguousarray(array)))
        return
    alpha = floats(array[:, :, 3]) if array.shape[2] == 4 else None
    _gonio.write_image(name, floats(array[:, :, :3]), alpha, level, stated)
