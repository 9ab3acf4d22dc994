"""Figures, notebooks and result folders."""

from __future__ import annotations

import base64
import io
import json
import subprocess
import sys
from html.parser import HTMLParser

import numpy as np
import pytest

import gonio
from conftest import small_ball


class Balanced(HTMLParser):
    """Fails if tags are not closed in order."""

    def __init__(self) -> None:
        super().__init__()
        self.open: list[str] = []
        self.images: list[str] = []

    def handle_starttag(self, tag, attrs):
        if tag == "img":
            self.images.append(dict(attrs)["src"])
        else:
            self.open.append(tag)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag


def test_notebooks_display_pictures_and_numbers(found):
    page = found._repr_html_()
    parser = Balanced()
    parser.feed(page)
    assert not parser.open and len(parser.images) == 1
    head, data = parser.images[0].split(",", 1)
    assert head == "data:image/png;base64" and base64.b64decode(data).startswith(b"\x89PNG")
    assert found.materials[0][0] in page and len(page) < 500_000


def test_figures_are_drawn(found):
    figure = found.plot()
    file = io.BytesIO()
    figure.savefig(file, format="png", dpi=50)
    assert file.getvalue().startswith(b"\x89PNG")
    titles = [axes.get_title() for axes in figure.axes]
    assert {"photograph", "reproduction", "estimated light"} <= set(titles)
    assert "image/png" in figure._repr_mimebundle_() if hasattr(figure, "_repr_mimebundle_") else True


def test_only_plot_requires_matplotlib():
    code = (
        "import sys; sys.modules['matplotlib'] = None\n"
        "import gonio, gonio._figure\n"
        "try: gonio._figure.plot({}, None, None, None, None)\n"
        "except ImportError as error: print(error)\n"
    )
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert run.stdout.strip() == "plot requires matplotlib; install it with: pip install matplotlib, or gonio[plot]"


def test_result_folders_contain_all_files(found, tmp_path):
    found.save(tmp_path / "a" / "ball")
    names = {path.name for path in (tmp_path / "a" / "ball").iterdir()}
    assert names == {
        "brdf.npz",
        "light.exr",
        "posterior.json",
        "relit.png",
        "result.json",
        "summary.png",
        "uncertainty.png",
    }
    assert np.allclose(gonio.read_brdf(tmp_path / "a" / "ball" / "brdf.npz").table, found.brdf.table, rtol=1e-5)
    arrays = np.load(tmp_path / "a" / "ball" / "brdf.npz")
    assert arrays["half_angle"].shape == arrays["difference_angle"].shape == (90,)
    assert np.allclose(np.degrees(arrays["difference_angle"]), np.arange(90), atol=1e-4)
    assert np.array_equal(arrays["brdf"], found.brdf.table)
    assert np.allclose(arrays["levels"], [0.05, 0.25, 0.75, 0.95])
    assert np.array_equal(arrays["luminance_quantiles"], found.luminance_quantiles)
    assert np.array_equal(arrays["quantiles"], found.rgb_quantiles)
    assert np.array_equal(gonio.read_image(tmp_path / "a" / "ball" / "light.exr"), found.light)
    assert json.loads((tmp_path / "a" / "ball" / "result.json").read_text()) == found.result
    found.save(tmp_path / "a" / "ball")


def test_two_paints_have_a_map_of_albedo(tmp_path):
    size = 72
    small = small_ball(size)
    stripes = np.where(np.arange(size) // (size // 6) % 2, 1.0, 0.2)[:, None, None]
    matte = np.where(small[:, :, 3:] > 0, np.sqrt(np.clip(1 - np.mgrid[-1 : 1 : size * 1j, -1 : 1 : size * 1j] ** 2, 0, 1)).prod(0)[..., None], 0)
    plain, striped = (np.concatenate([np.repeat(ball, 3, 2), small[:, :, 3:]], 2).astype(np.float32) for ball in (matte, matte * stripes))
    assert gonio.infer(plain, grid=8, pictures=False, force=True).albedo_map is None
    found = gonio.infer(striped, grid=8, pictures=False, force=True)
    albedo = found.albedo_map
    assert albedo is not None and albedo.shape == (size, size, 3)
    found.save(tmp_path)
    assert np.array_equal(gonio.read_image(tmp_path / "albedo.exr")[..., :3], albedo)


def test_a_report_is_written_on_request(small, tmp_path):
    found = gonio.infer(small, grid=8, report=True)
    found.save(tmp_path / "out")
    assert (tmp_path / "out" / "report.html").read_text().startswith("<!DOCTYPE html>")


def test_pictures_can_be_omitted(small, tmp_path):
    found = gonio.infer(small, grid=8, pictures=False)
    assert found.pictures == {} and "<img" not in found._repr_html_()
    found.save(tmp_path / "out")
    assert not (tmp_path / "out" / "summary.png").exists()
    with pytest.raises(gonio.GonioError, match="pictures=True"):
        found.plot()


def test_all_pictures_are_drawn(found):
    assert {"photograph", "observed", "reproduction", "residual", "light", "relit", "summary", "uncertainty"} <= set(found.pictures)
    for picture in found.pictures.values():
        assert picture.dtype == np.uint8 and picture.ndim == 3 and picture.shape[2] == 3
