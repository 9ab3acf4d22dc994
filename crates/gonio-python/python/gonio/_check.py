"""Checks and merges photographs before inference."""

from __future__ import annotations

import base64
import json
import os
import warnings
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from . import _gonio
from ._arguments import Path, Photograph, Picture, Progress, Shape, is_path
from ._arrays import paths
from ._validation import integer, listener, shown
from ._errors import GonioError, GonioWarning
from ._files import write_image
from ._regions import given_regions
from ._scene import SCENE, given_reading, given_scene
from ._types import Bytes, Doubles, Floats


@dataclass(frozen=True)
class Checked:
    """Result of :func:`check`. Notebooks display its picture.

    Attributes
    ----------
    picture : ndarray of uint8
        The photograph with the outline of the object and all ignored pixels marked, shape (height,
        width, 3).
    outlines : list of str
        Description of the detected shape of each object.
    result : dict
        All numbers by name, as ``gonio check --json`` prints them; ``result["objects"]`` has one
        entry for each object.
    warnings : list of str
        Warnings about the photograph, one line each.
    """

    picture: Bytes = field(repr=False)
    outlines: list[str]
    result: dict[str, Any] = field(repr=False)
    warnings: list[str]

    def _repr_html_(self) -> str:
        data = base64.b64encode(_gonio.encode_png(self.picture)).decode()
        return f'<img alt="detected object" style="max-width:100%" src="data:image/png;base64,{data}">'


def check(
    image: Photograph,
    shape: Shape = "sphere",
    mask: Picture | None = None,
    *,
    regions: Picture | None = None,
    circles: Sequence[tuple[float, float, float]] | None = None,
    progress: Progress | None = None,
    **options: Any,
) -> Checked:
    """Detect the object, clipped pixels and faulty pixels in a photograph, without inference.

    Parameters
    ----------
    image, shape, mask
        See :func:`infer`.
    regions, circles
        Several regions or balls, as for :func:`infer_regions`.
    progress : callable, optional
        Called in this thread with the name of a stage and its completed fraction.
    **options
        Arguments of :func:`infer` for reading the photograph, for the shape of the object and for
        references: ``linear``, ``layer``, ``times``, ``response``, ``align``, ``trust_times``,
        ``black_level``, ``flat``, ``colorspace``, ``clip``, ``one_material``, ``force``, ``normals``
        and its options, ``circle``, ``depth_axis``, ``camera``, ``pose``, ``white``, ``grey_card``,
        ``grey_ball``, ``color_checker`` and their options.

    Returns
    -------
    Checked
        The detected objects and pixels.

    Raises
    ------
    GonioError
        If the photograph is unusable, as :func:`infer` raises it.

    Examples
    --------
    >>> looked = gonio.check("samples/ball.exr")
    >>> looked.outlines
    ['ball, circle 128.0,128.0,126.0 (x, y, radius in pixels)']
    >>> looked.result["objects"][0]["report"]["clipped_pixels"]
    0
    """
    unknown = sorted(set(options) - set(SCENE))
    if unknown:
        raise TypeError(f"check has no argument {', '.join(unknown)}")
    listener(progress)
    messages: list[str] = []
    scene = given_scene(image, {**options, "shape": shape, "mask": mask}, messages)
    places = given_regions(regions, circles) if regions is not None or circles is not None else None
    found = _gonio.check(scene, places, {"progress": progress, "poll": None})
    messages += found["warnings"]
    for message in messages:
        warnings.warn(message, GonioWarning, stacklevel=2)
    return Checked(found["picture"], found["outlines"], json.loads(found["document"]), messages)


