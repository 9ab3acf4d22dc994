"""What inference finds in one photograph."""

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
from ._types import Bytes, Doubles, Floats, Found, FoundBrdf, FoundInBasis, SavedResult

if TYPE_CHECKING:
    from matplotlib.figure import Figure


class OfPhotograph(Result):
    """What one photograph tells besides the BRDF."""

    _found: FoundInBasis

    @property
    def light(self) -> Floats:
        """The estimated light, a lat-long map of shape (128, 256, 3), linear RGB.

        Row 0 is up, the centre looks along -z, the right half is +x, in coordinates of the camera.
        It goes with :attr:`brdf`. If the light was given: its map, as it was found to lie.
        """
        return self._found["light"]

    @property
    def light_color(self) -> Doubles:
        """Linear colour of the light as a whole, of luminance one, shape (3,); white where it was not estimated."""
        return self._found["light_color"]

    @property
    def misfit(self) -> float:
        """What BRDF and light leave of the photograph, relative to it (root mean square)."""
        return self._found["misfit"]

    @property
    def warnings(self) -> tuple[str, ...]:
        """What speaks against believing it, one line each."""
        return tuple(self._found["warnings"])

    @property
    def method(self) -> str:
        """The method that found it, by its name."""
        method: str = self.notes["method"]
        return method

    @property
    def pictures(self) -> dict[str, Bytes]:
        """sRGB pictures of shape (height, width, 3) by name; empty if inferred with ``pictures=False``.

        photograph, observed (where it was sampled), reproduction, residual, light; spheres of the
        BRDF in lights of gonio's own, the first called relit; summary, uncertainty; used (what was
        left out and why), if anything was.
        """
        return self._found["pictures"]

    @property
    def report(self) -> str | None:
        """The page ``report.html``, if it was asked for."""
        return self._found["page"]

    @property
    def notes(self) -> dict[str, Any]:
        """All numbers by name, as in the ``result.json`` of ``gonio infer``."""
        if self._told is None:
            self._told = {**json.loads(self._found["notes"]), "warnings": list(self.warnings)}
        return self._told

    def _complete(self, result: SavedResult) -> None:
        super()._complete(result)
        result["light"] = self.light
        result["page"] = self.report

    def _lit(self) -> Floats | None:
        return self.light

    def _image(self, name: str, width: int) -> str:
        """A picture within a page, if it is there, about as wide as it is shown."""
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
        """Pictures and numbers in one piece, for notebooks."""
        rows = rows + [("warning", escaped(message)) for message in self.warnings]
        cell = 'style="text-align:left;vertical-align:top"'
        table = "".join(f"<tr><th {cell}>{name}</th><td {cell}>{value}</td></tr>" for name, value in rows)
        return (
            f'<div class="gonio-posterior"><p><b>gonio</b> posterior of <b>{escaped(self.brdf.name)}</b></p>'
            f"{self._image('summary', 720)}<table>{table}</table></div>"
        )


class Posterior(Material, OfPhotograph):
    """What one photograph tells of a material and of the light on it.

    All BRDFs have an albedo of 0.5 along the normal: a photograph under unknown light does not tell
    the scale of reflectance. Posteriors can be pickled, and hold no reference to the photograph.

    Examples
    --------
    >>> found = gonio.infer("samples/ball.exr")
    >>> found.quantiles.shape, found.light.shape
    ((4, 90, 90), (128, 256, 3))
    >>> low, median, high = found.gloss_units[60]
    """

    _found: Found

    @property
    def scatter(self) -> float:
        """Standard deviation of pixels that share a normal, relative to their mean.

        It is noise, texture, shadows and wrong normals; 0 where too few share one.
        """
        return self._found["scatter"]

    def _scale(self) -> float:
        return self._found["scale"]

    def plot(self) -> Figure:
        """Draw the photograph, its reproduction, the light, the BRDF and how sure it is.

        In a notebook the figure shows itself.

        Returns
        -------
        matplotlib.figure.Figure
            To be saved by its ``savefig``.

        Raises
        ------
        ImportError
            If matplotlib is not installed.
        GonioError
            If it was inferred with ``pictures=False``.

        Examples
        --------
        >>> found.plot().savefig(folder / "figure.png")
        """
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
        low, median, high = self.gloss
        sharp, middle, dull = self.alpha
        units = "; ".join(
            f"{values[1]:.3g} at {angle}&deg; <small>({values[0]:.3g} to {values[2]:.3g})</small>"
            for angle, values in self.gloss_units.items()
        )
        return self._page(
            [
                ("gloss", f"{median:.3g} &nbsp; <small>90 %: {low:.3g} to {high:.3g}; {escaped(self.verdict)}</small>"),
                ("GGX alpha", f"{middle:.2g} &nbsp; <small>90 %: {sharp:.2g} to {dull:.2g}; roughness is its root</small>"),
                ("gloss units", f"{units} <small>for an albedo of {self.brdf.albedo:.2g}</small>"),
                ("highlight like, not colour", ", ".join(f"{escaped(n)} ({100 * w:.0f}&nbsp;%)" for n, w in self.materials[:3])),
                ("hardly narrowed", f"{100 * self.open:.0f} % of the BRDF's cells have an interval almost as wide as without a photograph"),
                ("misfit", f"{100 * self.misfit:.1f} %"),
                ("scatter", f"{100 * self.scatter:.1f} %"),
            ]
        )


class BasisPosterior(OfPhotograph):
    """What a method of the paper finds: coefficients of reflectance in a basis.

    It has no quantiles of the BRDF; its numbers say how sure each coefficient is.

    Examples
    --------
    >>> ball = found.relight(size=32)
    >>> found = gonio.infer(ball, method="map", starts=1, grid=8, pictures=False)
    >>> found.coefficients.shape, found.coefficients_sd
    ((10,), None)
    """

    @property
    def coefficients(self) -> Doubles:
        """Coefficients of the model's basis functions, shape (rank,)."""
        return np.array(self.notes["reflectance"]["coefficients"])

    @property
    def coefficients_sd(self) -> Doubles | None:
        """Their standard deviations, shape (rank,), if the method tells them: the joint maximum does not."""
        spread = np.array(self.notes["reflectance"]["sd"])
        return spread if spread.any() else None

    @property
    def noise(self) -> float:
        """Noise that explains what is left of the photograph, relative to it."""
        return self._found["misfit"]

    def __repr__(self) -> str:
        return f"<gonio.BasisPosterior {self.brdf.name!r}: {self.method}, noise {100 * self.noise:.1f} %>"

    def _repr_html_(self) -> str:
        """For notebooks: pictures and numbers in one piece."""
        return self._page([("method", self.method), ("noise", f"{100 * self.noise:.1f} %")])
