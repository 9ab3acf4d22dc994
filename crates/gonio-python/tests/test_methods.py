"""Methods of the paper, depth and position maps, and other features of the program."""

from __future__ import annotations

import inspect
import os
import pickle
import re
import subprocess

import numpy as np
import pytest

import gonio
from conftest import small_ball

QUICK = {"grid": 8, "pictures": False}


@pytest.mark.parametrize("method", ["variational", "joint-map"])
def test_methods_of_the_paper_estimate_coefficients(small, method, tmp_path):
    found = gonio.infer(small, method=method, starts=1, seed=3, grid=8)
    assert isinstance(found, gonio.BasisPosterior) and found.method == method
    assert found.result["settings"]["seed"] == 3 and found.result["settings"]["starts"] == 1
    assert found.coefficients.shape == (10,) and found.brdf.albedo == pytest.approx(0.5, abs=1e-3)
    assert (found.coefficients_sd is None) == (method == "joint-map") and 0 < found.noise < 1
    assert found.light.shape == (128, 256, 3) and "summary" in found.pictures and "<img" in found._repr_html_()
    found.save(tmp_path / "out")
    assert {path.name for path in (tmp_path / "out").iterdir()} >= {"brdf.npz", "light.exr", "result.json", "summary.png"}
    assert not (tmp_path / "out" / "posterior.json").exists()
    again = pickle.loads(pickle.dumps(found))
    assert np.array_equal(again.brdf.table, found.brdf.table) and again.relight(size=8).shape == (8, 8, 4)
    assert method in repr(found)


@pytest.mark.slow
def test_the_setup_of_the_paper_and_a_known_light(small):
    paper = gonio.infer(small, method="paper", starts=1, pictures=False)
    assert paper.result["settings"]["paper"] is True and paper.method == "variational"
    light = gonio.studio_light(32)
    known = gonio.infer(small, light=light, method="known-light-basis", starts=1, pictures=False)
    assert known.method == "known-light-basis" and known.light.shape == light.shape


# Options of the program with another name in Python; None if the Python function does not need them.
ELSEWHERE = {
    "infer": {"no-align": "align", "mesh": "shape", "regions": "infer_regions", "no-shadows": "shadows", "paper": "method", "no-report": "report", "no-pictures": "pictures", "output": None},
    "check": {"no-align": "align", "mesh": "shape", "circle": "circles", "output": None},
    "merge": {"no-align": "align", "layer": None, "output": None, "save-response": None},
    "light": {"no-align": "align", "output": None},
    # Posterior.relight has draws and seed.
    "render": {"draws": None, "seed": None, "model": None, "mesh": "shape", "no-shadows": "shadows", "height": "size", "output": None},
    "combine": {"output": None},
    # Posterior.export has the number of draws; the model is that of the posterior.
    "export": {"output": "directory", "model": None},
}
GENERAL = {"json", "quiet", "verbose", "threads", "help"}


