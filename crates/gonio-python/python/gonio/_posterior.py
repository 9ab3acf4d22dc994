"""Results of inference from one photograph."""

from __future__ import annotations

import base64
import json
from typing import TYPE_CHECKING, Any

import numpy as np

from . import _gonio
from ._convert import QUANTILES as QUANTILES
from ._figure import plot
from ._material import Material, Result
from ._show import escaped
from ._types import Bytes, Doubles, Floats, PosteriorData, BrdfData, BasisData, SavedResult

if TYPE_CHECKING:
    from matplotlib.figure import Figure


class PhotographResult(Result):
    """Results from one photograph besides the BRDF."""

    _found: BasisData

    @property
    def light(self) -> Floats:
        """Estimated light, a lat-long map of shape (128, 256, 3), linear RGB.

        In camera coordinates, row 0 is up, the centre is -z, and the right half is +x. Its scale
        matches :attr:`brdf`. For a known light, this is its map with the estimated rotation.
        """
        return self._found["light"]

    @property
    def albedo_map(self) -> Floats | None:
        """Reflectance of each pixel relative to that of the estimated paint, if the object has two paints.

        Linear RGB, shape (height, width, 3), with zeros off the object and where it is unknown; None
        for an object of one paint.
        """
        return self._found["albedo_map"]

    @property
    def light_color(self) -> Doubles:
        """Mean linear colour of the light, scaled to a luminance of one, shape (3,); white if not estimated."""
        return self._found["light_color"]

    @property
    def misfit(self) -> float:
        """Relative root mean square residual of the photograph, given BRDF and light."""
        return self._found["misfit"]

    @property
    def warnings(self) -> tuple[str, ...]:
        """Warnings about the result, one line each."""
        return tuple(self._found["warnings"])

    @property
    def method(self) -> str:
        """Name of the estimation method."""
        method: str = self.result["method"]
        return method

    @property
    def pictures(self) -> dict[str, Bytes]:
        """sRGB pictures of shape (height, width, 3) by name; empty if inferred with ``pictures=False``.

        The names are photograph, observed (sample points), reproduction, residual, light, summary and
        uncertainty. Spheres show the BRDF in built-in lights; the first of them is named relit. If
        pixels are ignored, used shows them with the reasons. If the normals are inflated from the
        outline or refined, normals shows them as colours.
        """
        return self._found["pictures"]

    @property
    def report(self) -> str | None:
        """The page ``report.html``, if requested."""
        return self._found["page"]

    @property
    def result(self) -> dict[str, Any]:
        """All numbers by name, as in the ``result.json`` of ``gonio infer``."""
        if self._result is None:
            self._result = {**json.loads(self._found["document"]), "warnings": list(self.warnings)}
        return self._result

    def _complete(self, result: SavedResult) -> None:
        super()._complete(result)
        result["light"] = self.light
        result["albedo_map"] = self.albedo_map
        result["page"] = self.report

    def _lit(self) -> Floats | None:
        return self.light

    def _image(self, name: str, width: int) -> str:
        """Returns an HTML image, reduced to about its displayed width, if the picture exists."""
        if name not in self.pictures:
            return ""
        picture = self.pictures[name]
        times = max(picture.shape[1] // width, 1)
        rows, columns = picture.shape[0] // times, picture.shape[1] // times
        blocks = picture[: rows * times, : columns * times].reshape(rows, times, columns, times, 3)
        shown = np.rint(blocks.mean(axis=(1, 3))).astype(np.uint8)
        data = base64.b64encode(_gonio.encode_png(shown)).decode()
        return f'<img alt="{name}" width="{width}" style="max-width:100%" src="data:image/png;base64,{data}">'

    def _page(self, rows: list[tuple[str, str]]) -> str:
        """Returns pictures and numbers as HTML, for notebooks."""
        rows = rows + [("warning", escaped(message)) for message in self.warnings]
        cell = 'style="text-align:left;vertical-align:top"'
        table = "".join(f"<tr><th {cell}>{name}</th><td {cell}>{value}</td></tr>" for name, value in rows)
        return (
            f'<div class="gonio-posterior"><p><b>gonio</b> posterior of <b>{escaped(self.brdf.name)}</b></p>'
            f"{self._image('summary', 720)}<table>{table}</table></div>"
        )


class Posterior(Material, PhotographResult):
    """Posterior of a material and estimated light, from one photograph.

    BRDFs have an albedo of 0.5 at normal incidence unless they are absolute, because a photograph
    under unknown light does not determine the scale. Posteriors can be pickled, and do not reference
    the photograph.

    Examples
    --------
    >>> found = gonio.infer("samples/ball.exr")
    >>> found.luminance_quantiles.shape, found.light.shape
    ((4, 90, 90), (128, 256, 3))
    >>> low, median, high = found.gloss_units[60]
    """

    _found: PosteriorData

    @property
    def scatter(self) -> float:
        """Relative standard deviation of pixels with the same normal.

        Its causes are noise, texture, shadows and wrong normals. It is 0 if too few pixels share a
        normal.
        """
        return self._found["scatter"]

    def _scale(self) -> float:
        return self._found["scale"]

    def plot(self) -> Figure:
        """Plot the photograph, its reproduction, the light, and the BRDF with its uncertainty.

        Notebooks display the figure.

        Returns
        -------
        matplotlib.figure.Figure
            Figure that ``savefig`` can save.

        Raises
        ------
        ImportError
            If matplotlib is not installed.
        GonioError
            If the result was inferred with ``pictures=False``.

        Examples
        --------
        >>> found.plot().savefig(folder / "figure.png")
        """
        return plot(self.pictures, self.luminance, self.luminance_quantiles, self.luminance_draws, self.undetermined)

    def __repr__(self) -> str:
        return f"<gonio.Posterior {self.brdf.name!r}: {self.verdict}; misfit {100 * self.misfit:.1f} %>"

    def _repr_html_(self) -> str:
        """Returns pictures and numbers as HTML, for notebooks."""
        low, median, high = self.peak_height
        sharp, middle, dull = self.ggx_alpha
        units = "; ".join(
            f"{values[1]:.3g} at {angle}&deg; <small>({values[0]:.3g} to {values[2]:.3g})</small>"
            for angle, values in self.gloss_units.items()
        )
        return self._page(
            [
                ("finish", escaped(self.verdict)),
                ("GGX alpha", f"{middle:.2g} &nbsp; <small>90 %: {sharp:.2g} to {dull:.2g}; roughness is its square root</small>"),
                ("gloss units", f"{units} <small>for an albedo of {self.brdf.albedo:.2g}</small>"),
                ("peak height", f"{median:.2g} &nbsp; <small>90 %: {low:.2g} to {high:.2g}</small>"),
                ("most similar highlight (not colour)", ", ".join(f"{escaped(n)} ({100 * w:.0f}&nbsp;%)" for n, w in self.materials[:3])),
                ("undetermined", f"{100 * self.undetermined_share:.0f} % of the BRDF's cells"),
                ("misfit", f"{100 * self.misfit:.1f} %"),
                ("scatter", f"{100 * self.scatter:.1f} %"),
            ]
        )


class BasisPosterior(PhotographResult):
    """Result of a method of the paper: coefficients of reflectance in a basis.

    It has standard deviations of the coefficients, but no quantiles of the BRDF.

    Examples
    --------
    >>> ball = found.relight(size=32)
    >>> found = gonio.infer(ball, method="joint-map", starts=1, grid=8, pictures=False)
    >>> found.coefficients.shape, found.coefficients_sd
    ((10,), None)
    """

    @property
    def coefficients(self) -> Doubles:
        """Coefficients of the model's basis functions, shape (rank,)."""
        return np.array(self.result["reflectance"]["coefficients"])

    @property
    def coefficients_sd(self) -> Doubles | None:
        """Standard deviations of the coefficients, shape (rank,); None for the joint MAP estimate."""
        spread = np.array(self.result["reflectance"]["sd"])
        return spread if spread.any() else None

    @property
    def noise(self) -> float:
        """Estimated noise, relative to the photograph."""
        return self._found["misfit"]

    def __repr__(self) -> str:
        return f"<gonio.BasisPosterior {self.brdf.name!r}: {self.method}, noise {100 * self.noise:.1f} %>"

    def _repr_html_(self) -> str:
        """Returns pictures and numbers as HTML, for notebooks."""
        return self._page([("method", self.method), ("noise", f"{100 * self.noise:.1f} %")])
