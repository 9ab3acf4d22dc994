"""Light probes from photographs of a mirror ball."""

from __future__ import annotations

import base64
import json
import warnings
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from . import _gonio
from ._arguments import Camera, Path, Photograph, Picture, Progress
from ._validation import integer, listener, number, reflectances, space
from ._errors import GonioError, GonioWarning
from ._files import write_image
from ._scene import given_scene
from ._types import Floats, GivenScene, ProbeSettings


@dataclass(frozen=True)
class LightProbe:
    """Result of :func:`light_probe`: the light around a mirror ball. Notebooks display its picture.

    Attributes
    ----------
    light : ndarray of float32
        Lat-long map of the light, shape (rows, 2 rows, 3), in coordinates of the first camera: row 0
        is up, the centre is -z, and the right half is +x.
    coverage : ndarray of float32
        Observed share of each texel, shape (rows, 2 rows); the rest is interpolated from its
        surroundings.
    picture : ndarray of uint8
        Diagnostic picture: the photographs with ignored pixels marked, and the map with its
        interpolated parts.
    result : dict
        All numbers by name, as ``gonio light --json`` prints them.
    warnings : list of str
        Warnings, one line each.
    colorspace : str
        Colour space of :meth:`write`; ``light`` is linear Rec. 709.
    """

    light: Floats = field(repr=False)
    coverage: Floats = field(repr=False)
    picture: NDArray[np.uint8] = field(repr=False)
    result: dict[str, Any]
    warnings: list[str]
    colorspace: str = "rec709"

    def write(self, path: Path) -> None:
        """Write the map to a file, atomically.

        Parameters
        ----------
        path : str or os.PathLike
            The file: ``.exr``, ``.hdr`` or ``.pfm``.
        """
        write_image(path, _gonio.convert_colours(self.light, "rec709", self.colorspace), colorspace=self.colorspace)

    def _repr_html_(self) -> str:
        data = base64.b64encode(_gonio.encode_png(self.picture)).decode()
        return f'<img alt="light probe" style="max-width:100%" src="data:image/png;base64,{data}">'


def light_probe(
    image: Photograph,
    mask: Picture | None = None,
    *,
    circle: tuple[float, float, float] | None = None,
    camera: Camera | None = None,
    reflectance: float | tuple[float, float, float] = 1.0,
    rows: int | None = None,
    second: Photograph | None = None,
    second_mask: Picture | None = None,
    second_circle: tuple[float, float, float] | None = None,
    second_azimuth: float | None = None,
    times: Sequence[float] | None = None,
    response: Path | None = None,
    align: bool = True,
    trust_times: bool = False,
    black_level: float | None = None,
    flat: Path | None = None,
    linear: bool = False,
    layer: str | None = None,
    colorspace: str | None = None,
    output_colorspace: str = "rec709",
    clip: float | None = None,
    progress: Progress | None = None,
) -> LightProbe:
    """Convert one or two photographs of a mirror ball to an environment map.

    Parameters
    ----------
    image : path, array, bytes, open file, or list of paths
        The photograph, or its exposures, as for :func:`gonio.infer`.
    mask, times, response, align, trust_times, black_level, flat, linear, layer, colorspace, clip
        See :func:`gonio.infer`. All but ``mask`` apply to both photographs.
    circle : (float, float, float), optional
        Outline of the ball in pixels, instead of detecting it: x, y (from the top left corner) and
        radius.
    camera : path or dict, optional
        Camera parameters (docs/camera.md), for photographs from nearby; apply to both photographs.
    reflectance : float or 3 floats, default 1
        Reflectance of the ball at normal incidence: one number, or one per channel.
    rows : int, optional
        Rows of the map, a power of two from 8 to 4096; by default about the ball's radius in pixels.
    second, second_mask, second_circle : optional
        A second photograph of the ball, ideally from a camera 90 degrees around it.
    second_azimuth : float, optional
        Angle from the first to the second camera around the ball, in degrees, counterclockwise as
        seen from above; by default estimated from both photographs.
    output_colorspace : str, default "rec709"
        Colour space of :meth:`LightProbe.write`.
    progress : callable, optional
        Called in this thread with the name of a stage and its completed fraction; an exception stops
        the computation.

    Returns
    -------
    LightProbe
        The environment map.

    Raises
    ------
    GonioError
        If an input is invalid; :class:`FileError` if a file cannot be read.

    Examples
    --------
    >>> probe = gonio.light_probe("chrome.exr", reflectance=0.55)  # doctest: +SKIP
    >>> found = gonio.infer("photo.exr", light=probe.light)        # doctest: +SKIP
    """
    messages: list[str] = []
    listener(progress)
    reading = {
        "times": times,
        "response": response,
        "align": align,
        "trust_times": trust_times,
        "black_level": black_level,
        "flat": flat,
        "linear": linear,
        "layer": layer,
        "colorspace": colorspace,
    }
    written = space(output_colorspace, "output_colorspace")
    if second is None and not (second_mask is None and second_circle is None and second_azimuth is None):
        raise GonioError("second_mask, second_circle and second_azimuth require a second photograph; specify it with second=")

    if rows is not None and integer(rows, "rows", -(2**63)) < 0:
        raise GonioError(f"rows {rows}: must be a power of two from 8 to 4096")

    def scene(given: Photograph, unnamed: str, where: Picture | None, outline: tuple[float, float, float] | None) -> GivenScene:
        own = {"mask": where, "clip": clip, "one_material": True, "circle": outline, "camera": camera}
        return given_scene(given, {**reading, **own}, messages, unnamed)

    settings: ProbeSettings = {
        "reflectance": reflectances(reflectance, "reflectance"),
        "rows": None if rows is None else int(rows),
        "second_azimuth": None if second_azimuth is None else number(second_azimuth, "second_azimuth"),
    }
    first = scene(image, "the image", mask, circle)
    other = None if second is None else scene(second, "the second image", second_mask, second_circle)
    light, coverage, drawn, document, more = _gonio.light_probe(first, other, settings, {"progress": progress, "poll": None})
    messages += more
    for message in messages:
        warnings.warn(message, GonioWarning, stacklevel=2)
    return LightProbe(light, coverage, drawn, json.loads(document), messages, written)
