"""Light probes: the light around a mirror ball."""

from __future__ import annotations

import base64
import json
import os
import warnings
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from . import _gonio
from ._arguments import Camera, Path, Picture, is_path, mask as given_mask, picture, shape as given_shape
from ._errors import GonioError, GonioWarning
from ._files import write_image
from ._types import Floats, GivenScene, ProbeSettings


@dataclass(frozen=True)
class LightProbe:
    """The light around a mirror ball, as :func:`light_probe` finds it. In a notebook it shows what was done."""

    light: Floats = field(repr=False)
    """The light, a lat-long map of shape (rows, 2 rows, 3) in the space of the first camera: row 0 is up, the centre looks along -z, the
    right half is +x."""
    seen: Floats = field(repr=False)
    """Share of each texel that a photograph shows, shape (rows, 2 rows); the rest is filled from around it."""
    picture: NDArray[np.uint8] = field(repr=False)
    """What was done, to look at: what was used of the photographs, and the map with what was filled."""
    notes: dict[str, Any]
    """All numbers by name, as ``gonio light --json`` prints them."""
    warnings: list[str]
    """What is odd, one line each."""

    def write(self, path: Path) -> None:
        """Writes the map to a file, whole or not at all: ``.exr``, ``.hdr`` or ``.pfm``."""
        write_image(path, self.light)

    def _repr_html_(self) -> str:
        data = base64.b64encode(_gonio.encode_png(self.picture)).decode()
        return f'<img alt="light probe" style="max-width:100%" src="data:image/png;base64,{data}">'


def light_probe(
    image: Picture,
    mask: Picture | None = None,
    *,
    circle: tuple[float, float, float] | None = None,
    camera: Camera | None = None,
    reflectance: float | tuple[float, float, float] = 1.0,
    rows: int | None = None,
    second: Picture | None = None,
    second_mask: Picture | None = None,
    second_circle: tuple[float, float, float] | None = None,
    second_yaw: float | None = None,
    clip: float | None = None,
    linear: bool = False,
    layer: str | None = None,
    progress: Callable[[str, float], object] | None = None,
) -> LightProbe:
    """Unwraps a photograph of a mirror ball, or two of them, to the light around it.

    :param image: the photograph, a file or an array as :func:`gonio.infer` takes it. ``mask``, ``clip``, ``linear`` and ``layer`` are
        also as there.
    :param circle: outline of the ball in pixels, x, y (from the top left corner) and radius, if it is not to be found.
    :param camera: the camera (docs/camera.md), a file or a dictionary, if it is near; of both photographs if there are two.
    :param reflectance: share of the light that the ball reflects where it is seen from the front, one number or one for each colour.
    :param rows: rows of the map, a power of two from 8 to 4096; about the ball's radius in pixels if not given.
    :param second: a photograph of the ball from another side, best a quarter turn away, with ``second_mask`` and ``second_circle``.
    :param second_yaw: angle by which the second camera went around the ball, in degrees, counterclockwise as seen from above; found
        from what both show if not given.
    :param progress: called in this thread with the name of a stage and the fraction of it that is done; an exception ends the work.
    :raises GonioError: when something given cannot be used; :class:`FileError` if it is a file that cannot be read.
    """
    said: list[str] = []
    if rows is not None and rows < 0:
        raise GonioError(f"rows {rows}: give a power of two from 8 to 4096")
    if second is None and not (second_mask is None and second_circle is None and second_yaw is None):
        raise GonioError("second_mask, second_circle and second_yaw go with a second photograph: give second=")
    if clip is not None and not clip > 0:
        raise GonioError(f"clip {clip}: give a positive radiance")

    def scene(given: Picture, unnamed: str, where: Picture | None, outline: tuple[float, float, float] | None) -> GivenScene:
        name = os.fspath(cast(Path, given)) if is_path(given) else unnamed
        return {
            "name": name,
            "image": picture(given, name, linear, said),
            "linear": linear,
            "layer": layer,
            "mask": given_mask(where),
            "clip": clip,
            "keep_colors": True,
            "object": given_shape("sphere", circle=outline, camera=camera),
        }

    shares = np.atleast_1d(np.asarray(reflectance, np.float64))
    if shares.shape not in ((1,), (3,)):
        raise GonioError("reflectance: give one number above 0 and up to 1, or three")
    shares = np.broadcast_to(shares, 3)
    settings: ProbeSettings = {
        "reflectance": (float(shares[0]), float(shares[1]), float(shares[2])),
        "rows": rows,
        "second_yaw": second_yaw,
    }
    first = scene(image, "the image", mask, circle)
    other = None if second is None else scene(second, "the second image", second_mask, second_circle)
    light, seen, drawn, notes, more = _gonio.light_probe(first, other, settings, {"progress": progress, "poll": None})
    said += more
    for message in said:
        warnings.warn(message, GonioWarning, stacklevel=2)
    return LightProbe(light, seen, drawn, json.loads(notes), said)
