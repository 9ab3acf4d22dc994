"""A typed program that uses the package; checked by mypy --strict, never run."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

import gonio


def told(stage: str, fraction: float) -> None:
    print(stage, fraction)


def use(image: NDArray[np.float32], path: Path) -> NDArray[np.float32]:
    found: gonio.Posterior = gonio.infer(image, shape="sphere", mask=None, model=None, progress=told)
    table: NDArray[np.float32] = found.brdf.table
    open_cells: NDArray[np.bool_] = found.undetermined
    names: list[str] = [name for name, _ in found.materials]
    draws: NDArray[np.float32] = found.rgb_draws
    low, median, high = found.gloss_units[60]
    basis: gonio.BasisPosterior = gonio.infer(image, method="variational", starts=2, grid=16)
    merged: gonio.Merged = gonio.merge(["a.jpg", "b.jpg"], times=[0.1, 0.2])
    looked: gonio.Checked = gonio.check(merged.picture, clip=merged.clip_level)
    print(draws.shape, low, median, high, basis.coefficients, looked.outlines, found.brdf.peak_height, found.to_xarray().sizes)
    print(table.shape, open_cells.sum(), names, found.result["seconds"])
    found.plot().savefig(path / "figure.png")
    found.save(path)
    summary = found.export(path / "export", to=["mitsuba", "blender"])
    print(summary["exports"])
    for result in gonio.infer_many([path, image, {"image": image, "grid": 16}], grid=32):
        if isinstance(result, gonio.Failure):
            print(result.name, result.error)
        else:
            print(result.peak_height)
    probe: gonio.LightProbe = gonio.light_probe(image, circle=(60, 60, 50), second=path, reflectance=(0.9, 0.8, 0.5))
    probe.write(path / "probe.exr")
    model: gonio.Model = gonio.train_model(gonio.train_lighting(path), gonio.train_reflectance({"a": found.brdf}))
    model = gonio.train_colours(path, {"a": found.brdf}, model=model)
    model.write(str(path))
    return found.relight(probe.light, shape="bunny", size=(64, 48))
