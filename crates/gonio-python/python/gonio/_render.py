"""Rendering of BRDFs."""

from __future__ import annotations

import warnings

import numpy as np

from . import _gonio
from ._arguments import Camera, Picture, Progress, Shape
from ._validation import flag, integer, listener, positive, shown
from ._errors import GonioError, GonioWarning
from ._files import environment_map
from ._shape import given_shape
from ._types import Floats, GivenShape, RenderSettings


def studio_light(height: int = 128) -> Floats:
    """Create the studio light of gonio's reports.

    Parameters
    ----------
    height : int, default 128
        Rows of the map, 1 to 4096.

    Returns
    -------
    ndarray of float32
        A lat-long map of shape (height, 2 height, 3).

    Examples
    --------
    >>> gonio.studio_light(32).shape
    (32, 64, 3)
    """
    return _gonio.studio(integer(height, "height", 1, 4096))


def render_settings(
    shape: Shape,
    size: int | tuple[int, int],
    camera: Camera | None,
    pose: Camera | None,
    samples: int,
    tolerance: float | None,
    shadows: bool,
) -> tuple[GivenShape, RenderSettings]:
    """Checks the arguments of :func:`gonio.render`, except BRDF and light."""
    pair = size if isinstance(size, (tuple, list)) else (size, size)
    if len(pair) != 2:
        raise TypeError(f"size: must be one number of pixels, or width and height, not {shown(size)}")
    width, height = (integer(side, "size", 8, 8192) for side in pair)
    given = given_shape({"shape": shape, "camera": camera, "pose": pose})
    if given["shape"] == "sphere" and width != height:
        raise GonioError("size: width and height must be equal for a sphere")
    settings: RenderSettings = {
        "width": width,
        "height": height,
        "samples": integer(samples, "samples", 1, 16),
        "tolerance": None if tolerance is None else positive(tolerance, "tolerance"),
        "shadows": flag(shadows, "shadows"),
    }
    return given, settings


def drawn(
    table: Floats,
    full: Floats | None,
    light: Picture | None,
    given: GivenShape,
    settings: RenderSettings,
    progress: Progress | None,
    colorspace: str | None = None,
) -> Floats:
    """Renders the table of a BRDF. Warnings refer to the caller of the calling function."""
    listener(progress)
    lit = studio_light() if light is None else environment_map(light, colorspace=colorspace)
    rgb, alpha, messages = _gonio.render(table, full, lit, given, settings, {"progress": progress, "poll": None})
    for message in messages:
        warnings.warn(message, GonioWarning, stacklevel=3)
    return np.dstack([rgb, alpha])
