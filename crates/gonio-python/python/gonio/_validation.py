"""Checks of arguments."""

from __future__ import annotations

import operator
from collections.abc import Callable, Iterable, Mapping, Sequence
from inspect import signature
from typing import Any, cast

import numpy as np

from . import _gonio
from ._errors import GonioError


def integer(value: object, name: str, minimum: int = 0, maximum: int = 2**63 - 1) -> int:
    """Returns an integer within limits."""
    if isinstance(value, (bool, np.bool_)):
        raise TypeError(f"{name}: must be an integer, not {value!r}")
    try:
        number = operator.index(cast(Any, value))
    except TypeError:
        raise TypeError(f"{name}: must be an integer, not {shown(value)}") from None
    if number < minimum:
        raise GonioError(f"{name} {number}: must be at least {minimum}")
    if number > maximum:
        raise GonioError(f"{name} {number}: must be at most {maximum}")
    return number


def number(value: object, name: str) -> float:
    """Returns a finite number."""
    if isinstance(value, (str, bytes, bool, np.bool_)):
        raise TypeError(f"{name}: must be a number, not {shown(value)}")
    try:
        out = float(cast(Any, value))
    except (TypeError, ValueError):
        raise TypeError(f"{name}: must be a number, not {shown(value)}") from None
    if not np.isfinite(out):
        raise GonioError(f"{name} {out}: must be finite")
    return out


def positive(value: object, name: str, what: str = "number") -> float:
    """Returns a number above zero."""
    out = number(value, name)
    if not out > 0:
        raise GonioError(f"{name} {out}: must be a positive {what}")
    return out


def numbers(value: object, name: str, what: str, count: int | None = None) -> list[float]:
    """Returns a list of numbers; ``what`` describes them in messages."""
    if isinstance(value, (str, bytes)) or not isinstance(value, Iterable):
        raise TypeError(f"{name}: must be {what}, not {shown(value)}")
    out = [number(one, name) for one in value]
    if count is not None and len(out) != count:
        raise GonioError(f"{name}: must be {what}, not {len(out)} numbers")
    return out


def circle(value: object, name: str = "circle") -> tuple[float, float, float]:
    """Returns the outline of a ball: x, y and radius."""
    what = "three numbers, x, y and radius, in pixels"
    x, y, radius = numbers(value, name, what, 3)
    if not radius > 0:
        raise GonioError(f"{name}: must be {what}; the radius is {radius}")
    return x, y, radius


def reflectances(given: object, name: str) -> tuple[float, float, float]:
    """Returns the reflectance of each channel, above 0 and at most 1."""
    what = "one number above 0 and at most 1, or three"
    try:
        values = numbers(given, name, what) if np.ndim(given) else [number(given, name)] * 3  # type: ignore[arg-type]
    except TypeError:
        raise TypeError(f"{name}: must be {what}, not {shown(given)}") from None
    if len(values) == 1:
        values *= 3
    if len(values) != 3:
        raise GonioError(f"{name}: must be {what}")
    red, green, blue = values
    return red, green, blue


def flag(value: object, name: str) -> bool:
    """Returns a bool."""
    if not isinstance(value, (bool, np.bool_)):
        raise TypeError(f"{name}: must be True or False, not {shown(value)}")
    return bool(value)


def choice(value: object, name: str, among: Sequence[str]) -> str:
    """Returns one of several strings."""
    *others, last = [f'"{word}"' for word in among]
    offered = f"{', '.join(others)} or {last}"
    if not isinstance(value, str):
        raise TypeError(f"{name}: must be {offered}, not {shown(value)}")
    if value not in among:
        raise GonioError(f'{name} "{value}": must be {offered}')
    return value


def space(value: object, name: str) -> str:
    """Returns the name of a colour space."""
    return choice(value, name, _gonio.colour_spaces())


def space_if_given(value: object, name: str) -> str | None:
    """Returns the name of a colour space, or None."""
    return None if value is None else space(value, name)


def text(value: object, name: str) -> str:
    """Returns a string."""
    if not isinstance(value, str):
        raise TypeError(f"{name}: must be a string, not {shown(value)}")
    return value


def listener(value: object, name: str = "progress") -> None:
    """Checks that a value is a callable or None."""
    if value is not None and not callable(value):
        raise TypeError(f"{name}: must be a function, not {shown(value)}")


def check_arguments(options: Mapping[str, object], function: Callable[..., object], name: str) -> None:
    """Rejects arguments that a function does not have."""
    unknown = sorted(set(options) - set(defaults(function)))
    if unknown:
        raise TypeError(f"{name} has no argument {', '.join(unknown)}")


def defaults(function: Callable[..., object]) -> dict[str, Any]:
    """Returns the arguments of a function with their defaults."""
    return {name: parameter.default for name, parameter in signature(function).parameters.items()}


def shown(value: object) -> str:
    """Formats a value for a message: short, in one line."""
    shown = " ".join(repr(value).split())
    return shown if len(shown) <= 60 else f"{shown[:57]}..."
