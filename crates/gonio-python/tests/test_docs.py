"""Tests that `help` shows documentation for everything public."""

from __future__ import annotations

import dataclasses
import inspect

import pytest

import gonio

PUBLIC = [name for name in gonio.__all__ if not name.startswith("__")]


def arguments(function) -> list[str]:
    return [name for name in inspect.signature(function).parameters if name not in ("self", "cls")]


def check(function, name: str) -> None:
    """Checks that all arguments and the return value are documented."""
    text = inspect.getdoc(function) or ""
    assert text, f"{name} has no documentation"
    own = arguments(function)
    parameters = text.partition("Parameters\n----------\n")[2].partition("\n\nReturns\n")[0]
    missing = [argument for argument in own if argument not in parameters]
    assert not missing, f"{name}: {missing} are not among its parameters"
    if getattr(function, "__annotations__", {}).get("return", "None") != "None":
        assert "Returns\n-------\n" in text, f"{name} does not document its return value"


@pytest.mark.parametrize("name", PUBLIC)
def test_everything_public_is_documented(name):
    thing = getattr(gonio, name)
    if not callable(thing):
        # Values cannot have docstrings, so the docstring of the package lists them.
        assert name in (gonio.__doc__ or "")
    elif not inspect.isclass(thing):
        check(thing, name)
    else:
        # Ignore the inherited docstring of object.
        text = thing.__dict__.get("__doc__") or ""
        assert text, f"{name} has no documentation"
        for member, value in inspect.getmembers(thing):
            if member.startswith("_") or issubclass(thing, Exception):
                continue
            if isinstance(value, property) or inspect.isgetsetdescriptor(value):
                assert inspect.getdoc(value), f"{name}.{member} has no documentation"
            elif callable(value):
                check(value, f"{name}.{member}")
        fields = [field.name for field in dataclasses.fields(thing)] if dataclasses.is_dataclass(thing) else []
        for field in fields:
            assert field.startswith("_") or f"\n    {field} : " in text, f"{name}.{field} is not among its attributes"


def test_attributes_of_values_are_documented(found, small):
    """Checks that attributes of objects are properties or documented in the class."""
    failed = gonio.infer_many(["none.exr"])[0]
    for value in (found, found.brdf, failed, gonio.check(small)):
        names = [name for name in vars(value) if not name.startswith("_")]
        text = type(value).__doc__ or ""
        assert all(f"\n    {name} : " in text for name in names), type(value)


def test_help_shows_attributes(capsys):
    help(gonio.Posterior)
    shown = capsys.readouterr().out
    for name in ("peak_height", "ggx_alpha", "gloss_units", "luminance_quantiles", "light", "rgb_draws", "warnings"):
        assert f"\n |  {name}\n |      " in shown, name
