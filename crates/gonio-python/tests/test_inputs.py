"""Inputs for images: files, bytes, exposures, PIL images, xarray's arrays, tensors."""

from __future__ import annotations

import io

import numpy as np
import pytest
from PIL import Image

import gonio

QUICK = {"grid": 8, "pictures": False}


class Tensor:
    """A tensor like those of PyTorch, with channels first: it has the DLPack protocol and no ``__array__``.

    PyTorch is too large a dependency for the tests.
    """

    def __init__(self, array: np.ndarray) -> None:
        self.array = array

    def detach(self) -> Tensor:
        return self

    def cpu(self) -> Tensor:
        return self

    def __dlpack__(self, **options):
        return self.array.__dlpack__(**options)

    def __dlpack_device__(self):
        return self.array.__dlpack_device__()


class OnGpu:
    """A tensor that NumPy cannot read."""

    def __dlpack__(self, **_):
        raise BufferError("on a GPU")

    def __dlpack_device__(self):
        return (2, 0)


@pytest.fixture(scope="module")
def want(small) -> gonio.Posterior:
    return gonio.infer(small, **QUICK)


def same(found: gonio.Posterior, want: gonio.Posterior) -> bool:
    return np.array_equal(found.brdf.table, want.brdf.table)


def test_accepts_tensors(small, want):
    first = Tensor(np.ascontiguousarray(np.moveaxis(small, -1, 0)))
    assert same(gonio.infer(first, **QUICK), want)
    assert same(gonio.infer(Tensor(small), **QUICK), want)
    rgb, alpha = Tensor(np.ascontiguousarray(small[..., :3])), Tensor(np.ascontiguousarray(small[None, ..., 3]))
    assert np.isfinite(gonio.infer(rgb, mask=alpha, **QUICK).peak_height).all()
    with pytest.raises(gonio.GonioError, match="the image: NumPy cannot read the tensor: on a GPU"):
        gonio.infer(OnGpu())


def test_accepts_xarray_arrays(small, want):
    xarray = pytest.importorskip("xarray")
    named = xarray.DataArray(small, dims=("y", "x", "channel"))
    assert same(gonio.infer(named, **QUICK), want)
    assert same(gonio.infer(named.transpose("channel", "x", "y"), **QUICK), want)
    light = xarray.DataArray(gonio.studio_light(16), dims=("lat", "lon", "rgb")).transpose("rgb", "lat", "lon")
    assert gonio.render(np.full((90, 90), 0.2), light, size=16).shape == (16, 16, 4)


def test_accepts_pil_images(small):
    coded = gonio.tonemapped(small[..., :3])
    mask = Image.fromarray(small[..., 3] > 0.5)
    want = gonio.infer(coded, mask=small[..., 3] > 0.5, linear=True, **QUICK)
    assert same(gonio.infer(Image.fromarray(coded), mask=mask, linear=True, **QUICK), want)
    with_alpha = np.dstack([coded, np.uint8(255) * (small[..., 3] > 0.5)])
    cmyk = Image.fromarray(coded).convert("CMYK")
    near = gonio.infer(cmyk, mask=mask, linear=True, **QUICK)
    assert near.peak_height[1] == pytest.approx(want.peak_height[1], rel=0.2)
    palette = Image.fromarray(with_alpha).convert("RGBA").quantize(200)
    assert palette.mode == "P"
    assert np.isfinite(gonio.infer(palette, mask=mask, linear=True, **QUICK).peak_height).all()
    labels = Image.fromarray(np.uint8(small[..., 3] > 0.5)).convert("P")
    assert list(gonio.infer_regions(small[..., :3], labels, **QUICK)) == ["1"]


def test_regions_warn_of_the_photograph(small, tmp_path):
    file = tmp_path / "ball.png"
    Image.fromarray(gonio.tonemapped(small[..., :3])).save(file)
    with pytest.warns(gonio.GonioWarning, match="8-bit image, decoded as sRGB"):
        gonio.infer_regions(file, np.uint8(small[..., 3] > 0.5), **QUICK)


def test_accepts_bytes_and_open_files(ball, found):
    data = ball.read_bytes()
    assert same(gonio.infer(data, pictures=False), found)
    assert same(gonio.infer(io.BytesIO(data), pictures=False), found)
    with open(ball, "rb") as file:
        assert same(gonio.infer(file, pictures=False), found)
    with pytest.raises(gonio.GonioError, match="the image: "):
        gonio.infer(data[:100])
    with pytest.raises(gonio.GonioError, match='is a text file; open it with mode "rb"'):
        gonio.infer(io.StringIO("hello"))


@pytest.fixture(scope="module")
def exposures(tmp_path_factory):
    """Three linear 16-bit exposures of a ball on grey, with clipped highlights."""
    picture = gonio.render(gonio.Brdf.of(lambda h, d: 0.1 + 3.0 * np.exp(-((h / 0.15) ** 2))), gonio.studio_light(32), size=96)
    radiance = picture[..., :3].mean(axis=2) + 0.02 * (1 - picture[..., 3])
    folder, files = tmp_path_factory.mktemp("exposures"), []
    for name, times in [("a", 1.0), ("b", 4.0), ("c", 16.0)]:
        codes = np.uint16(np.round(65535 * np.clip(times * radiance / radiance.max(), 0, 1)))
        files.append(folder / f"{name}.png")
        Image.fromarray(codes).save(files[-1])
    return files, [1, 4, 16], radiance, picture


