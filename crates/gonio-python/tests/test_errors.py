"""Exceptions and warnings: messages of the library that name the file."""

from __future__ import annotations

import pickle

import numpy as np
import pytest

import gonio


def test_missing_files_raise_file_errors(tmp_path):
    with pytest.raises(FileNotFoundError, match=r"none.exr: cannot open: .*; check the path") as caught:
        gonio.infer(tmp_path / "none.exr")
    assert isinstance(caught.value, gonio.GonioError) and isinstance(caught.value, OSError)
    for read in (gonio.read_merl, gonio.read_image, gonio.read_model, gonio.read_normals):
        with pytest.raises(gonio.MissingFileError, match="none"):
            read(tmp_path / "none")
    with pytest.raises(gonio.FileError):
        gonio.write_image(tmp_path / "no" / "x.exr", np.ones((2, 2, 3)))
    again = pickle.loads(pickle.dumps(caught.value))
    assert type(again) is type(caught.value) and str(again) == str(caught.value)


def test_damaged_files_raise_errors(ball, tmp_path):
    (tmp_path / "half.exr").write_bytes(ball.read_bytes()[:1000])
    with pytest.raises(gonio.GonioError, match="half.exr: .*the file may be damaged") as caught:
        gonio.infer(tmp_path / "half.exr")
    assert not isinstance(caught.value, OSError)
    (tmp_path / "text.binary").write_text("hello")
    with pytest.raises(gonio.GonioError, match="text.binary"):
        gonio.read_merl(tmp_path / "text.binary")


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"grid": 17}, "grid 17: must be a power of two"),
        ({"grid": 4096}, "the range of the model's prior of light"),
        ({"clip": -1.0}, "clip -1.0: must be a positive radiance"),
        ({"color": "red"}, 'color "red": must be'),
        ({"color": "none", "light_color": (1, 1, 1)}, "light_color requires"),
        ({"light_color": (1, 0, 1)}, "three positive linear numbers"),
        ({"mask": np.ones((3, 4))}, "the mask is 4x3 pixels, but the photograph is 48x48"),
        ({"mask": np.full((48, 48), 2.0)}, "the mask: has values outside of 0 to 1"),
        ({"mask": np.ones((48, 48, 3))}, r"the mask: has the shape \(48, 48, 3\)"),
        ({"circle": (1, 2, 0)}, "circle: must be three numbers"),
        ({"shape": "blob", "circle": (1, 2, 3)}, "circle is the outline of a sphere"),
        ({"shape": "no-such-mesh.obj"}, "no-such-mesh.obj: cannot open"),
        ({"shape": np.ones((48, 48))}, r"the normals: have the shape \(48, 48\)"),
        ({"normals": np.zeros((48, 48, 3))}, "the image with the normals: "),
        ({"camera": {"fov": 3}}, "the camera: "),
        ({"depth_axis": -1.0, "shape": "ellipsoid"}, "depth_axis: must be a positive number"),
    ],
)
def test_rejects_invalid_options(small, options, message):
    with pytest.raises(gonio.GonioError, match=message):
        gonio.infer(small, **options)


@pytest.mark.parametrize(
    ("image", "message"),
    [
        (np.ones((4, 4, 2)), r"the image: has the shape \(4, 4, 2\)"),
        (np.ones(4), r"the image: has the shape \(4,\)"),
        (np.ones((4, 4), complex), "the image: has values of type complex128"),
        (np.ones((4, 4), np.int64), "the image: has values of type int64; use float32, uint8"),
        (np.ones((0, 4, 3), np.float32), "is empty"),
        (np.ones((40, 40, 3), np.float32), "the image: "),
    ],
)
def test_rejects_invalid_photographs(image, message):
    with pytest.raises(gonio.GonioError, match=message):
        gonio.infer(image)


def test_warnings_are_issued_and_stored(small):
    clipped = np.minimum(small, np.quantile(small[:, :, :3], 0.95))
    with pytest.warns(gonio.GonioWarning, match="pixels on the object, because they are clipped"):
        found = gonio.infer(clipped, clip=float(np.quantile(small[:, :, :3], 0.95)), grid=8, pictures=False)
    assert any("clipped" in said for said in found.warnings) and found.result["warnings"] == list(found.warnings)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"grid": "many"}, "grid: must be an integer, not 'many'"),
        ({"grid": 2.5}, "grid: must be an integer, not 2.5"),
        ({"grid": True}, "grid: must be an integer, not True"),
        ({"clip": "high"}, "clip: must be a number, not 'high'"),
        ({"linear": 1}, "linear: must be True or False, not 1"),
        ({"color": None}, 'color: must be "estimate", "median" or "none", not None'),
        ({"circle": 3}, "circle: must be three numbers, x, y and radius, in pixels, not 3"),
        ({"light_color": "red"}, "light_color: must be three positive linear numbers, not 'red'"),
        ({"layer": 3}, "layer: must be a string, not 3"),
        ({"camera": 3}, "camera: must be a file or a dictionary, not 3"),
        ({"model": 3}, "model: must be a file or a Model, not 3"),
        ({"progress": 3}, "progress: must be a function, not 3"),
        ({"shape": None}, 'shape: must be "sphere", '),
        ({"times": 3.0}, "times: must be the exposure time of each file in seconds, not 3.0"),
        ({"flat": np.ones((3, 3))}, "flat: must be an image file"),
    ],
)
def test_wrong_types_raise_type_errors(ball, options, message):
    with pytest.raises(TypeError) as caught:
        gonio.infer(ball, **options)
    assert str(caught.value).startswith(message)


