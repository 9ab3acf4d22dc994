"""Pictures of BRDFs."""

from __future__ import annotations

import warnings
from collections.abc import Callable

import numpy as np

from . import _gonio
from ._arguments import Camera, Picture, Shape, shape as given_shape
from ._errors import GonioError, GonioWarning
from ._files import light_map
from ._types import Floats, GivenShape, RenderSettings


def studio_light(height: int = 128) -> Floats:
    """The light that gonio shows its results in, a lat-long map of shape (height, 2 height, 3)."""
    if not 1 <= height <= 4096:
        raise GonioError(f"height {height}: give a number of rows from 1 to 4096")
    return _gonio.studio(height)


def frame(
    shape: Shape,
    size: int | tuple[int, int],
    camera: Camera | None,
    pose: Camera | None,
    samples: int,
    tolerance: float | None,
    shadows: bool,
) -> tuple[GivenShape, RenderSettings]:
    """What :func:`gonio.render` is asked for, apart from BRDF and light, checked."""
    width, height = (size, size) if isinstance(size, int) else size
    if not (8 <= width <= 8192 and 8 <= height <= 8192):
        raise GonioError(f"size {size}: give sides from 8 to 8192 pixels")
    if tolerance is not None and not tolerance > 0:
        raise GonioError(f"tolerance {tolerance}: give a positive number")
    if not 1 <= samples <= 16:
        raise GonioError(f"samples {samples}: give a number from 1 to 16")
    given = given_shape(shape, camera=camera, pose=pose)
    if given["shape"] == "sphere" and width != height:
        raise GonioError("a sphere is rendered in a square")
    settings: RenderSettings = {
        "width": width,
        "height": height,
        "samples": samples,
        "tolerance": tolerance,
        "shadows": shadows,
    }
    return given, settings


def drawn(
    table: Floats,
    full: Floats | None,
    light: Picture | None,
    given: GivenShape,
    settings: RenderSettings,
    progress: Callable[[str, float], object] | None,
) -> Floats:
    """The picture of the table of a BRDF. Warnings are issued where the caller was called."""
    lit = studio_light() if light is None else light_map(light)
    rgb, alpha, said = _gonio.render(table, full, lit, given, settings, {"progress": progress, "poll": None})
    for message in said:
        warnings.warn(message, GonioWarning, stacklevel=3)
    return np.dstack([rgb, alpha])
