"""Results for other packages: xarray, ArviZ, Mitsuba."""

from __future__ import annotations

import subprocess
import sys

import numpy as np
import pytest

import gonio


def test_converts_to_xarray_datasets(found):
    data = found.to_xarray()
    assert dict(data.sizes) == {
        "theta_h": 90, "theta_d": 90, "channel": 3, "quantile": 4, "draw": 64, "bound": 3, "angle": 2, "elevation": 128, "azimuth": 256
    }
    assert np.array_equal(data.brdf, found.brdf.table) and np.allclose(data.theta_h, gonio.THETA_H)
    assert np.array_equal(data.luminance_quantiles.sel(quantile=0.95), found.luminance_quantiles[3])
    assert np.array_equal(data.gloss_units.sel(angle=60), found.gloss_units[60])
    # Light from above is in the first row, light from the right in the right half.
    assert data.elevation[0] > 89 and data.azimuth[-1] > 179 and np.allclose(data.light, found.light)
    table = found.brdf.to_xarray()
    assert table.name == "ball" and table.attrs["albedo"] == found.brdf.albedo
    assert np.array_equal(gonio.Brdf(table).table, found.brdf.table)


def test_converts_to_arviz(found):
    import arviz

    data = found.to_inference_data(80, seed=5)
    assert data.posterior.sizes["chain"] == 1 and data.posterior.sizes["draw"] == 80
    assert np.array_equal(data.posterior.brdf[0], found.draw(80, seed=5))
    table = arviz.summary(data, var_names=["peak_height", "ggx_alpha", "gloss_units_60"], kind="stats")
    assert list(table.index) == ["peak_height", "ggx_alpha", "gloss_units_60"]
    # The interval of the draws is close to that of the posterior.
    low, high = np.quantile(data.posterior.ggx_alpha, [0.05, 0.95])
    assert 0.5 < low / found.ggx_alpha[0] < 2 and 0.5 < high / found.ggx_alpha[2] < 2


def test_converts_to_arviz_1(found):
    """ArviZ 1.0 and later returns an xarray tree."""
    code = (
        "import sys; sys.modules['arviz'] = None\n"
        "import gonio, numpy as np\n"
        "from gonio._convert import inference_data\n"
        "tree = inference_data(np.full((3, 90, 90), 0.2, np.float32))\n"
        "print(type(tree).__name__, dict(tree.posterior.sizes), tree.posterior.ggx_alpha.values.tolist())\n"
    )
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert run.stdout == "DataTree {'chain': 1, 'draw': 3, 'theta_h': 90, 'theta_d': 90} [[1.0, 1.0, 1.0]]\n"


def test_mitsuba_bsdfs_have_the_values_of_the_table():
    import mitsuba

    brdf = gonio.Brdf.of(lambda h, d: np.dstack([0.1 + np.exp(-((h / 0.3) ** 2)), 0.2 + 0 * h, 0.3 + 0.1 * d]), name="test")
    if mitsuba.variant() is None:
        with pytest.raises(gonio.GonioError, match="call mitsuba.set_variant"):
            brdf.to_mitsuba()
    mitsuba.set_variant("scalar_rgb")
    bsdf = brdf.to_mitsuba()
    interaction, context = mitsuba.SurfaceInteraction3f(), mitsuba.BSDFContext()
    for wi, wo in [((0.5, 0, 1), (-0.5, 0, 1)), ((0.6, 0.2, 1), (0.1, -0.3, 1)), ((0, 0, 1), (0.8, 0, 1))]:
        wi, wo = (np.array(v) / np.linalg.norm(v) for v in (wi, wo))
        half = (wi + wo) / np.linalg.norm(wi + wo)
        interaction.wi = mitsuba.Vector3f(*wi)
        seen = np.array(bsdf.eval(context, interaction, mitsuba.Vector3f(*wo))).ravel() / wo[2]
        assert seen == pytest.approx(brdf.eval(np.arccos(half[2]), np.arccos(wi @ half)), rel=0.03)
    principled = brdf.to_mitsuba("principled")
    assert "Principled" in type(principled).__name__ or "principled" in str(principled).lower()
    with pytest.raises(gonio.GonioError, match='plugin "glass": must be "measured" or "principled"'):
        brdf.to_mitsuba("glass")


@pytest.mark.parametrize(
    ("hidden", "call", "message"),
    [
        ("xarray", "to_xarray()", "to_xarray requires xarray; install it with: pip install xarray"),
        ("mitsuba", "to_mitsuba()", "to_mitsuba requires mitsuba; install it with: pip install mitsuba"),
    ],
)
def test_errors_name_missing_packages(hidden, call, message):
    code = (
        f"import sys; sys.modules[{hidden!r}] = None\n"
        "import gonio\n"
        f"try: gonio.Brdf.of(lambda h, d: 0.2 + 0 * h).{call}\n"
        "except ImportError as error: print(error)\n"
    )
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert run.stdout.strip() == message


def test_optional_packages_are_imported_on_demand_only():
    code = "import gonio, sys; print([name for name in ('xarray', 'arviz', 'mitsuba', 'PIL', 'torch', 'matplotlib') if name in sys.modules])"
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert run.stdout.strip() == "[]"


