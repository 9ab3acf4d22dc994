"""Converts arguments for neutral references."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

from ._arrays import mask_of
from ._validation import circle, flag, number, numbers, shown
from ._errors import GonioError
from ._types import GivenReference

REFERENCE: dict[str, Any] = {
    "white": None,
    "grey_card": None,
    "grey_ball": None,
    "color_checker": None,
    "reference_reflectance": None,
    "reference_color_only": False,
}
"""Arguments for a neutral reference, with their defaults."""

CORNERS = "True, or the centres of four corner patches: dark skin, bluish green, black, white"


def given_reference(chosen: Mapping[str, Any]) -> GivenReference | None:
    """Returns the reference described by the arguments in :data:`REFERENCE`."""
    chart = chosen["color_checker"]
    if chart is False:
        chart = None
    targets = {"white": chosen["white"], "grey_card": chosen["grey_card"], "grey_ball": chosen["grey_ball"], "color_checker": chart}
    given = [name for name, value in targets.items() if value is not None]
    if len(given) > 1:
        raise GonioError(f"{' and '.join(given)} are references; use only one of them")
    reflectance = chosen["reference_reflectance"]
    if reflectance is not None:
        reflectance = number(reflectance, "reference_reflectance")
        if not 0 < reflectance <= 1:
            raise GonioError(f"reference_reflectance {reflectance}: must be above 0 and at most 1")
        if given not in (["white"], ["grey_card"], ["grey_ball"]):
            raise GonioError("reference_reflectance applies to white, grey_card and grey_ball; the reflectances of a colour chart are published")
    color_only = flag(chosen["reference_color_only"], "reference_color_only")
    if color_only and not given:
        raise GonioError("reference_color_only requires white, grey_card, grey_ball or color_checker")
    if not given:
        return None
    return {
        "white": None if chosen["white"] is None else circle(chosen["white"], "white"),
        "grey_card": mask_of(chosen["grey_card"], "the mask of the grey card"),
        "grey_ball": None if chosen["grey_ball"] is None else circle(chosen["grey_ball"], "grey_ball"),
        "corners": None if chart is None else _corners(chart),
        "reflectance": reflectance,
        "color_only": color_only,
    }


def _corners(given: object) -> list[tuple[float, float]]:
    """Returns the corners of a chart; empty to detect it."""
    if given is True or (isinstance(given, str) and given == "auto"):
        return []
    if isinstance(given, (str, bytes)) or not isinstance(given, Iterable):
        raise TypeError(f"color_checker: must be {CORNERS}, not {shown(given)}")
    listed = list(given)
    pairs = [list(one) for one in listed if isinstance(one, Iterable) and not isinstance(one, (str, bytes))]
    flat = [value for pair in pairs for value in pair] if listed and len(pairs) == len(listed) else listed
    places = numbers(flat, "color_checker", CORNERS, 8)
    return list(zip(places[0::2], places[1::2]))