@pytest.mark.skipif("GONIO_CLI" not in os.environ, reason="GONIO_CLI is not set")
@pytest.mark.parametrize("command", ELSEWHERE)
def test_every_option_of_the_program_is_an_argument(command):
    text = subprocess.run([os.environ["GONIO_CLI"], command, "--help"], capture_output=True, text=True, check=True).stdout
    options = set(re.findall(r"^ +(?:-\w, )?--([a-z-]+)", text, re.MULTILINE)) - GENERAL
    assert len(options) > 1
    function = {"light": gonio.light_probe, "export": gonio.Brdf.export}.get(command) or getattr(gonio, command)
    arguments = set(inspect.signature(function).parameters)
    if command == "check":
        arguments |= set(inspect.signature(gonio.infer).parameters)
    for option in options:
        name = ELSEWHERE[command].get(option, option.replace("-", "_"))
        assert name is None or name in arguments or hasattr(gonio, name), f"gonio {command} --{option}"


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"method": "best"}, 'method "best": must be "learnt", "known-light", "variational", "joint-map", "known-light-basis" or "paper"'),
        ({"method": "known-light"}, 'method="known-light" requires a known light; specify it with light='),
        ({"method": "joint-map", "light": np.ones((8, 16))}, 'light is for method="known-light" and'),
        ({"starts": 2}, 'starts is for method="variational", "joint-map", "known-light-basis", "paper"; method "learnt" does not use it'),
        ({"method": "joint-map", "solver": "blocks"}, 'solver is for method="variational"; method "joint-map" does not use it'),
        ({"method": "variational", "solver": "quick"}, 'solver "quick": must be "blocks" or "printed"'),
        ({"method": "paper", "grid": 8}, 'grid is for method='),
        ({"method": "paper", "shape": "blob"}, 'method="paper" requires a sphere'),
        ({"align_light": "small"}, 'align_light is for method="known-light"'),
        ({"mirror_ball": (1, 2, 3), "method": "joint-map"}, 'mirror_ball is for method="known-light"'),
        ({"mirror_ball": (1, 2, 3), "light": np.ones((8, 16))}, "mirror_ball and light both describe the light"),
        ({"mirror_ball": (1, 2, 3), "absolute": True}, "absolute is for light"),
        ({"mirror_ball": (1, 2, 0)}, "mirror_ball: must be three numbers"),
        ({"mirror_reflectance": 0.5}, "mirror_reflectance requires mirror_ball"),
        ({"normals": np.ones((4, 4, 3)), "normals_error": 60}, "normals_error: must be an angle from 0 to 45 degrees"),
        ({"normals_error": 10}, "normals_error requires normals"),
        ({"normals": np.ones((4, 4, 3)), "normals_error": 10, "depth": np.ones((4, 4))}, "normals_error and a depth or position map"),
        ({"shape": "outline", "normals": np.ones((4, 4, 3))}, 'shape="outline" and normals both define the shape'),
    ],
)
def test_rejects_arguments_that_a_method_does_not_use(small, options, message):
    with pytest.raises(gonio.GonioError) as caught:
        gonio.infer(small, **options)
    assert str(caught.value).startswith(message)


