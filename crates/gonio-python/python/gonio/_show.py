"""How posteriors look: figures and notebooks."""

from __future__ import annotations

import base64
from html import escape
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from . import _gonio
from ._brdf import THETA_H
from ._errors import GonioError

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from ._posterior import Posterior

TRUSTED = 80
"""Degrees; beyond, tables are extrapolated."""

INK = "#26547c"


def escaped(text: str) -> str:
    """Text within HTML."""
    return escape(text, quote=True)


def tonemapped(picture: ArrayLike, *, exposure: float | None = None) -> NDArray[np.uint8]:
    """Linear radiance as 8-bit sRGB to look at, shape (height, width, 3). Where there is coverage, as a fourth channel, the rest becomes
    white. ``exposure`` multiplies the radiance; without one bright parts get six tenths of white, and what is brighter keeps apart."""
    array = np.asarray(picture, np.float32)
    if array.ndim == 2:
        array = np.repeat(array[:, :, np.newaxis], 3, axis=2)
    alpha = array[:, :, 3:] if array.shape[2] == 4 else np.ones_like(array[:, :, :1])
    colours = array[:, :, :3]
    if exposure is None:
        seen = colours[alpha[:, :, 0] > 0.99]
        level = float(np.quantile(seen.max(axis=1), 0.9)) if len(seen) else 1.0
        exposure = 0.6 / max(level, 1e-30)
    linear = exposure * colours
    linear = np.where(linear < 0.5, linear, 1 - 0.5 * np.exp(1 - 2 * linear)) + (1 - alpha)
    coded = np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * np.maximum(linear, 1e-9) ** (1 / 2.4) - 0.055)
    samples: NDArray[np.uint8] = np.round(255 * np.clip(coded, 0, 1)).astype(np.uint8)
    return samples


def html(found: Posterior) -> str:
    """For notebooks: pictures and numbers in one piece."""

    def image(name: str, width: int) -> str:
        if name not in found.pictures:
            return ""
        data = base64.b64encode(_gonio.encode_png(found.pictures[name])).decode()
        return f'<img alt="{name}" width="{width}" style="max-width:100%" src="data:image/png;base64,{data}">'

    low, median, high = found.gloss
    rows = [
        ("gloss", f"{median:.3g} &nbsp; <small>90 %: {low:.3g} to {high:.3g}</small>"),
        ("nearest measured", ", ".join(f"{escaped(n)} ({100 * w:.0f}&nbsp;%)" for n, w in found.materials[:3])),
        ("left open", f"{100 * found.open:.0f} % of the domain"),
        ("misfit", f"{100 * found.misfit:.1f} %"),
        ("scatter", f"{100 * found.scatter:.1f} %"),
    ]
    rows += [("warning", escaped(message)) for message in found.warnings]
    cell = 'style="text-align:left;vertical-align:top"'
    table = "".join(f"<tr><th {cell}>{name}</th><td {cell}>{value}</td></tr>" for name, value in rows)
    return (
        f'<div class="gonio-posterior"><p><b>gonio</b> posterior of <b>{escaped(found.brdf.name)}</b></p>'
        f"{image('summary', 900)}<table>{table}</table></div>"
    )


def plot(found: Posterior) -> Figure:
    """What :meth:`Posterior.plot` shows."""
    try:
        from matplotlib.figure import Figure
        from matplotlib.backends.backend_agg import FigureCanvasAgg
    except ImportError as error:
        raise ImportError("plot needs matplotlib: pip install matplotlib, or gonio[plot]") from error
    if not found.pictures:
        raise GonioError("there are no pictures to plot: infer with pictures=True")
    figure = Figure(figsize=(11, 6.6), layout="constrained")
    FigureCanvasAgg(figure)
    grid = figure.add_gridspec(2, 12, height_ratios=[1, 1.25])
    top = [("photograph", "photograph", slice(0, 3)), ("reproduction", "reproduction", slice(3, 6)), ("light", "estimated light", slice(6, 12))]
    for name, title, columns in top:
        axes = figure.add_subplot(grid[0, columns])
        axes.imshow(found.pictures[name])
        axes.set_title(title, fontsize=10)
        axes.set_axis_off()
    sphere = figure.add_subplot(grid[1, 0:3])
    sphere.imshow(found.pictures["relit"])
    sphere.set_title("BRDF in another light", fontsize=10)
    sphere.set_axis_off()
    lobe(figure.add_subplot(grid[1, 3:8]), found)
    certainty(figure, figure.add_subplot(grid[1, 8:12]), found)
    return figure


