"""Inference of several materials in one photograph."""

from __future__ import annotations

import os
import warnings
from collections.abc import Sequence
from typing import Any, cast

import numpy as np

from . import _gonio
from ._arguments import Array, Path, Photograph, Picture, is_path
from ._arrays import array_of, floats
from ._validation import check_arguments, circle, defaults
from ._errors import GonioError, GonioWarning
from ._infer import infer, prepared, stem_of
from ._posterior import Posterior
from ._types import Floats, GivenRegions


def _labels(given: Picture) -> str | Floats:
    """Converts labels to colours; an index is stored in all three channels."""
    if is_path(given):
        return os.fspath(cast(Path, given))
    array = array_of(cast(Array, given), "regions", indices=True)
    whole_numbers = array.dtype.kind in "iub" and array.ndim in (2, 3) and array.size > 0
    if not whole_numbers or array.min() < 0 or array.max() > 255:
        raise GonioError("regions: must be integers from 0 to 255 of shape (height, width) or (height, width, 3)")
    colours = array if array.ndim == 3 else np.repeat(array[:, :, np.newaxis], 3, axis=2)
    return floats(colours / np.float32(255))


def given_regions(labels: Picture | None, circles: Sequence[tuple[float, float, float]] | None) -> GivenRegions:
    """Converts the positions of regions for the extension."""
    if labels is not None and circles is not None:
        raise GonioError("regions and circles both define the regions; use only one of them")
    return {
        "labels": None if labels is None else _labels(labels),
        "circles": None if circles is None else [circle(one, "circles") for one in circles],
    }


def infer_regions(
    image: Photograph,
    regions: Picture | None = None,
    *,
    circles: Sequence[tuple[float, float, float]] | None = None,
    **options: Any,
) -> dict[str, Posterior]:
    """Infer several materials in one photograph, under one light.

    Parameters
    ----------
    image : path, array, bytes, open file, or list of paths
        The photograph, as for :func:`gonio.infer`.
    regions : path or array, optional
        Label image with one index or colour per region and 0 elsewhere: integers of shape (height,
        width) or (height, width, 3). ``options`` specify the shape of the object, as for a single
        material.
    circles : sequence of (float, float, float), optional
        Outlines of several balls (x, y and radius in pixels), instead of ``regions``. Without
        both, separate balls are detected.
    **options
        Arguments of :func:`gonio.infer`.

    Returns
    -------
    dict of str to Posterior
        Posterior of each region, by index, colour, or number of the ball.
        ``result["relative_albedo"]`` is the albedo relative to that of the brightest region.

    Raises
    ------
    GonioError
        See :func:`gonio.infer`; the message names the faulty region.

    Examples
    --------
    >>> dull = gonio.render(gonio.Brdf.of(lambda h, d: 0.2 + 0 * h), size=48)
    >>> both = np.concatenate([dull, gonio.render(found.brdf, size=48)], axis=1)
    >>> list(gonio.infer_regions(both, grid=16, pictures=False))
    ['1', '2']
    """
    check_arguments(options, infer, "infer_regions")
    given = {**defaults(infer), **options, "image": image}
    places = given_regions(regions, circles)
    if circles is not None and given["mask"] is not None:
        raise GonioError("circles and mask both define the balls; use only one of them")
    if given["one_material"]:
        raise GonioError("one_material applies to photographs of one material; with regions, gonio uses all colours")
    scene, settings, model, messages = prepared(given)
    found, of_photograph = _gonio.infer_regions(scene, places, settings, model, {"progress": given["progress"], "poll": None})
    out = {name: Posterior(values, f"{stem_of(image)}-{name}") for name, values in found}
    of_regions = [f"region {name}: {message}" for name, posterior in out.items() for message in posterior.warnings]
    for message in messages + of_photograph + of_regions:
        warnings.warn(message, GonioWarning, stacklevel=2)
    return out
