"""What inference finds."""

from __future__ import annotations

import base64
import json
import os
from collections.abc import Callable, Sequence
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from . import _gonio
from ._arguments import Path, Picture, Shape
from ._brdf import Brdf
from ._figure import plot
from ._show import escaped
from ._types import Floats, Found, FoundMaterial, SavedResult

if TYPE_CHECKING:
    from matplotlib.figure import Figure

QUANTILES = (0.05, 0.25, 0.75, 0.95)
"""Shares of :attr:`Posterior.quantiles`."""

DRAWS = 64
"""Number of :attr:`Posterior.samples`."""


class Material:
    """A material with its uncertainty."""

    brdf: Brdf
    """The estimate, in colour."""
    ends: tuple[Brdf, Brdf]
    """The dull and the glossy end of what is probable: 5 and 95 % of the posterior by gloss."""
    luminance: Floats
    """The estimate in luminance, shape (90, 90): what quantiles and samples go with."""
    quantiles: Floats
    """5, 25, 75 and 95 % quantiles of the luminance of each cell, shape (4, 90, 90)."""
    undetermined: NDArray[np.bool_]
    """Cells of the table whose 90 % interval is most of what it is without a photograph, shape (90, 90)."""
    open: float
    """Their share of the domain in which both angles are below 80 degrees."""
    materials: list[tuple[str, float]]
    """The measured materials that are most like it in the shape of the highlight, not in colour, and their weights."""
    gloss: NDArray[np.float64]
    """5, 50 and 95 % quantiles of the gloss: the BRDF along the normal over its mean at half angles beyond 45 degrees."""
    alpha: NDArray[np.float64]
    """5, 50 and 95 % quantiles of the width of the GGX lobe that is as sharp; one where there is no highlight."""
    gloss_units: dict[int, NDArray[np.float64]]
    """5, 50 and 95 % quantiles of the gloss units at 20 and at 60 degrees (ASTM D523) on the scale of :attr:`brdf`: of a material whose
    albedo along the normal is 0.5, unless light and photograph are on one scale. They are in proportion to the albedo."""
    verdict: str
    """How far the gloss is known, in words."""
    pictures: dict[str, NDArray[np.uint8]]
    """sRGB pictures of shape (height, width, 3) by name."""
    model: _gonio.Model
    """The model it was inferred with."""

    def __init__(self, found: FoundMaterial, name: str, scale: float = 1.0) -> None:
        self.brdf = Brdf(found["table"], name=name)
        dull, glossy = found["ends"]
        self.ends = (Brdf(dull, name=f"{name}, dull end"), Brdf(glossy, name=f"{name}, glossy end"))
        self.luminance = found["luminance"]
        self.quantiles = found["quantiles"]
        self.undetermined = found["undetermined"]
        self.open = found["open"]
        self.materials = found["materials"]
        self.gloss = np.array(found["gloss"])
        self.alpha = np.array(found["alpha"])
        self.gloss_units = {angle: np.array(units) for angle, units in zip((20, 60), found["gloss_units"], strict=True)}
        self.verdict = found["verdict"]
        self.pictures = found["pictures"]
        self.model = found["model"]
        self._likelihood = found["likelihood"]
        self._notes = found["notes"]
        self._scale = scale

    @property
    def roughness(self) -> NDArray[np.float64]:
        """The root of :attr:`alpha`, which the principled models of Mitsuba and Blender take."""
        return np.sqrt(self.alpha)

    @cached_property
    def samples(self) -> Floats:
        """64 draws from the posterior, in luminance, shape (64, 90, 90); :meth:`draw` gives others."""
        return self.draw(DRAWS)

    def draw(self, count: int, seed: int = 0) -> Floats:
        """Draws from the posterior over the model's space of materials, in luminance, shape (count, 90, 90).
        The same seed gives the same draws. :attr:`quantiles` are wider: they allow for what the space misses."""
        drawn = _gonio.draw(self.model, self._likelihood, count, seed)
        return drawn if self._scale == 1.0 else drawn * np.float32(self._scale)

    @cached_property
    def notes(self) -> dict[str, Any]:
        """All numbers by name, as in ``result.json``."""
        notes: dict[str, Any] = json.loads(self._notes)
        return notes

    def relight(self, light: Picture | None = None, shape: Shape = "sphere", size: int | tuple[int, int] = 256, **options: Any) -> Floats:
        """:func:`gonio.render` of :attr:`brdf`: radiance and coverage, shape (height, width, 4)."""
        return self.brdf.render(light, shape=shape, size=size, **options)

    def _write(self, directory: Path, light: Floats | None, page: str | None) -> None:
        result: SavedResult = {
            "table": self.brdf.table,
            "likelihood": self._likelihood,
            "light": light,
            "quantiles": self.quantiles,
            "pictures": self.pictures,
            "notes": json.dumps(self.notes, indent=2, allow_nan=False),
            "page": page,
        }
        _gonio.save(os.fspath(directory), result)

    def export(
        self,
        directory: Path,
        to: Sequence[str] | str | None = None,
        *,
        name: str | None = None,
        albedo: float | None = None,
        tables: bool = False,
        progress: Callable[[str, float], object] | None = None,
    ) -> dict[str, Any]:
        """Writes files for renderers into a folder, as ``gonio export`` does; see :meth:`Brdf.export`. The scenes are lit by the
        light of the photograph, if one photograph told it."""
        return self.brdf.export(directory, to, name=name, albedo=albedo, tables=tables, light=self._lit(), progress=progress)

    def _lit(self) -> Floats | None:
        """The light of the photograph in colour, if it was found or given."""
        return None

    def __getstate__(self) -> dict[str, Any]:
        # What is computed when asked for is computed again.
        return {key: value for key, value in self.__dict__.items() if key not in ("samples", "notes")}