def test_rejects_objects_that_are_not_images(small):
    with pytest.raises(TypeError):
        gonio.infer(small, nonsense=1)
    for image in (None, object(), {"a": 1}, [[1, 2], [3]]):
        with pytest.raises(gonio.GonioError, match="the image: .*(is not an image|cannot convert)"):
            gonio.infer(image)
    assert gonio.infer(small, grid=np.int64(8), clip=np.float32(1e9), pictures=np.bool_(False)).result["settings"]["grid"] == 8


def test_wrong_types_raise_type_errors_in_other_functions(tmp_path):
    brdf = gonio.Brdf.of(lambda h, d: 0.2 + 0 * h)
    for call, message in [
        (lambda: gonio.render(brdf, size="big"), "size: must be an integer, not 'big'"),
        (lambda: gonio.render(brdf, size=(1, 2, 3)), "size: must be one number of pixels"),
        (lambda: gonio.render(brdf, samples=1.5), "samples: must be an integer, not 1.5"),
        (lambda: gonio.studio_light("x"), "height: must be an integer, not 'x'"),
        (lambda: brdf.scaled("half"), "albedo: must be a number, not 'half'"),
        (lambda: brdf.export(tmp_path / "x", [3]), "to: must be names of gonio.EXPORTS, not "),
        (lambda: gonio.train_lighting(3), "lights: must be a folder or a list of maps, not 3"),
        (lambda: gonio.train_reflectance(3), "materials: must be a folder or a dictionary of BRDFs by name, not 3"),
        (lambda: gonio.light_probe(np.ones((9, 9)), reflectance="silver"), "reflectance: must be one number above 0 and at most 1, or three"),
        (lambda: gonio.read_image(tmp_path, layer=3), "layer: must be a string, not 3"),
    ]:
        with pytest.raises(TypeError) as caught:
            call()
        assert str(caught.value).startswith(message)


def test_messages_mention_no_options_or_internals_of_the_program(ball, small, tmp_path):
    """Checks that messages suggest Python arguments, not options of the program."""
    noise = np.random.default_rng(1).random((48, 48, 3))
    said = []
    for call in (
        lambda: gonio.infer(noise),
        lambda: gonio.infer(small, normals=np.ones((48, 48, 3))),
        lambda: gonio.infer([ball, ball]),
        lambda: gonio.infer([tmp_path / "a.png", tmp_path / "b.png"]),
        lambda: gonio.infer(ball, layer="diffuse"),
        lambda: gonio.infer(ball, black_level=3.0),
        lambda: gonio.infer(ball, times=[1.0]),
        lambda: gonio.infer(ball, response="linear", times=[1.0]),
        lambda: gonio.infer(small, camera={"projection": "fisheye"}),
        lambda: gonio.infer(small, "blob", pose={"position": 3}),
        lambda: gonio.infer(small, light=noise),
        lambda: gonio.infer(small, light=tmp_path / "none.hdr"),
        lambda: gonio.infer(small, starts=10**9, method="joint-map"),
        lambda: gonio.infer(small, seed=-1, method="joint-map"),
        lambda: gonio.infer(small, seed=2**80, method="joint-map"),
        lambda: gonio.infer_many([small], seed="x", method="joint-map")[0].error,
        lambda: gonio.infer_regions(small, circles=[(1, 2)]),
        lambda: gonio.light_probe(noise),
        lambda: gonio.light_probe(noise, rows=9),
        lambda: gonio.train_lighting([noise]),
        lambda: gonio.train_lighting(tmp_path),
        lambda: gonio.train_model(tmp_path / "a", tmp_path / "b"),
    ):
        try:
            said.append(str(call()))
        except (gonio.GonioError, TypeError) as error:
            said.append(str(error))
        else:
            assert isinstance(call(), Exception), "nothing was wrong"
    for message in said:
        assert "--" not in message and "extract" not in message and "gonio train" not in message, message
        assert "object at 0x" not in message and "Traceback" not in message, message
