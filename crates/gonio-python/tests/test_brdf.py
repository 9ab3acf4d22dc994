"""BRDFs, rendering, files and exports."""

from __future__ import annotations

import json

import numpy as np
import pytest

import gonio


def lambertian() -> gonio.Brdf:
    return gonio.Brdf.of(lambda h, d: np.full_like(h, 1 / np.pi), name="white")


def test_white_furnace():
    picture = gonio.render(lambertian(), np.ones((16, 32, 3), np.float32), size=32, tolerance=0.02)
    assert picture.shape == (32, 32, 4) and picture.dtype == np.float32
    whole = picture[:, :, 3] > 0.999
    assert whole.any() and np.allclose(picture[whole][:, :3], 1, atol=6e-3)
    assert lambertian().albedo == pytest.approx(1, abs=1e-4)
    # A convex mesh has the same radiance; a bowl is darker inside because of occlusion.
    bowl = gonio.render(lambertian(), np.ones((16, 32, 3)), "bowl", 24, tolerance=0.05)
    lit = gonio.render(lambertian(), np.ones((16, 32, 3)), "bowl", 24, shadows=False, tolerance=0.05)
    inside = bowl[:, :, 3] > 0.999
    assert bowl[inside][:, 0].min() < 0.7 and np.allclose(lit[inside][:, 0], 1, atol=0.02)


def test_light_maps_follow_the_axis_convention():
    light = np.full((16, 32, 3), 1e-3, np.float32)
    light[2:6, 18:30] = 1
    picture = gonio.render(lambertian(), light, size=32)[:, :, 0]
    # The light is above and to the right.
    assert picture[:16, 16:].sum() > 2 * picture[16:, :16].sum()


def test_evaluation_interpolates_between_samples():
    brdf = gonio.Brdf.of(lambda h, d: 1 + h)
    h = gonio.THETA_H[[3, 40]]
    assert np.allclose(brdf.eval(h, 0.2), np.repeat(1 + h[:, None], 3, axis=1), rtol=1e-6)
    assert brdf.eval(0.3, np.zeros((2, 4))).shape == (2, 4, 3)
    assert np.asarray(brdf) is brdf.table and np.asarray(brdf, np.float64).dtype == np.float64
    assert brdf.luminance.shape == (90, 90) and np.allclose(brdf.luminance, brdf.table[:, :, 0], rtol=1e-5)
    assert brdf.scaled(0.25).albedo == pytest.approx(0.25, rel=1e-4)
    assert "<img" in brdf._repr_html_() and "gonio.Brdf" in repr(brdf)


def test_tables_are_written_and_read(tmp_path):
    brdf = gonio.Brdf.of(lambda h, d: np.dstack([0.1 + h, 0.2 + d, 0.3 + h * d]))
    gonio.write_merl(tmp_path / "x.binary", brdf)
    back = gonio.read_merl(tmp_path / "x.binary")
    assert np.allclose(back.table, brdf.table, rtol=1e-5) and back.full is not None and back.name == "x"
    assert back.full.shape == (3, 90, 90, 180) and np.allclose(back.full[0, 5, 6].max(), brdf.table[5, 6, 0], rtol=1e-5)
    back.write(tmp_path / "y.binary")
    assert (tmp_path / "y.binary").read_bytes() == (tmp_path / "x.binary").read_bytes()
    brdf.write(tmp_path / "x.bsdf")
    # RGL files have other samples.
    assert np.median(np.abs(gonio.read_brdf(tmp_path / "x.bsdf").table / brdf.table - 1)) < 0.01
    brdf.write(tmp_path / "x.csv")
    np.testing.assert_allclose(gonio.read_brdf(tmp_path / "x.csv").table, brdf.table, rtol=1e-5)
    with pytest.raises(gonio.GonioError, match="x.bsdf"):
        gonio.read_merl(tmp_path / "x.bsdf")
    with pytest.raises(gonio.GonioError, match="not the name of a BRDF file"):
        brdf.write(tmp_path / "x.txt")


