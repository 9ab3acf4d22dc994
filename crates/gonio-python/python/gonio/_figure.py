"""The figure of a posterior."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ._brdf import THETA_H
from ._errors import GonioError
from ._types import Bytes, Floats

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

TRUSTED = 80
"""Angle in degrees above which tables are extrapolated."""

INK = "#26547c"


def plot(pictures: dict[str, Bytes], mean: Floats, quantiles: Floats, draws: Floats, undetermined: NDArray[np.bool_]) -> Figure:
    """Draws the figure of :meth:`Posterior.plot`: pictures, luminance, quantiles, samples and undetermined cells."""
    try:
        from matplotlib.figure import Figure
        from matplotlib.backends.backend_agg import FigureCanvasAgg
    except ImportError as error:
        raise ImportError("plot requires matplotlib; install it with: pip install matplotlib, or gonio[plot]") from error
    if not pictures:
        raise GonioError("there are no pictures to plot; use infer with pictures=True")
    figure = Figure(figsize=(11, 6.6), layout="constrained")
    FigureCanvasAgg(figure)
    grid = figure.add_gridspec(2, 12, height_ratios=[1, 1.25])
    top = [("photograph", "photograph", slice(0, 3)), ("reproduction", "reproduction", slice(3, 6)), ("light", "estimated light", slice(6, 12))]
    for name, title, columns in top:
        axes = figure.add_subplot(grid[0, columns])
        axes.imshow(pictures[name])
        axes.set_title(title, fontsize=10)
        axes.set_axis_off()
    sphere = figure.add_subplot(grid[1, 0:3])
    sphere.imshow(pictures["relit"])
    sphere.set_title("BRDF in another light", fontsize=10)
    sphere.set_axis_off()
    lobe(figure.add_subplot(grid[1, 3:8]), mean, quantiles, draws)
    certainty(figure, figure.add_subplot(grid[1, 8:12]), quantiles, undetermined)
    return figure


def lobe(axes: Axes, mean: Floats, quantiles: Floats, draws: Floats) -> None:
    """Draws the BRDF over the half angle with its intervals, for nearly parallel light and view."""
    degrees = np.degrees(THETA_H)
    kept = degrees < TRUSTED
    x = degrees[kept]
    # Mean over small difference angles: light near the camera.
    slices = quantiles[:, kept, :20].mean(axis=2)
    axes.fill_between(x, slices[0], slices[3], color=INK, alpha=0.18, linewidth=0, label="90 %")
    axes.fill_between(x, slices[1], slices[2], color=INK, alpha=0.35, linewidth=0, label="50 %")
    for sample in draws[:8, kept, :20].mean(axis=2):
        axes.plot(x, sample, color="0.35", linewidth=0.5, alpha=0.7)
    axes.plot([], [], color="0.35", linewidth=0.5, label="draws")
    axes.plot(x, mean[kept, :20].mean(axis=1), color=INK, linewidth=2, label="mean")
    axes.set_yscale("log")
    axes.set_xscale("function", functions=(np.sqrt, np.square))
    axes.set_xticks([0, 1, 5, 10, 20, 40, 60, 80])
    axes.set_xlim(0, TRUSTED)
    axes.set_xlabel(r"half angle $\theta_h$ (degrees)")
    axes.set_ylabel("BRDF, luminance (1/sr)")
    axes.set_title(r"along the lobe ($\theta_d$ below 20 degrees)", fontsize=10)
    axes.grid(alpha=0.25)
    axes.legend(fontsize=8, frameon=False)


def certainty(figure: Figure, axes: Axes, quantiles: Floats, undetermined: NDArray[np.bool_]) -> None:
    """Draws the width of the interval in each cell."""
    from matplotlib.colors import LogNorm

    factor: Any = quantiles[3] / np.maximum(quantiles[0], 1e-9)
    # Samples are uniform in the square root of the half angle and in the difference angle.
    extent = (0.0, 90.0, 0.0, 90.0)
    kept = factor[: int(90 * np.sqrt(TRUSTED / 90)), :TRUSTED]
    norm: Any = LogNorm(1, max(4.0, float(kept.max())))
    shown = axes.imshow(factor.T, origin="lower", extent=extent, norm=norm, cmap="viridis", aspect="auto")
    if undetermined.any():
        axes.contourf(
            np.arange(90) + 0.5, np.arange(90) + 0.5, undetermined.T.astype(float), levels=[0.5, 1.5], colors="none", hatches=["////"]
        )
    ticks = [0, 1, 5, 10, 20, 40, 60, 80]
    axes.set_xticks([90 * np.sqrt(t / 90) for t in ticks], [str(t) for t in ticks])
    axes.set_yticks([0, 20, 40, 60, 80])
    limit = 90 * np.sqrt(TRUSTED / 90)
    axes.set_xlim(0, limit)
    axes.set_ylim(0, TRUSTED)
    axes.set_xlabel(r"half angle $\theta_h$ (degrees)")
    axes.set_ylabel(r"difference angle $\theta_d$ (degrees)")
    hatched = " (hatched: undetermined)" if undetermined.any() else ""
    axes.set_title(f"width of the 90 % interval{hatched}", fontsize=10)
    bar = figure.colorbar(shown, ax=axes, label="factor")
    ends = [t for t in (1, 2, 5, 10, 20, 50, 100, 1000) if norm.vmin <= t <= norm.vmax]
    bar.set_ticks(ends, labels=[str(t) for t in ends])
    bar.minorticks_off()
