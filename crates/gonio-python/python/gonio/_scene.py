"""Converts arguments for a photograph and its object."""

from __future__ import annotations

import os
from collections.abc import Mapping
from typing import Any, cast

from ._arguments import Path, Photograph, is_path
from ._arrays import mask_of, name_of, photograph
from ._validation import flag, numbers, positive, space_if_given, text
from ._errors import GonioError
from ._reference import REFERENCE, given_reference
from ._shape import FORM, given_shape
from ._types import GivenReading, GivenScene

READING: dict[str, Any] = {
    "linear": False,
    "layer": None,
    "times": None,
    "response": None,
    "align": True,
    "trust_times": False,
    "black_level": None,
    "flat": None,
    "colorspace": None,
}
"""Arguments for reading files, with their defaults."""

SCENE: dict[str, Any] = {**READING, **FORM, **REFERENCE, "mask": None, "clip": None, "one_material": False, "force": False}
"""Arguments for a photograph and its object, with their defaults."""


def given_reading(options: Mapping[str, Any]) -> GivenReading:
    """Returns the options for reading the files of a photograph."""
    chosen = {**READING, **{key: value for key, value in options.items() if key in READING}}
    times = None
    if chosen["times"] is not None:
        times = numbers(chosen["times"], "times", "the exposure time of each file in seconds")
        if not times or min(times) <= 0:
            raise GonioError("times: must be the exposure time of each file in seconds, all above zero")
    response = chosen["response"]
    if response is not None and not is_path(response):
        raise TypeError(f'response: must be "srgb", "linear" or the file of a curve, not {response!r}')
    linear = flag(chosen["linear"], "linear")
    if linear and response is not None:
        raise GonioError("linear=True and response both specify the response curve; use only one of them")
    if chosen["flat"] is not None and not is_path(chosen["flat"]):
        raise TypeError("flat: must be an image file of an evenly lit surface; for arrays, divide the image by the flat field yourself")
    black = chosen["black_level"]
    return {
        "linear": linear,
        "layer": None if chosen["layer"] is None else text(chosen["layer"], "layer"),
        "times": times,
        "response": None if response is None else os.fspath(response),
        "align": flag(chosen["align"], "align"),
        "trust_times": flag(chosen["trust_times"], "trust_times"),
        "black_level": None if black is None else float(numbers([black], "black_level", "a code")[0]),
        "flat": None if chosen["flat"] is None else os.fspath(cast(Path, chosen["flat"])),
        "colorspace": space_if_given(chosen["colorspace"], "colorspace"),
    }


def given_scene(image: Photograph, options: Mapping[str, Any], warnings: list[str], unnamed: str = "the image") -> GivenScene:
    """Returns the scene described by the arguments in :data:`SCENE`; missing ones have their defaults."""
    chosen = {**SCENE, **{key: value for key, value in options.items() if key in SCENE}}
    name = name_of(image, unnamed)
    reading = given_reading(chosen)
    shots = photograph(image, name, reading["linear"], warnings)
    if isinstance(shots, tuple) or not isinstance(shots, (str, bytes, list)):
        values: dict[str, object] = {**reading}
        given = [key for key in READING if key not in ("linear", "colorspace") and values[key] != READING[key]]
        if given:
            raise GonioError(f"{given[0]} applies only to files, but {name} is an array")
    clip = None if chosen["clip"] is None else positive(chosen["clip"], "clip", "radiance")
    return {
        "name": name,
        "image": shots,
        "reading": reading,
        "mask": mask_of(chosen["mask"]),
        "clip": clip,
        "one_material": flag(chosen["one_material"], "one_material"),
        "force": flag(chosen["force"], "force"),
        "object": given_shape(chosen),
        "reference": given_reference(chosen),
    }