def test_exposures_are_merged(exposures, tmp_path):
    files, times, radiance, picture = exposures
    merged = gonio.merge(files, times=times, response="linear")
    assert merged.picture.shape == (96, 96, 3) and merged.origin.shape == (96, 96) and merged.origin.dtype == np.int16
    known = merged.origin >= 0
    assert known.mean() > 0.9 and merged.response.shape == (3, 65536)
    ratio = merged.picture[known][:, 0] / radiance[known]
    assert np.allclose(ratio, np.median(ratio), rtol=0.01)
    assert merged.result["exposures"] == [1 / 16, 1 / 4, 1] and merged.result["recovered_response"] is False
    merged.write(tmp_path / "hdr.exr")
    merged.write_response(tmp_path / "camera.csv")
    again = gonio.merge(files, times=times, response=tmp_path / "camera.csv")
    assert np.allclose(again.picture, merged.picture, rtol=1e-4)
    circle = (48.0, 48.0, 46.0)
    at_once = gonio.infer(files, times=times, response="linear", circle=circle, **QUICK)
    by_hand = gonio.infer(merged.picture, clip=merged.clip_level, circle=circle, **QUICK)
    from_file = gonio.infer(tmp_path / "hdr.exr", circle=circle, **QUICK)
    assert same(at_once, by_hand) and same(from_file, by_hand)
    assert at_once.brdf.name == "a" and at_once.result["bracket"]["exposures"] == [1 / 16, 1 / 4, 1]


def test_shifted_exposures_are_aligned(exposures, tmp_path):
    files, times, _, _ = exposures
    # The ball has a uniform background, so that the shift moves no border into the picture.
    shifted = np.roll(np.asarray(Image.open(files[1])), 3, axis=1)
    Image.fromarray(shifted).save(tmp_path / "shifted.png")
    bracket = [files[0], tmp_path / "shifted.png", files[2]]
    merged = gonio.merge(bracket, times=times, response="linear")
    shifts = [correction["shift"] for correction in merged.result["report"]["corrections"]]
    assert shifts == [[0, 0], [3, 0], [0, 0]]
    plain = gonio.merge(bracket, times=times, response="linear", align=False, trust_times=True)
    assert all(correction["shift"] == [0, 0] for correction in plain.result["report"]["corrections"])
    with pytest.raises(TypeError, match="align"):
        gonio.merge(bracket, times=times, align="no")


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"times": [1, 2]}, "exposure"),
        ({"times": [1, -2, 3]}, "times: must be the exposure time of each file in seconds, all above zero"),
        ({"times": [1, 4, 16], "response": "linear", "black_level": 1e6}, "black level 1000000"),
        ({"times": [1, 4, 16], "response": "linear", "linear": True}, "linear=True and response"),
        ({}, r"specify them with times=\[\.\.\.\]"),
    ],
)
def test_rejects_inconsistent_exposures(exposures, options, message):
    with pytest.raises(gonio.GonioError, match=message):
        gonio.infer(exposures[0], **options)


def test_rejects_invalid_lists_of_exposures(small, exposures):
    with pytest.raises(gonio.GonioError, match="the image: is an empty list"):
        gonio.infer([])
    with pytest.raises(gonio.GonioError, match="exposures must be files, but array"):
        gonio.infer([exposures[0][0], small])
    with pytest.raises(TypeError, match="images: must be a list of the files of exposures, not 'a.jpg'"):
        gonio.merge("a.jpg")
    for option, value in [("times", [1.0]), ("times", np.array([0.1, 0.2])), ("align", False), ("trust_times", True)]:
        with pytest.raises(gonio.GonioError, match=f"{option} applies only to files, but the image is an array"):
            gonio.infer(small, **{option: value})


# ACEScg to linear Rec. 709, from the ACES reference implementation (Bradford adaptation).
ACES_CG = np.array(
    [
        [1.70505099, -0.62179212, -0.08325887],
        [-0.13025642, 1.14080474, -0.01054832],
        [-0.02400336, -0.12896898, 1.15297233],
    ]
)


def test_colour_spaces_of_arrays_and_files_are_converted(small, want, tmp_path):
    aces = small.copy()
    aces[..., :3] = small[..., :3] @ np.linalg.inv(ACES_CG).T
    found = gonio.infer(aces, colorspace="acescg", output_colorspace="acescg", **QUICK)
    assert np.allclose(found.brdf.table, want.brdf.table, rtol=1e-3, atol=1e-6)
    assert found.result["colorspace"] == {"input": "acescg", "source": "given", "clamped_pixels": 0, "output": "acescg"}

    # A file that states its space is converted.
    gonio.write_image(tmp_path / "stated.exr", aces, colorspace="ap1")
    assert np.allclose(gonio.read_image(tmp_path / "stated.exr"), small, atol=1e-5)
    gonio.write_image(tmp_path / "unstated.exr", aces)
    assert np.allclose(gonio.read_image(tmp_path / "unstated.exr", colorspace="acescg"), small, atol=1e-5)
    with pytest.warns(gonio.GonioWarning, match="the specified space rec2020 has no effect"):
        gonio.read_image(tmp_path / "stated.exr", colorspace="rec2020")

    # Files saved in another space are read as Rec. 709.
    found.save(tmp_path / "out")
    assert np.allclose(gonio.read_brdf(tmp_path / "out" / "brdf.npz").table, found.brdf.table, rtol=1e-4, atol=1e-6)
    found.brdf.export(tmp_path / "export", ["merl"], output_colorspace="rec2020")
    assert np.allclose(gonio.read_brdf(tmp_path / "export" / "brdf.binary").table, found.brdf.table, rtol=1e-4, atol=1e-6)
    for name in ("cmyk", ""):
        with pytest.raises(gonio.GonioError, match=f'colorspace "{name}": must be "rec709", "srgb"'):
            gonio.infer(small, colorspace=name)
