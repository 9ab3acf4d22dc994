"""References in the image: colour of the light and scale of the BRDF."""

from __future__ import annotations

import numpy as np
import pytest

import gonio
from conftest import small_ball

LIGHT = (1.5, 1.0, 0.55)
OPTIONS = {"circle": (24, 24, 22), "grid": 8, "pictures": False}


@pytest.fixture(scope="module")
def white() -> np.ndarray:
    """Radiance of a white surface that faces the camera."""
    ball = gonio.render(gonio.Brdf.of(lambda h, d: 1 / np.pi + 0 * h), gonio.studio_light(32), size=48)
    return ball[24, 24, :3] * np.array(LIGHT)


@pytest.fixture(scope="module")
def beside(white) -> np.ndarray:
    """A ball in coloured light with a patch of reflectance 0.9 beside it."""
    picture = np.zeros((48, 88, 3), np.float32)
    ball = small_ball(48, colour=LIGHT)
    picture[:, :48] = ball[:, :, :3]
    picture[10:40, 53:83] = 0.9 * white
    grain = np.random.default_rng(1).normal(1, 0.02, (48, 88, 1))
    return (picture * grain).astype(np.float32)


def test_a_patch_determines_colour_and_scale(beside, white):
    card = np.zeros((48, 88), np.float32)
    card[12:38, 55:81] = 1
    truth = gonio.Brdf.of(lambda h, d: 0.1 + 3.0 * np.exp(-((h / 0.15) ** 2))).albedo
    for options in ({"white": (68, 25, 12)}, {"grey_card": card, "reference_reflectance": 0.9}):
        found = gonio.infer(beside, **OPTIONS, **options)
        assert found.light_color[0] / found.light_color[1] == pytest.approx(white[0] / white[1], rel=0.02)
        scale = found.result["reference"]["scale"]
        low, high = scale["normal_albedo_interval_90"]
        assert low < truth < high and found.brdf.albedo == pytest.approx(scale["normal_albedo"], rel=0.01)
    alone = gonio.infer(beside, **OPTIONS, white=(68, 25, 12), reference_color_only=True)
    assert alone.result["reference"]["scale"] is None and alone.brdf.albedo == pytest.approx(0.5, abs=1e-3)
    assert gonio.check(beside, circle=(24, 24, 22), white=(68, 25, 12)).result["objects"][0]["reference"]["kind"] == "white patch"


def test_a_grey_ball_determines_colour_and_scale(beside, white):
    matte = gonio.render(gonio.Brdf.of(lambda h, d: 0.18 / np.pi + 0 * h), size=48)[:, :, :3] * np.array(LIGHT, np.float32)
    picture = np.concatenate([beside[:, :48], matte], axis=1)
    found = gonio.infer(picture, **OPTIONS, grey_ball=(72, 24, 22))
    assert found.result["reference"]["kind"] == "grey ball" and found.result["reference"]["residual"] < 0.1
    assert found.light_color[0] / found.light_color[1] == pytest.approx(white[0] / white[1], rel=0.05)
    assert found.result["reference"]["scale"]["normal_albedo"] == pytest.approx(found.brdf.albedo, rel=0.01)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"white": (68, 25, 0)}, "white: must be three numbers"),
        ({"white": (300, 25, 12)}, "outside the image of 88x48"),
        ({"white": (24, 24, 12)}, "lie on the object"),
        ({"white": (68, 25, 12), "light_color": (1, 1, 1)}, "the colour of the light and a reference are both specified"),
        ({"white": (68, 25, 12), "light": np.ones((8, 16)), "grid": None}, "the environment map and the reference both determine the colour"),
        ({"white": (68, 25, 12), "grey_card": np.ones((48, 88))}, "white and grey_card are references; use only one of them"),
        ({"white": (68, 25, 12), "reference_reflectance": 2}, "reference_reflectance 2.0: must be above 0"),
        ({"color_checker": True, "reference_reflectance": 0.5}, "reference_reflectance applies to white, grey_card and grey_ball"),
        ({"color_checker": True}, r"no 24-patch colour chart .*color_checker=\["),
        ({"color_checker": (1, 2, 3)}, "color_checker: must be True, or the centres"),
        ({"color_checker": [(50, 5), (85, 5), (85, 45), (50, 45)]}, "not those of a ColorChecker Classic"),
        ({"reference_color_only": True}, "reference_color_only requires"),
    ],
)
def test_rejects_unusable_references(beside, options, message):
    with pytest.raises(gonio.GonioError, match=message):
        gonio.infer(beside, **{**OPTIONS, **options})


def test_references_of_a_wrong_type_raise_type_errors(beside):
    for options in ({"white": 3}, {"color_checker": 3}, {"color_checker": "yes"}, {"reference_color_only": 1}):
        with pytest.raises(TypeError):
            gonio.infer(beside, **OPTIONS, **options)