def surface() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Returns normals of a ball, its depths from an orthographic camera, and its positions."""
    size, radius = 96, 46.0
    y, x = np.mgrid[:size, :size] + 0.5
    a, b = (x - size / 2) / radius, (size / 2 - y) / radius
    inside = a**2 + b**2 < 1
    z = np.sqrt(np.maximum(1 - a**2 - b**2, 0))
    normals = np.dstack([a, b, z]) * inside[..., None]
    depth = np.where(inside, 200 - radius * z, np.nan)
    # One pixel is one unit, and the camera is at the centre of the image.
    positions = np.dstack([x - size / 2, size / 2 - y, -depth])
    return normals, depth, np.where(inside[..., None], positions, 0)


def test_depth_and_position_maps_agree(tmp_path):
    picture = small_ball(96)
    normals, depth, positions = surface()
    by_depth = gonio.infer(picture, normals=normals, depth=depth, **QUICK)
    shape = by_depth.result["observations"]
    assert shape["shape"]["geometry"] == "the depths" and "visibility" in shape
    np.save(tmp_path / "depth.npy", np.nan_to_num(depth).astype(np.float32))
    by_file = gonio.infer(picture, normals=normals, depth=tmp_path / "depth.npy", **QUICK)
    assert np.allclose(by_file.brdf.table, by_depth.brdf.table, rtol=1e-2)
    codes = np.uint16(np.where(np.isfinite(depth), np.round(65535 * (depth - 100) / 200), 0))
    by_codes = gonio.infer(picture, normals=normals, depth=codes, depth_range=(100, 300), **QUICK)
    assert np.allclose(np.log(by_codes.brdf.table / by_depth.brdf.table)[:60, :60], 0, atol=0.05)
    camera = {"projection": "orthographic", "pixels_per_unit": np.float32(1)}
    by_places = gonio.infer(picture, normals=normals, positions=positions, camera=camera, **QUICK)
    assert by_places.result["observations"]["shape"]["geometry"] == "the positions"
    assert np.allclose(np.log(by_places.brdf.table / by_depth.brdf.table)[:60, :60], 0, atol=0.05)
    with pytest.raises(gonio.GonioError, match=r"the positions: .*; specify the camera with camera="):
        gonio.infer(picture, normals=normals, positions=positions, **QUICK)
    for options, message in [
        ({"normals": normals, "depth": codes}, r"specify their range with depth_range=\(near, far\)"),
        ({"normals": normals, "depth": depth[:50]}, "the depths: the depth map is"),
        ({"normals": normals, "depth": depth * np.nan}, "the depths: contain no surface"),
        ({"normals": normals, "depth": depth, "positions": positions}, "depth and positions both define the surface"),
        ({"normals": normals, "depth_range": (1, 2)}, "require depth="),
        ({"depth": depth}, "depth requires normals; specify them with normals="),
        ({"normals": normals, "depth": depth, "depth_range": (2, 2)}, "depth_range: must be two different numbers"),
    ]:
        with pytest.raises(gonio.GonioError, match=message):
            gonio.infer(picture, **options)


def test_normals_of_other_conventions_are_detected():
    picture, (normals, _, _) = small_ball(96), surface()
    want = gonio.infer(picture, normals=normals, **QUICK)
    # The DirectX convention, with blue as the first channel.
    odd = (normals * (1, -1, 1))[..., ::-1]
    with pytest.raises(gonio.GonioError, match=r'use normals_order="zyx" and normals_flip_y=True') as caught:
        gonio.infer(picture, normals=odd, **QUICK)
    assert "--" not in str(caught.value)
    found = gonio.infer(picture, normals=odd, normals_order="zyx", normals_flip_y=True, **QUICK)
    assert np.array_equal(found.brdf.table, want.brdf.table)
    with pytest.raises(gonio.GonioError, match='normals_order "xxz": must be "xyz"'):
        gonio.infer(picture, normals=odd, normals_order="xxz")


def test_check_detects_objects_and_clipped_pixels(small, ball):
    looked = gonio.check(ball)
    assert looked.outlines == ["ball, circle 128.0,128.0,126.0 (x, y, radius in pixels)"]
    assert looked.picture.dtype == np.uint8 and looked.result["width"] == 256 and "<img" in looked._repr_html_()
    clipped = np.minimum(small, np.quantile(small[..., :3], 0.95))
    with pytest.warns(gonio.GonioWarning, match="clipped"):
        again = gonio.check(clipped, clip=float(clipped[..., :3].max()))
    assert again.result["objects"][0]["report"]["clipped_pixels"] > 20
    two = np.concatenate([small, small], axis=1)
    assert len(gonio.check(two).outlines) == 2
    assert len(gonio.check(two, circles=[(24, 24, 22), (72, 24, 22)]).outlines) == 2
    with pytest.raises(gonio.GonioError, match=r"specify a mask with mask=.*circle=\(x, y, radius\)"):
        gonio.check(small[..., :3] * 0 + np.random.default_rng(1).random((48, 48, 3)))
    with pytest.raises(TypeError, match="check has no argument grid"):
        gonio.check(small, grid=8)


def test_results_do_not_depend_on_the_number_of_threads(small):
    want = gonio.infer(small, **QUICK)
    gonio.set_threads(1)
    try:
        alone = gonio.infer(small, **QUICK)
    finally:
        gonio.set_threads()
    assert np.array_equal(alone.brdf.table, want.brdf.table) and np.array_equal(alone.light, want.light)
    with pytest.raises(gonio.GonioError, match="threads 0: must be at least 1"):
        gonio.set_threads(0)


def test_renders_built_in_and_directional_lights(tmp_path):
    brdf = gonio.Brdf.of(lambda h, d: 0.2 + 0 * h)
    sky = gonio.render(brdf, "sky", size=32)
    # The sky is above.
    assert sky[:16, :, 2].sum() > sky[16:, :, 2].sum()
    (tmp_path / "lamps.txt").write_text("1 0 1  2 2 2\n")
    lamp = gonio.render(brdf, tmp_path / "lamps.txt", size=32)
    assert lamp[:, 16:, 0].sum() > 2 * lamp[:, :16, 0].sum()
