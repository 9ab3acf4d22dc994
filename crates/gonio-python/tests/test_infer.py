"""Inference: files and arrays, shapes, numbers, progress, interruption."""

from __future__ import annotations

import json
import os
import pickle
import signal
import subprocess
import sys
import threading
import time

import numpy as np
import pytest

import gonio
from conftest import small_ball

QUICK = {"grid": 8, "pictures": False}


def test_the_sample_is_a_glossy_ball(found):
    assert found.brdf.table.shape == (90, 90, 3) and found.brdf.table.dtype == np.float32
    assert found.luminance_quantiles.shape == (4, 90, 90) and found.undetermined.shape == (90, 90)
    assert found.undetermined.dtype == np.bool_
    assert found.light.shape == (128, 256, 3) and found.light.min() >= 0
    assert (np.diff(found.luminance_quantiles, axis=0) >= 0).all()
    assert found.peak_height[0] <= found.peak_height[1] <= found.peak_height[2]
    assert found.brdf.albedo == pytest.approx(0.5, abs=1e-3)
    assert found.misfit < 0.2
    assert found.result["format"] == "gonio-result" and found.result["method"] == "learnt"
    assert found.result["posterior"]["undetermined"] == found.undetermined_share
    assert found.result["posterior"]["scatter"] == found.scatter < 0.5
    assert found.ends[0].table.shape == found.ends[1].table.shape == (90, 90, 3)
    assert "gonio.Posterior 'ball'" in repr(found)


@pytest.mark.skipif("GONIO_CLI" not in os.environ, reason="GONIO_CLI is not set")
def test_the_program_gives_the_same_result(found, ball, tmp_path):
    subprocess.run([os.environ["GONIO_CLI"], "infer", ball, "-o", tmp_path / "cli", "--no-report"], check=True, stdout=subprocess.DEVNULL)
    found.save(tmp_path / "python")
    names = {path.name for path in (tmp_path / "cli").iterdir()}
    assert {path.name for path in (tmp_path / "python").iterdir()} == names
    for name in names - {"result.json", "summary.png"}:
        assert (tmp_path / "cli" / name).read_bytes() == (tmp_path / "python" / name).read_bytes(), name
    ours, theirs = (json.loads((tmp_path / side / "result.json").read_text()) for side in ("python", "cli"))
    for section in ("posterior", "light", "residual", "colour", "settings", "observations", "model"):
        assert ours[section] == theirs[section], section


def test_arrays_and_files_give_the_same_result(found, photograph):
    again = gonio.infer(photograph, pictures=False)
    assert np.array_equal(again.brdf.table, found.brdf.table)
    assert np.array_equal(again.light, found.light)


def test_results_are_not_copied(found):
    for array in (found.luminance_quantiles, found.light, found.luminance, found.undetermined, found.brdf.table):
        # Rust owns the memory; NumPy references the object that frees it.
        assert not array.flags.owndata and array.base is not None and array.flags.writeable
    assert np.shares_memory(np.asarray(found.brdf), found.brdf.table)


def test_arguments_are_not_copied(small):
    """Checks that an image of hundreds of megabytes is not copied before it is rejected."""
    import resource

    rgb = np.ascontiguousarray(np.broadcast_to(np.float32(1), (6000, 6000, 3)))
    mask = np.zeros((5, 5), np.float32)
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    with pytest.raises(gonio.GonioError, match="the mask is 5x5 pixels, but the photograph is 6000x6000"):
        gonio.infer(rgb, mask=mask)
    grown = (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before) * 1024
    assert grown < 0.25 * rgb.nbytes


def test_arrays_and_masks_are_converted(small):
    rgb, alpha = small[:, :, :3], np.ascontiguousarray(small[:, :, 3])
    want = gonio.infer(small, **QUICK)
    doubles = gonio.infer(rgb.astype(np.float64)[::1], mask=alpha, **QUICK)
    assert np.allclose(doubles.brdf.table, want.brdf.table, rtol=1e-4)
    fortran = gonio.infer(np.asfortranarray(rgb), mask=alpha > 0.5, **QUICK)
    assert np.isfinite(fortran.brdf.table).all()
    grey = gonio.infer(rgb.mean(axis=2), mask=alpha, **QUICK)
    assert np.allclose(grey.brdf.table[:, :, 0], grey.brdf.table[:, :, 2])
    coded = np.round(255 * np.clip(rgb / rgb.max(), 0, 1)).astype(np.uint8)
    with pytest.warns(gonio.GonioWarning, match="8-bit image, decoded as sRGB"):
        gonio.infer(coded, mask=alpha, **QUICK)
    assert not any("sRGB" in said for said in gonio.infer(coded, mask=alpha, linear=True, **QUICK).warnings)


def test_shapes_by_normals_and_outline_agree():
    small = small_ball(96)
    height, width = small.shape[:2]
    y, x = np.mgrid[:height, :width] + 0.5
    a, b = (x - width / 2) / (width / 2 - 2), (height / 2 - y) / (height / 2 - 2)
    inside = a**2 + b**2 < 1
    normals = np.dstack([a, b, np.sqrt(np.maximum(1 - a**2 - b**2, 0))]) * inside[:, :, None]
    by_normals = gonio.infer(small, normals, **QUICK)
    by_outline = gonio.infer(small, "sphere", **QUICK)
    assert by_normals.peak_height[1] == pytest.approx(by_outline.peak_height[1], rel=0.3)
    assert by_outline.result["observations"]["shape"]["kind"] == "sphere"
    circle = gonio.infer(small, circle=(width / 2, height / 2, width / 2 - 2), **QUICK)
    assert circle.result["observations"]["shape"]["circle"]["radius"] == pytest.approx(width / 2 - 2)
    ellipsoid = gonio.infer(small, "ellipsoid", depth_axis=width / 2 - 2, **QUICK)
    assert not any("depth_axis" in said for said in ellipsoid.warnings)


