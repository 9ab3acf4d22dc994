"""Many photographs: threads and a Dask cluster."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

import numpy as np
import pytest

import gonio

QUICK = {"grid": 8, "pictures": False}


def items(small, ball):
    return [
        small,
        "none.exr",
        {"image": small, "grid": 16},
        {"image": small, "grid": 5},
        {"image": small, "nonsense": 1},
        {"mask": None},
    ]


def check(results, small):
    assert [bool(result) for result in results] == [True, False, True, False, False, False]
    want = gonio.infer(small, **QUICK)
    assert np.array_equal(results[0].brdf.table, want.brdf.table)
    assert results[2].result["settings"]["grid"] == 16
    missing, grid, argument, image = (results[i] for i in (1, 3, 4, 5))
    assert missing.name == "none.exr" and isinstance(missing.error, FileNotFoundError) and missing.index == 1
    assert isinstance(grid.error, gonio.GonioError) and "grid 5" in repr(grid) and grid.name == "item 3"
    assert isinstance(argument.error, TypeError) and isinstance(image.error, TypeError)


def test_inference_continues_after_failures(small, ball):
    told = []
    results = gonio.infer_many(items(small, ball), progress=lambda done, of: told.append((done, of)), **QUICK)
    check(results, small)
    assert told == [(i, 6) for i in range(1, 7)]


def test_an_exception_of_progress_stops_all_inferences(small):
    def progress(done: int, of: int) -> None:
        raise RuntimeError("enough")

    before = threading.active_count()
    with pytest.raises(RuntimeError, match="enough"):
        gonio.infer_many([small] * 20, progress=progress, workers=1, **QUICK)
    assert threading.active_count() <= before + 1


def test_arguments_are_checked_before_inference(small):
    with pytest.raises(TypeError, match="infer has no argument nonsense"):
        gonio.infer_many([small], nonsense=1)
    with pytest.raises(TypeError, match=r"items: 'photo.exr' is one string; use a list of photographs: \['photo.exr'\]"):
        gonio.infer_many("photo.exr")
    with pytest.raises(TypeError, match="is one path"):
        gonio.infer_many(Path("photo.exr"))
    for one, what in [(small, "image"), ({"image": small}, "dictionary"), (b"\x76\x2f", "bytes")]:
        with pytest.raises(TypeError, match=f"is one {what}"):
            gonio.infer_many(one)
    stack = np.stack([small, small])
    assert [result.name for result in gonio.infer_many(np.array(["a.exr", "b.exr"]))] == ["a.exr", "b.exr"]
    assert all(gonio.infer_many(stack, **QUICK))
    with pytest.raises(TypeError, match="must be a list of photographs, not 3"):
        gonio.infer_many(3)
    with pytest.raises(gonio.GonioError, match="workers 0"):
        gonio.infer_many([small], workers=0)
    assert gonio.infer_many([]) == []


def test_a_cluster_gives_the_same_results(small, ball):
    distributed = pytest.importorskip("distributed")
    with (
        distributed.LocalCluster(processes=True, n_workers=2, threads_per_worker=1, dashboard_address=None) as cluster,
        distributed.Client(cluster) as client,
    ):
        told = []
        results = gonio.infer_many(items(small, ball), client, progress=lambda done, of: told.append((done, of)), **QUICK)
        check(results, small)
        assert told == [(i, 6) for i in range(1, 7)]
        # Results from the cluster are complete.
        assert results[0].luminance_draws.shape == (64, 90, 90)
        assert results[0].relight(size=8).shape == (8, 8, 4)
        # The inferences ran in other processes.
        assert os.getpid() not in client.run(os.getpid).values()


def test_ctrl_c_stops_all_inferences(ball):
    code = (
        "import gonio, signal\n"
        "signal.signal(signal.SIGINT, signal.default_int_handler)\n"
        "print('go', flush=True)\n"
        "try:\n"
        f"    gonio.infer_many([{str(ball)!r}] * 20, pictures=False)\n"
        "except KeyboardInterrupt:\n"
        "    print('interrupted', flush=True)\n"
    )
    process = subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, text=True)
    assert process.stdout is not None and process.stdout.readline() == "go\n"
    time.sleep(1)
    process.send_signal(signal.SIGINT)
    sent = time.perf_counter()
    assert process.stdout.readline() == "interrupted\n"
    assert time.perf_counter() - sent < 1.5
    assert process.wait(timeout=30) == 0 and time.perf_counter() - sent < 15