@pytest.mark.parametrize("table", [np.ones((3, 90, 90)), np.ones(8100), np.ones((90, 90, 4))])
def test_rejects_tables_of_other_shapes(table):
    with pytest.raises(gonio.GonioError, match="a BRDF must have the shape"):
        gonio.Brdf(table)


def test_rejects_invalid_values():
    table = np.ones((90, 90, 3))
    table[3, 4, 1] = -1
    with pytest.raises(gonio.GonioError, match=r"negative or not finite at \[3, 4\]"):
        gonio.render(table, size=8)
    for light, message in [(np.ones((4, 4, 3)), "twice as wide"), (np.zeros((4, 8, 3)), "black"), (np.ones(3), "has the shape")]:
        with pytest.raises(gonio.GonioError, match=message):
            gonio.render(lambertian(), light, size=8)


def test_pictures_are_written_and_read(tmp_path, small):
    gonio.write_image(tmp_path / "x.exr", small)
    assert np.array_equal(gonio.read_image(tmp_path / "x.exr"), small)
    gonio.write_image(tmp_path / "x.pfm", small[:, :, :3])
    assert np.array_equal(gonio.read_image(tmp_path / "x.pfm"), small[:, :, :3])
    with pytest.raises(gonio.GonioError, match="must be an .exr"):
        gonio.write_image(tmp_path / "x.jpg", small)


def test_exports_all_targets_of_the_program(found, tmp_path):
    told = []
    summary = found.export(tmp_path / "all", progress=lambda stage, x: told.append(x))
    assert set(summary["exports"]) == set(gonio.EXPORTS) - {"merl", "merl-grey"} and told[-1] == 1
    assert json.loads((tmp_path / "all" / "export.json").read_text()) == summary
    for entry in summary["exports"].values():
        assert all((tmp_path / "all" / name).stat().st_size > 0 for name in entry["files"])
    some = found.export(tmp_path / "some", ["mitsuba", "merl"], name="mine", albedo=0.3)
    assert set(some["exports"]) == {"mitsuba", "merl"} and some["name"] == "mine" and some["albedo"] == pytest.approx(0.3)
    assert gonio.read_merl(tmp_path / "some" / "brdf.binary").albedo == pytest.approx(0.3, rel=1e-3)
    with pytest.raises(gonio.GonioError, match='to "word": must be among merl, '):
        found.export(tmp_path / "wrong", "word")
    assert not (tmp_path / "wrong").exists()


def test_fitted_parameters_have_intervals(found, tmp_path):
    entry = found.export(tmp_path / "with", ["mitsuba", "merl"], draws=8)["exports"]
    low, high = entry["mitsuba"]["intervals"]["roughness"]
    assert 0 <= low < high <= 1 and "intervals" not in entry["merl"]
    assert len(entry["mitsuba"]["intervals"]["base_color"]) == 3
    assert "intervals" not in found.export(tmp_path / "without", "mitsuba", draws=0)["exports"]["mitsuba"]
    assert "intervals" not in found.brdf.export(tmp_path / "plain", "mitsuba")["exports"]["mitsuba"]
    with pytest.raises(gonio.GonioError, match="shape"):
        found.brdf.export(tmp_path / "wrong", "mitsuba", draws=np.ones((2, 90)))
    assert not (tmp_path / "wrong").exists()


def test_exported_scenes_use_the_light_of_the_photograph(found, tmp_path):
    assert found.export(tmp_path / "lit", "mitsuba")["light"] == "of the results"
    lit = gonio.read_image(tmp_path / "lit" / "light.exr")[..., :3]
    assert np.allclose(lit, found.light, rtol=2e-3, atol=1e-4)
    assert found.brdf.export(tmp_path / "studio", "blender")["light"] == "studio"
    found.brdf.export(tmp_path / "given", "blender", light=np.full((8, 16), 0.25))
    assert np.allclose(gonio.read_image(tmp_path / "given" / "light.exr"), 0.25)
    with pytest.raises(gonio.GonioError, match="the light"):
        found.brdf.export(tmp_path / "wrong", "blender", light=np.ones((8, 8, 3)))