def lobe(axes: Axes, found: Posterior) -> None:
    """The BRDF over the half angle, light and view near each other, with its intervals."""
    degrees = np.degrees(THETA_H)
    kept = degrees < TRUSTED
    x = degrees[kept]
    # The mean over small difference angles: what light near the camera shows.
    slices = found.quantiles[:, kept, :20].mean(axis=2)
    axes.fill_between(x, slices[0], slices[3], color=INK, alpha=0.18, linewidth=0, label="90 %")
    axes.fill_between(x, slices[1], slices[2], color=INK, alpha=0.35, linewidth=0, label="50 %")
    for sample in found.samples[:8, kept, :20].mean(axis=2):
        axes.plot(x, sample, color="0.35", linewidth=0.5, alpha=0.7)
    axes.plot([], [], color="0.35", linewidth=0.5, label="draws")
    axes.plot(x, found.luminance[kept, :20].mean(axis=1), color=INK, linewidth=2, label="mean")
    axes.set_yscale("log")
    axes.set_xscale("function", functions=(np.sqrt, np.square))
    axes.set_xticks([0, 1, 5, 10, 20, 40, 60, 80])
    axes.set_xlim(0, TRUSTED)
    axes.set_xlabel(r"half angle $\theta_h$ (degrees)")
    axes.set_ylabel("BRDF, luminance (1/sr)")
    axes.set_title(r"along the lobe ($\theta_d$ below 20 degrees)", fontsize=10)
    axes.grid(alpha=0.25)
    axes.legend(fontsize=8, frameon=False)


def certainty(figure: Figure, axes: Axes, found: Posterior) -> None:
    """How wide the interval is, cell by cell."""
    from matplotlib.colors import LogNorm

    factor: Any = found.quantiles[3] / np.maximum(found.quantiles[0], 1e-9)
    # Samples of the half angle are even in its square root, those of the difference angle in the angle.
    extent = (0.0, 90.0, 0.0, 90.0)
    kept = factor[: int(90 * np.sqrt(TRUSTED / 90)), :TRUSTED]
    norm: Any = LogNorm(1, max(4.0, float(kept.max())))
    shown = axes.imshow(factor.T, origin="lower", extent=extent, norm=norm, cmap="viridis", aspect="auto")
    if found.undetermined.any():
        axes.contourf(
            np.arange(90) + 0.5, np.arange(90) + 0.5, found.undetermined.T.astype(float), levels=[0.5, 1.5], colors="none", hatches=["////"]
        )
    ticks = [0, 1, 5, 10, 20, 40, 60, 80]
    axes.set_xticks([90 * np.sqrt(t / 90) for t in ticks], [str(t) for t in ticks])
    axes.set_yticks([0, 20, 40, 60, 80])
    limit = 90 * np.sqrt(TRUSTED / 90)
    axes.set_xlim(0, limit)
    axes.set_ylim(0, TRUSTED)
    axes.set_xlabel(r"half angle $\theta_h$ (degrees)")
    axes.set_ylabel(r"difference angle $\theta_d$ (degrees)")
    hatched = " (hatched: open)" if found.undetermined.any() else ""
    axes.set_title(f"width of the 90 % interval{hatched}", fontsize=10)
    bar = figure.colorbar(shown, ax=axes, label="factor")
    ends = [t for t in (1, 2, 5, 10, 20, 50, 100, 1000) if norm.vmin <= t <= norm.vmax]
    bar.set_ticks(ends, labels=[str(t) for t in ends])
    bar.minorticks_off()
