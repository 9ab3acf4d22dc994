"""Exceptions and warnings: the messages of the library, with the file named."""

from __future__ import annotations

import pickle

import numpy as np
import pytest

import gonio


def test_files_that_are_not_there(tmp_path):
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


def test_files_that_are_damaged(ball, tmp_path):
    (tmp_path / "half.exr").write_bytes(ball.read_bytes()[:1000])
    with pytest.raises(gonio.GonioError, match="half.exr: .*the file seems damaged") as caught:
        gonio.infer(tmp_path / "half.exr")
    assert not isinstance(caught.value, OSError)
    (tmp_path / "text.binary").write_text("hello")
    with pytest.raises(gonio.GonioError, match="text.binary"):
        gonio.read_merl(tmp_path / "text.binary")


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"grid": 17}, "grid 17: give a power of two"),
        ({"grid": 4096}, "which the model's prior of light covers"),
        ({"clip": -1.0}, "clip -1.0: give a positive radiance"),
        ({"color": "red"}, 'color "red": give'),
        ({"color": "none", "light_color": (1, 1, 1)}, "light_color serves"),
        ({"light_color": (1, 0, 1)}, "three positive numbers"),
        ({"mask": np.ones((3, 4))}, "the mask is 4x3, the photograph 48x48"),
        ({"mask": np.full((48, 48), 2.0)}, "the mask: has values outside of 0 to 1"),
        ({"mask": np.ones((48, 48, 3))}, r"the mask: has the shape \(48, 48, 3\)"),
        ({"circle": (1, 2, 0)}, "circle: give three numbers"),
        ({"shape": "blob", "circle": (1, 2, 3)}, "circle is the outline of a sphere"),
        ({"shape": "no-such-mesh.obj"}, "no-such-mesh.obj: cannot open"),
        ({"shape": np.ones((48, 48))}, r"the normals: have the shape \(48, 48\)"),
        ({"normals": np.zeros((48, 48, 3))}, "the image with the normals: "),
        ({"camera": {"fov": 3}}, "the camera: "),
        ({"depth_axis": -1.0, "shape": "ellipsoid"}, "depth_axis: give a positive number"),
    ],
)
def test_what_cannot_be_is_refused(small, options, message):
    with pytest.raises(gonio.GonioError, match=message):
        gonio.infer(small, **options)


@pytest.mark.parametrize(
    ("image", "message"),
    [
        (np.ones((4, 4, 2)), r"the image: has the shape \(4, 4, 2\)"),
        (np.ones(4), r"the image: has the shape \(4,\)"),
        (np.ones((4, 4), complex), "the image: has values of type complex128"),
        (np.ones((4, 4), np.int64), "the image: has values of type int64; give float32, or uint8"),
        (np.ones((0, 4, 3), np.float32), "is empty"),
        (np.ones((40, 40, 3), np.float32), "the image: "),
    ],
)
def test_what_is_no_photograph_is_refused(image, message):
    with pytest.raises(gonio.GonioError, match=message):
        gonio.infer(image)


def test_warnings_are_warnings_and_kept(small):
    clipped = np.minimum(small, np.quantile(small[:, :, :3], 0.95))
    with pytest.warns(gonio.GonioWarning, match="pixels on the object are clipped and left out"):
        found = gonio.infer(clipped, clip=float(np.quantile(small[:, :, :3], 0.95)))
    assert any("clipped" in said for said in found.warnings) and found.notes["warnings"] == list(found.warnings)


def test_types_that_cannot_be_are_type_errors(small):
    with pytest.raises(TypeError):
        gonio.infer(small, grid="many")
    with pytest.raises(TypeError):
        gonio.infer(small, nonsense=1)
