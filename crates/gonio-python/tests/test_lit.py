"""Known light, and several photographs of one material."""

from __future__ import annotations

import pickle

import numpy as np
import pytest

import gonio


def lit_ball(peak: float, light: np.ndarray, size: int = 64) -> np.ndarray:
    brdf = gonio.Brdf.of(lambda h, d: 0.1 + peak * np.exp(-((h / 0.15) ** 2)))
    return gonio.render(brdf, light, size=size)


@pytest.fixture(scope="module")
def lights() -> list[np.ndarray]:
    studio = gonio.studio_light(32)
    return [studio, np.roll(studio, 20, axis=1), np.roll(studio, 45, axis=1)]


@pytest.fixture(scope="module")
def seen(lights) -> list[gonio.Posterior]:
    return [gonio.infer(lit_ball(3.0, light), light=light, pictures=False) for light in lights]


def test_a_known_light_determines_material_and_albedo(seen, lights):
    found = seen[0]
    assert found.result["method"] == "known-light" and found.misfit < 0.05
    assert found.light.shape == lights[0].shape
    truth = gonio.Brdf.of(lambda h, d: 0.1 + 3.0 * np.exp(-((h / 0.15) ** 2)))
    assert found.result["exposure"]["albedo"] == pytest.approx(truth.albedo, rel=0.05)
    absolute = gonio.infer(lit_ball(3.0, lights[0]), light=lights[0], pictures=False, absolute=True)
    assert absolute.brdf.albedo == pytest.approx(truth.albedo, rel=0.05)
    assert np.median(absolute.luminance_draws[:, 45, 20]) == pytest.approx(absolute.luminance[45, 20], rel=0.2)


def test_photographs_of_one_material_combine(seen, tmp_path):
    together = gonio.combine(seen)
    assert len(together.agreement) == 3 and min(together.agreement) > 0
    width = lambda found: np.log(found.luminance_quantiles[3] / found.luminance_quantiles[0])[:70, :70].mean()
    assert width(together) <= min(map(width, seen))
    seen[0].save(tmp_path / "a")
    seen[1].save(tmp_path / "b")
    mixed = gonio.combine([tmp_path / "a", tmp_path / "b", seen[2]])
    assert np.array_equal(mixed.brdf.table, together.brdf.table)
    together.save(tmp_path / "both")
    assert (tmp_path / "both" / "combined.png").exists() and (tmp_path / "both" / "posterior.json").exists()
    again = pickle.loads(pickle.dumps(together))
    assert np.array_equal(again.luminance_draws, together.luminance_draws)


def test_rejects_contradictory_photographs(seen, lights, tmp_path):
    other = gonio.infer(lit_ball(0.2, lights[1]), light=lights[1], pictures=False)
    with pytest.raises(gonio.GonioError, match="does not show the same material"):
        gonio.combine([seen[0], other, seen[2]])
    with pytest.raises(gonio.GonioError, match="same photograph"):
        gonio.combine([seen[0], seen[0]])
    with pytest.raises(gonio.GonioError, match="at least two"):
        gonio.combine([seen[0]])
    with pytest.raises(gonio.GonioError, match="posterior.json"):
        gonio.combine([tmp_path, seen[0]])


def test_rejects_invalid_lights(lights):
    ball = lit_ball(3.0, lights[0])
    with pytest.raises(gonio.GonioError, match="twice as wide as high"):
        gonio.infer(ball, light=np.ones((32, 32, 3), np.float32))
    with pytest.raises(gonio.GonioError, match="align_light"):
        gonio.infer(ball, light=lights[0], align_light="sideways")
    with pytest.raises(gonio.GonioError, match="absolute"):
        gonio.infer(ball, absolute=True)


def test_infers_two_balls_separately(lights):
    dull, shiny = (lit_ball(peak, lights[0], 48) for peak in (0.3, 8.0))
    both = np.concatenate([dull, 0.5 * shiny * [1, 1, 1, 2]], axis=1).astype(np.float32)
    found = gonio.infer_regions(both, grid=16, pictures=False)
    assert sorted(found) == ["1", "2"]
    assert max(posterior.result["relative_albedo"] for posterior in found.values()) == 1
    labels = np.zeros(both.shape[:2], np.uint8)
    labels[:, :48], labels[:, 48:] = 1, 2
    with pytest.raises(gonio.GonioError, match="of the same size"):
        gonio.infer_regions(both, labels[:, :60])
    with pytest.raises(gonio.GonioError, match="must be integers"):
        gonio.infer_regions(both, labels.astype(float))
