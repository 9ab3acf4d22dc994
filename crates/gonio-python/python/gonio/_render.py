"""Pictures of BRDFs."""

from __future__ import annotations

import warnings
from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike

from . import _gonio
from ._arguments import Camera, Picture, Shape, light as light_map, shape as given_shape
from ._brdf import Brdf
from ._errors import GonioError, GonioWarning
from ._types import Floats, RenderSettings


def studio_light(height: int = 128) -> Floats:
    """The light that gonio shows its results in, a lat-long map of shape (height, 2 height, 3)."""
    if not 1 <= height <= 4096:
        raise GonioError(f"height {height}: give a number of rows from 1 to 4096")
    return _gonio.studio(height)


def render(
    brdf: Brdf | ArrayLike,
    light: Picture | None = None,
    shape: Shape = "sphere",
    size: int | tuple[int, int] = 256,
    *,
    camera: Camera | None = None,
    pose: Camera | None = None,
    samples: int = 1,
    tolerance: float = 0.2,
    shadows: bool = True,
    progress: Callable[[str, float], object] | None = None,
) -> Floats:
    """Renders an object of a BRDF under a light.

    :param brdf: what it is made of.
    :param light: a lat-long map in coordinates of the camera (row 0 is up, the centre looks along -z, the right half is +x), as a file or an
        array of shape (height, 2 height, 3); without one :func:`studio_light`.
    :param shape: ``"sphere"``, ``"blob"``, ``"bunny"``, ``"bowl"``, the file of a mesh, or (vertices, faces).
    :param size: width and height in pixels, or both as a pair.
    :param camera: where the camera of a mesh is (docs/camera.md), ``pose``: where the mesh is.
    :param samples: along each side of a pixel.
    :param tolerance: sum of error bounds relative to the radiance; the true error is smaller, by some
        fifty times in detailed light, by five in the worst case known (a coarse even map).
    :param shadows: whether a mesh throws shadows on itself.
    :returns: radiance and coverage, shape (height, width, 4); colour is multiplied by coverage.
    """
    width, height = (size, size) if isinstance(size, int) else size
    if not (8 <= width <= 8192 and 8 <= height <= 8192):
        raise GonioError(f"size {size}: give sides from 8 to 8192 pixels")
    if not tolerance > 0:
        raise GonioError(f"tolerance {tolerance}: give a positive number")
    if not 1 <= samples <= 16:
        raise GonioError(f"samples {samples}: give a number from 1 to 16")
    given = given_shape(shape, camera=camera, pose=pose)
    if given["shape"] == "sphere" and width != height:
        raise GonioError("a sphere is rendered in a square")
    what = brdf if isinstance(brdf, Brdf) else Brdf(brdf)
    settings: RenderSettings = {
        "width": width,
        "height": height,
        "samples": samples,
        "tolerance": tolerance,
        "shadows": shadows,
    }
    lit = studio_light() if light is None else light_map(light)
    rgb, alpha, said = _gonio.render(what.table, what.full, lit, given, settings, {"progress": progress, "poll": None})
    for message in said:
        warnings.warn(message, GonioWarning, stacklevel=2)
    return np.dstack([rgb, alpha])