def test_colours_do_not_change_the_luminance_of_samples(found):
    rgb = found.rgb_draws
    assert rgb.shape == (64, 90, 90, 3) and rgb.dtype == np.float32 and rgb.min() >= 0
    # The colours are those of the estimate and do not change the luminance.
    assert np.allclose(rgb @ np.float32([0.2126, 0.7152, 0.0722]), found.luminance_draws, rtol=1e-3)
    assert found.draw(3, seed=2, rgb=True).shape == (3, 90, 90, 3)
    body = found.brdf.table[60, 20] / found.luminance[60, 20]
    assert np.allclose(np.median(rgb[:, 60, 20] / found.luminance_draws[:, 60, 20, None], axis=0), body, rtol=0.05)
    assert found.colors.shape == (2, 3) and np.allclose(found.colors @ [0.2126, 0.7152, 0.0722], 1, rtol=1e-3)


def test_highlight_of_a_brdf_agrees_with_its_posterior(found):
    """Checks that the highlight of a BRDF agrees with its posterior and scales correctly."""
    brdf = found.brdf
    assert found.peak_height[0] / 2 < brdf.peak_height < 2 * found.peak_height[2]
    assert found.ggx_alpha[0] / 2 < brdf.ggx_alpha < 2 * found.ggx_alpha[2]
    assert set(brdf.gloss_units) == set(found.gloss_units) == {20, 60}
    assert brdf.scaled(0.25).gloss_units[60] == pytest.approx(brdf.gloss_units[60] / 2, rel=1e-3)
    assert brdf.scaled(0.25).ggx_alpha == pytest.approx(brdf.ggx_alpha) and brdf.scaled(0.25).peak_height == pytest.approx(brdf.peak_height)
    assert (found.roughness**2 == pytest.approx(found.ggx_alpha)) and found.result["posterior"]["highlight"]["ggx_alpha"]["50"] == found.ggx_alpha[1]
    chalk = gonio.Brdf.of(lambda h, d: 0.2 + 0 * h)
    assert chalk.ggx_alpha == 1 and chalk.peak_height == pytest.approx(1)
    grey = brdf.grey().table
    assert np.array_equal(grey[..., 0], grey[..., 1]) and np.allclose(grey[..., 0], brdf.luminance)


def test_draws_show_the_uncertainty_of_a_rendering(found):
    pictures = found.relight(size=24, draws=40, seed=2)
    assert pictures.shape == (40, 24, 24, 4) and np.array_equal(found.relight(size=24, draws=40, seed=2), pictures)
    inside = pictures[0, ..., 3] > 0.99
    low, middle, high = np.quantile(pictures[:, inside, :3], [0.05, 0.5, 0.95], axis=0)
    estimate = found.relight(size=24)[inside, :3]
    assert np.linalg.norm(middle - estimate) < 0.3 * np.linalg.norm(estimate)
    assert np.mean((low <= estimate) & (estimate <= high)) > 0.8 and np.median(high / low) > 1.05
    with pytest.raises(gonio.GonioError, match="draws"):
        found.relight(size=24, draws=-1)


def test_draws_with_errors_have_the_quantiles_of_the_result(found):
    draws, plain = found.draw(400, errors=True), found.draw(400)
    trusted = np.s_[:60, :60]
    wanted = np.log(found.luminance_quantiles[3] / found.luminance_quantiles[0])[trusted]

    def width(tables):
        # The intervals are relative to the mean logarithm of each table.
        logs = np.log(tables) - np.log(tables[:, :80, :80]).mean(axis=(1, 2), keepdims=True)
        low, high = np.quantile(logs, [0.05, 0.95], axis=0)
        return np.median((high - low)[trusted] / wanted)

    assert 0.8 < width(draws) < 1.2 and width(plain) < width(draws)


def test_compare_agrees_with_the_program(found, tmp_path):
    """Compares a result with another one, in memory and from folders, as ``gonio compare`` does."""
    other = gonio.infer(found.relight("sky", size=64), grid=8, pictures=False)
    comparison = gonio.compare({"studio": found, "sky": other})
    (pair,) = comparison.pairs
    assert pair.names == ("studio", "sky") and pair.agreement in ("agree", "overlap") and 0 < pair.distance < 1
    assert pair.sentence.startswith("studio and sky ") and "roughness" in pair.sentence
    assert comparison.page.startswith("<!DOCTYPE html>") and "A sphere of the material of studio" in comparison.page
    found.save(tmp_path / "studio")
    other.save(tmp_path / "sky")
    (saved,) = gonio.compare([tmp_path / "studio", tmp_path / "sky"]).pairs
    assert saved.sentence == pair.sentence and saved.distance == pytest.approx(pair.distance, rel=1e-5)
    comparison.write(tmp_path / "page.html")
    assert (tmp_path / "page.html").read_text() == comparison.page
    with pytest.raises(gonio.GonioError, match="fewer than two results"):
        gonio.compare([found])
    with pytest.raises(gonio.FileError, match="result.json"):
        gonio.compare([found, tmp_path])
    with pytest.raises(gonio.GonioError, match="must be a list or a dictionary"):
        gonio.compare(found)
