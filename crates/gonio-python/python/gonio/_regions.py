"""Several materials in one photograph."""

from __future__ import annotations

import os
import warnings
from inspect import signature
from typing import Any, cast

import numpy as np

from . import _gonio
from ._arguments import Path, Picture, floats, is_path
from ._errors import GonioError, GonioWarning
from ._infer import infer, prepared, stem_of
from ._posterior import Posterior
from ._types import Floats, GivenRegions


def _labels(given: Picture) -> str | Floats:
    """Labels as colours: an index stands in all three channels."""
    if is_path(given):
        return os.fspath(cast(Path, given))
    array = np.asarray(given)
    if array.dtype.kind not in "iub" or array.ndim not in (2, 3) or array.min() < 0 or array.max() > 255:
        raise GonioError("materials: give whole numbers from 0 to 255, of shape (height, width) or (height, width, 3)")
    colours = array if array.ndim == 3 else np.repeat(array[:, :, np.newaxis], 3, axis=2)
    return floats(colours / np.float32(255))


def infer_regions(
    image: Picture,
    materials: Picture | None = None,
    *,
    circles: list[tuple[float, float, float]] | None = None,
    **options: Any,
) -> dict[str, Posterior]:
    """Infers several materials in one photograph, all under one light.

    :param image: the photograph, as :func:`gonio.infer` takes it.
    :param materials: one index (or colour) for each region, 0 where there is none: a file, or an array of whole numbers of shape (height,
        width) or (height, width, 3). The shape is that of ``options``, as for a single material.
    :param circles: the outlines of several balls instead, x, y and radius in pixels. With neither, balls that do not touch are found.
    :param options: arguments of :func:`gonio.infer`.
    :returns: for each region, by its index or colour or the number of the ball, a posterior. ``notes["relative_albedo"]`` is its albedo
        beside that of the brightest region: all are under one light.
    :raises GonioError: as :func:`gonio.infer`, with the region at fault.
    """
    defaults = {name: value.default for name, value in signature(infer).parameters.items()}
    unknown = set(options) - set(defaults)
    if unknown:
        raise TypeError(f"infer_regions has no argument {sorted(unknown)[0]}")
    if materials is not None and circles is not None:
        raise GonioError("give materials or circles, not both")
    given = {**defaults, **options, "image": image}
    scene, settings, model, said = prepared(given)
    regions: GivenRegions = {
        "labels": None if materials is None else _labels(materials),
        "circles": None if circles is None else [cast("tuple[float, float, float]", tuple(circle)) for circle in circles],
    }
    found = _gonio.infer_regions(scene, regions, settings, model, {"progress": given["progress"], "poll": None})
    out = {name: Posterior(values, f"{stem_of(image)}-{name}") for name, values in found}
    for message in said + [f"region {name}: {message}" for name, posterior in out.items() for message in posterior.warnings]:
        warnings.warn(message, GonioWarning, stacklevel=2)
    return out