class Posterior(Material):
    """What one photograph tells of a material and of the light on it.

    All BRDFs have an albedo of 0.5 along the normal: a photograph under unknown light does not tell the scale of reflectance.
    Posteriors can be pickled, and hold no reference to the photograph.
    """

    light: Floats
    """The estimated light, a lat-long map of shape (128, 256, 3) in luminance: row 0 is up, the centre looks along -z, the right half is
    +x, in coordinates of the camera. Times :attr:`light_color` it goes with :attr:`brdf`. If the light was given: its map, as it was found
    to lie."""
    light_color: Floats
    """Linear colour of the light, of luminance one, shape (3,); white where it was not estimated."""
    misfit: float
    """What BRDF and light leave of the photograph, relative to it (root mean square)."""
    scatter: float
    """Standard deviation of pixels that share a normal, relative to their mean: noise, texture, shadows and wrong normals. 0 where too
    few share one."""
    warnings: tuple[str, ...]
    """What speaks against believing it, one line each."""
    pictures: dict[str, NDArray[np.uint8]]
    """sRGB pictures of shape (height, width, 3): photograph, observed (where it was sampled), reproduction, residual, light;
    spheres of the BRDF in lights of gonio's own, the first called relit; summary, uncertainty; used (what was left out and why), if
    anything was. Empty if inferred with ``pictures=False``."""
    report: str | None
    """The page ``report.html``, if it was asked for."""

    def __init__(self, found: Found, name: str) -> None:
        super().__init__(found, name, found["scale"])
        self.light = found["light"]
        self.light_color = found["light_color"]
        self.misfit = found["misfit"]
        self.scatter = found["scatter"]
        self.warnings = tuple(found["warnings"])
        self.report = found["page"]

    def _lit(self) -> Floats | None:
        # An estimated light is grey; one that was given has its colours.
        is_grey = self.light is not None and (self.light == self.light[..., :1]).all()
        return self.light * self.light_color.astype(np.float32) if is_grey else self.light

    @cached_property
    def notes(self) -> dict[str, Any]:
        """All numbers by name, as in the ``result.json`` of ``gonio infer``."""
        notes: dict[str, Any] = json.loads(self._notes)
        notes["warnings"] = list(self.warnings)
        return notes

    def save(self, directory: Path) -> None:
        """Writes the folder of results that ``gonio infer`` writes, whole or not at all: ``brdf.binary``, ``brdf_quantiles.npy``,
        ``posterior.json``, ``light.exr``, pictures and ``result.json``; ``report.html`` if :func:`gonio.infer` was asked for it."""
        self._write(directory, self.light, self.report)

    def plot(self) -> Figure:
        """A figure of the photograph, its reproduction, the light, the BRDF on a sphere and along its lobe, and how sure it is. Needs
        matplotlib; in a notebook the figure shows itself."""
        return plot(self.pictures, self.luminance, self.quantiles, self.samples, self.undetermined)

    def __repr__(self) -> str:
        nearest = f", highlight like {self.materials[0][0]}" if self.materials else ""
        low, median, high = self.gloss
        return (
            f"<gonio.Posterior {self.brdf.name!r}: gloss {median:.3g} ({low:.3g} to {high:.3g}){nearest}, "
            f"misfit {100 * self.misfit:.1f} %>"
        )

    def _repr_html_(self) -> str:
        """For notebooks: pictures and numbers in one piece."""

        def image(name: str, width: int) -> str:
            if name not in self.pictures:
                return ""
            data = base64.b64encode(_gonio.encode_png(self.pictures[name])).decode()
            return f'<img alt="{name}" width="{width}" style="max-width:100%" src="data:image/png;base64,{data}">'

        low, median, high = self.gloss
        sharp, middle, dull = self.alpha
        rows = [
            ("gloss", f"{median:.3g} &nbsp; <small>90 %: {low:.3g} to {high:.3g}; {escaped(self.verdict)}</small>"),
            ("GGX alpha", f"{middle:.2g} &nbsp; <small>90 %: {sharp:.2g} to {dull:.2g}; roughness is its root</small>"),
            ("highlight like, not colour", ", ".join(f"{escaped(n)} ({100 * w:.0f}&nbsp;%)" for n, w in self.materials[:3])),
            ("hardly narrowed", f"{100 * self.open:.0f} % of the BRDF's cells have an interval almost as wide as without a photograph"),
            ("misfit", f"{100 * self.misfit:.1f} %"),
            ("scatter", f"{100 * self.scatter:.1f} %"),
        ]
        rows += [("warning", escaped(message)) for message in self.warnings]
        cell = 'style="text-align:left;vertical-align:top"'
        table = "".join(f"<tr><th {cell}>{name}</th><td {cell}>{value}</td></tr>" for name, value in rows)
        return (
            f'<div class="gonio-posterior"><p><b>gonio</b> posterior of <b>{escaped(self.brdf.name)}</b></p>'
            f"{image('summary', 900)}<table>{table}</table></div>"
        )