@dataclass(frozen=True)
class Merged:
    """Result of :func:`merge`: exposures merged into one image.

    Attributes
    ----------
    picture : ndarray of float32
        Linear radiance, shape (height, width, 3), or (height, width, 4) with alpha. Pixels at or
        above ``clip_level`` have no valid exposure.
    clip_level : float
        Value of pixels without a valid exposure: ``gonio.infer(merged.picture,
        clip=merged.clip_level)`` ignores them.
    origin : ndarray of int16
        Index of the main exposure of each pixel, from 0, shape (height, width); -1 if the pixel is
        clipped in all exposures, -2 if it is black in all, -3 if they are inconsistent.
    response : ndarray of float64
        Response curve of the camera: log exposure of each code, shape (3, codes).
    result : dict
        All numbers by name, as ``gonio merge --json`` prints them.
    warnings : list of str
        Warnings, one line each.
    """

    picture: Floats = field(repr=False)
    clip_level: float
    origin: NDArray[np.int16] = field(repr=False)
    response: Doubles = field(repr=False)
    result: dict[str, Any] = field(repr=False)
    warnings: list[str]
    _curve: bytes = field(repr=False)

    def write(self, path: Path) -> None:
        """Write the image, atomically.

        Parameters
        ----------
        path : str or os.PathLike
            An ``.exr`` file. It stores the clip level for :func:`infer`.
        """
        name = os.fspath(path)
        if not name.lower().endswith(".exr"):
            raise GonioError(f"{name}: the output must be an .exr file")
        write_image(name, self.picture, clip=self.clip_level, colorspace="rec709")

    def write_response(self, path: Path) -> None:
        """Write the response curve as text, for ``response`` of :func:`merge` and :func:`infer`.

        Parameters
        ----------
        path : str or os.PathLike
            The file.
        """
        _gonio.write_file(os.fspath(path), self._curve)


def merge(
    images: Sequence[Path],
    *,
    times: Sequence[float] | None = None,
    response: Path | None = None,
    align: bool = True,
    trust_times: bool = False,
    linear: bool = False,
    black_level: float | None = None,
    flat: Path | None = None,
    colorspace: str | None = None,
    progress: Progress | None = None,
) -> Merged:
    """Merge exposures of one static scene into an HDR image.

    Parameters
    ----------
    images : sequence of paths
        8- or 16-bit JPEG, PNG or TIFF files of equal size.
    times, response, align, trust_times, linear, black_level, flat, colorspace
        See :func:`infer`.
    progress : callable, optional
        Called in this thread with the name of a stage and its completed fraction.

    Returns
    -------
    Merged
        The image, and the source of each pixel.

    Raises
    ------
    GonioError
        If the exposures do not match, or a setting does not apply to them.

    Examples
    --------
    >>> merged = gonio.merge(["a.jpg", "b.jpg", "c.jpg"])            # doctest: +SKIP
    >>> found = gonio.infer(merged.picture, clip=merged.clip_level)  # doctest: +SKIP
    """
    if is_path(images) or not isinstance(images, (list, tuple)):
        raise TypeError(f"images: must be a list of the files of exposures, not {shown(images)}")
    listener(progress)
    files = paths(images, "images")
    chosen = {
        "times": times,
        "response": response,
        "align": align,
        "trust_times": trust_times,
        "linear": linear,
        "black_level": black_level,
        "flat": flat,
        "colorspace": colorspace,
    }
    found = _gonio.merge(files, given_reading(chosen), {"progress": progress, "poll": None})
    for message in found["warnings"]:
        warnings.warn(message, GonioWarning, stacklevel=2)
    picture = found["picture"] if found["alpha"] is None else np.dstack([found["picture"], found["alpha"]])
    document = json.loads(found["document"])
    return Merged(
        picture, found["clip_level"], found["origin"], found["response"], document, found["warnings"], found["response_file"]
    )


def set_threads(count: int | None = None) -> None:
    """Set the number of threads. Results do not depend on it.

    Parameters
    ----------
    count : int, optional
        Number of threads, 1 to 1024; by default one per core.

    Examples
    --------
    >>> gonio.set_threads(2)
    >>> gonio.set_threads()
    """
    _gonio.set_threads(None if count is None else integer(count, "threads", 1, 1024))
