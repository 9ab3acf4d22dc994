"""Light probes from photographs of a mirror ball."""

from __future__ import annotations

import numpy as np
import pytest

import gonio


def room(d: np.ndarray) -> np.ndarray:
    """Returns light from directions of shape (..., 3): wavy walls, a red lamp on the right, a blue one above."""
    x, y, z = np.moveaxis(d, -1, 0)
    wall = 1.7 + np.sin(7 * x + 3 * y - 2 * z) + 0.5 * np.cos(5 * z - 4 * x)
    light = np.repeat(wall[..., None], 3, axis=-1)
    # The lamps have no constant value, which would be detected as clipped.
    light[x > 0.99] += (40, 0, 0)
    light[y > 0.99] += (0, 0, 40)
    return light


def photograph(yaw: float = 0.0, size: int = 160, radius: float = 70.0) -> np.ndarray:
    """Returns an image with alpha of a mirror ball, from a camera rotated around it by ``yaw`` degrees."""
    at = (np.arange(size) + 0.5 - size / 2) / radius
    x, y = np.meshgrid(at, -at)
    inside = x**2 + y**2 < 1
    z = np.sqrt(np.maximum(1 - x**2 - y**2, 0))
    n = np.dstack([x, y, z])
    d = 2 * z[..., None] * n - np.array([0, 0, 1])
    turn = np.radians(yaw)
    d = np.dstack([np.cos(turn) * d[..., 0] + np.sin(turn) * d[..., 2], d[..., 1], np.cos(turn) * d[..., 2] - np.sin(turn) * d[..., 0]])
    return np.dstack([0.6 * room(d) * inside[..., None], inside]).astype(np.float32)


def at(light: np.ndarray, d: tuple[float, float, float]) -> np.ndarray:
    x, y, z = np.array(d) / np.linalg.norm(d)
    rows = light.shape[0]
    column = int((np.arctan2(x, -z) / (2 * np.pi) + 0.5) * 2 * rows) % (2 * rows)
    return light[min(int(np.arccos(y) / np.pi * rows), rows - 1), column]


def test_the_probe_recovers_the_light(tmp_path):
    told = []
    found = gonio.light_probe(photograph(), reflectance=0.6, progress=lambda *stage: told.append(stage))
    assert found.light.shape == (64, 128, 3) and found.coverage.shape == (64, 128) and found.picture.dtype == np.uint8
    assert at(found.light, (1, 0, 0))[0] > 30 and at(found.light, (0, 1, 0))[2] > 30
    wall = at(found.light, (-0.5, -0.4, 0.7))
    d = np.array([-0.5, -0.4, 0.7])
    assert wall == pytest.approx(room(d[None] / np.linalg.norm(d))[0], rel=0.1)
    assert found.result["unseen"] == pytest.approx(1 - np.average(found.coverage, weights=weights(64), axis=None), abs=1e-3)
    assert found.warnings == [] and told and "<img" in found._repr_html_()
    found.write(tmp_path / "probe.exr")
    assert np.array_equal(gonio.read_image(tmp_path / "probe.exr"), found.light)
    # The probe can be used as a light.
    gonio.render(gonio.Brdf.of(lambda h, d: np.full_like(h, 0.3)), found.light, size=16)


def weights(rows: int) -> np.ndarray:
    """Returns the solid angles of the texels."""
    return np.repeat(np.sin((np.arange(rows) + 0.5) / rows * np.pi)[:, None], 2 * rows, axis=1)


def test_two_views_are_merged():
    found = gonio.light_probe(photograph(), second=photograph(70.0), reflectance=(0.6, 0.6, 0.6), rows=32)
    views = found.result["views"]
    assert views["azimuth_degrees"] == pytest.approx(70, abs=0.5) and views["estimated"] and found.result["unseen"] < 1e-6
    with pytest.warns(gonio.GonioWarning, match="the image and the second image: the two views differ"):
        gonio.light_probe(photograph(), second=photograph(70.0), second_azimuth=-80.0)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"rows": 100}, "100 rows: must be a power of two"),
        ({"rows": -1}, "rows -1: must be a power of two"),
        ({"reflectance": 1.5}, "invalid reflectance 1.5"),
        ({"reflectance": (1, 1)}, "reflectance: must be one number"),
        ({"circle": (1, 2, 0)}, "circle: must be three numbers"),
        ({"second_azimuth": 3.0}, "specify it with second="),
        ({"mask": np.ones((3, 4))}, "the mask is 4x3 pixels, but the photograph is 160x160"),
        ({"second": np.random.default_rng(1).random((80, 80, 3))}, "the second image: .*; specify a mask with second_mask=, or specify the outline"),
        ({"clip": -1.0}, "clip -1.0"),
    ],
)
def test_rejects_invalid_options(options, message):
    with pytest.raises(gonio.GonioError, match=message):
        gonio.light_probe(photograph(), **options)


def test_missing_files_raise_file_errors(tmp_path):
    with pytest.raises(FileNotFoundError, match="none.exr"):
        gonio.light_probe(tmp_path / "none.exr")


def test_a_mirror_ball_in_the_photograph_gives_the_light():
    light = gonio.studio_light(64)
    brdf = gonio.Brdf.of(lambda h, d: 0.1 + 3.0 * np.exp(-((h / 0.15) ** 2)))
    ball = gonio.render(brdf, light, size=160)
    x, y = np.meshgrid((np.arange(160) - 79.5) / 70, (79.5 - np.arange(160)) / 70)
    inside = x**2 + y**2 < 0.999
    normal = np.dstack([x, y, np.sqrt(np.maximum(1 - x**2 - y**2, 0))])
    seen = 2 * normal[..., 2:] * normal - np.array([0, 0, 1])
    mirror = np.zeros((160, 160, 3), np.float32)
    for row, column in zip(*np.nonzero(inside), strict=True):
        mirror[row, column] = 0.6 * at(light, tuple(seen[row, column]))
    both = np.concatenate([mirror, np.asarray(ball)[..., :3]], axis=1)
    found = gonio.infer(both, mirror_ball=(80, 80, 70), mirror_reflectance=0.6, pictures=False)
    assert found.result["method"] == "known-light" and found.result["reflectance"]["absolute"]
    # The ball reflects 60 % at every angle, but real mirrors reflect more at the rim.
    assert found.brdf.albedo == pytest.approx(brdf.albedo, rel=0.15)
    assert found.result["observations"]["shape"]["circle"]["x"] == pytest.approx(240, abs=0.5)
    # Without the ball's reflectance, the BRDF is relative.
    assert gonio.infer(both, mirror_ball=(80, 80, 70), pictures=False).brdf.albedo == pytest.approx(0.5, rel=1e-3)
