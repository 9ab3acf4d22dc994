"""Fixtures of the tests: the sample photograph and the result of its inference."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import gonio

ROOT = Path(__file__).resolve().parents[3]
BALL = ROOT / "samples" / "ball.exr"


@pytest.fixture(scope="session")
def ball() -> Path:
    return BALL


@pytest.fixture(scope="session")
def photograph() -> np.ndarray:
    """The sample as an array."""
    return gonio.read_image(BALL)


@pytest.fixture(scope="session")
def found() -> gonio.Posterior:
    return gonio.infer(BALL)


def small_ball(size: int = 48, *, colour: tuple[float, float, float] = (1.0, 1.0, 1.0)) -> np.ndarray:
    """Returns a small rendered ball with alpha, for fast inference."""
    brdf = gonio.Brdf.of(lambda h, d: 0.1 + 3.0 * np.exp(-((h / 0.15) ** 2)))
    light = gonio.studio_light(32) * np.array(colour, np.float32)
    return gonio.render(brdf, light, size=size)


@pytest.fixture(scope="session")
def small() -> np.ndarray:
    return small_ball()


@pytest.fixture(autouse=True)
def names_of_examples(request, monkeypatch, tmp_path):
    """Defines the names that the examples of the package documentation use."""
    if isinstance(request.node, pytest.DoctestItem):
        monkeypatch.chdir(ROOT)
        request.node.dtest.globs.update(gonio=gonio, np=np, folder=tmp_path, found=request.getfixturevalue("found"))