def test_accepts_meshes_in_memory_and_by_name():
    brdf = gonio.Brdf.of(lambda h, d: 0.2 + np.exp(-((h / 0.3) ** 2)))
    picture = gonio.render(brdf, gonio.studio_light(16), "blob", 40)
    stages = []
    by_name = gonio.infer(picture, "blob", **QUICK, progress=lambda stage, _: stages.append(stage))
    assert "shadows" in stages and by_name.result["observations"]["shape"]["mesh"] == "blob"
    t = np.linspace(0, np.pi, 24)
    s = np.linspace(0, 2 * np.pi, 49)[:-1]
    vertices = np.array([[np.sin(u) * np.cos(v), np.cos(u), np.sin(u) * np.sin(v)] for u in t for v in s])
    index = lambda i, k: i * 48 + k % 48
    faces = [[index(i, k), index(i, k + 1), index(i + 1, k)] for i in range(23) for k in range(48)]
    faces += [[index(i, k + 1), index(i + 1, k + 1), index(i + 1, k)] for i in range(23) for k in range(48)]
    ball = gonio.render(brdf, gonio.studio_light(16), (vertices, np.array(faces)), 40)
    found = gonio.infer(ball, (vertices, np.array(faces)), **QUICK, shadows=False)
    assert found.result["observations"]["shape"]["mesh"] == "the mesh"
    with pytest.raises(gonio.GonioError, match="the mesh: triangle 0 refers to vertex 9"):
        gonio.render(brdf, shape=(vertices[:3], np.array([[0, 1, 9]])))


def test_progress_is_reported_in_this_thread_and_in_order(small):
    told, threads = [], set()

    def progress(stage: str, fraction: float) -> None:
        told.append((stage, fraction))
        threads.add(threading.get_ident())

    gonio.infer(small, grid=8, progress=progress)
    assert threads == {threading.get_ident()}
    stages = list(dict.fromkeys(stage for stage, _ in told))
    assert stages == ["reading", "posterior", "transfer", "light", "colour", "drawing"]
    for stage in stages:
        fractions = [x for name, x in told if name == stage]
        assert fractions == sorted(fractions) and all(0 <= x <= 1 for x in fractions)


def test_an_exception_of_progress_stops_the_inference(small):
    def progress(stage: str, fraction: float) -> None:
        raise RuntimeError(f"enough of {stage}")

    with pytest.raises(RuntimeError, match="enough of reading"):
        gonio.infer(small, progress=progress)
    # The next inference works.
    assert gonio.infer(small, **QUICK).misfit < 1


def test_other_python_threads_run_during_inference(ball):
    counted, done = 0, threading.Event()

    def count() -> None:
        nonlocal counted
        while not done.is_set():
            counted += 1
            time.sleep(0.001)

    thread = threading.Thread(target=count)
    thread.start()
    started = time.perf_counter()
    gonio.infer(ball, pictures=False)
    seconds = time.perf_counter() - started
    done.set()
    thread.join()
    # An idle thread would count about 1000 per second.
    assert counted > 30 * seconds


def test_ctrl_c_stops_the_inference(ball):
    code = (
        "import gonio, signal, time\n"
        # Tests that run in the background may ignore SIGINT.
        "signal.signal(signal.SIGINT, signal.default_int_handler)\n"
        "try:\n"
        "    print('go', flush=True)\n"
        f"    gonio.infer({str(ball)!r})\n"
        "    print('done', flush=True)\n"
        "except KeyboardInterrupt:\n"
        "    print('interrupted', time.time(), flush=True)\n"
    )
    process = subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, text=True)
    assert process.stdout is not None and process.stdout.readline() == "go\n"
    time.sleep(0.5)
    process.send_signal(signal.SIGINT)
    sent = time.time()
    said, at = process.stdout.readline().split()
    assert said == "interrupted" and float(at) - sent < 1.0
    assert process.wait(timeout=30) == 0


def test_posteriors_can_be_pickled(found):
    travelled = pickle.loads(pickle.dumps(found, protocol=5))
    assert np.array_equal(travelled.brdf.table, found.brdf.table)
    assert np.array_equal(travelled.luminance_draws, found.luminance_draws)
    assert travelled.result == found.result and travelled.model is gonio.Model.embedded()
    assert travelled.relight(size=16).shape == (16, 16, 4)


def test_draws_depend_only_on_the_seed(found):
    assert found.luminance_draws.shape == (64, 90, 90)
    assert np.array_equal(found.draw(5, seed=3), found.draw(5, seed=3))
    assert not np.array_equal(found.draw(5, seed=3), found.draw(5, seed=4))
    # About half of the draws are in the 50 % interval.
    cell = found.luminance_draws[:, 5, 5]
    assert 0.2 < np.mean((cell >= found.luminance_quantiles[1, 5, 5]) & (cell <= found.luminance_quantiles[2, 5, 5])) <= 1
