"""Results of all methods, and materials with their uncertainty."""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from . import _gonio
from ._arguments import Path, Picture, Shape
from ._brdf import Brdf
from ._validation import flag, integer
from ._convert import dataset, inference_data
from ._types import Bytes, Doubles, Floats, BrdfData, MaterialData, SavedResult

if TYPE_CHECKING:
    import xarray

DRAWS = 64
"""Number of :attr:`Posterior.luminance_draws`."""


class Result:
    """An estimated BRDF. Results can be pickled, and do not reference the photograph."""

    def __init__(self, found: BrdfData, name: str) -> None:
        self._found = found
        self._brdf = Brdf(found["table"], name=name)
        self._result: dict[str, Any] | None = None

    @property
    def brdf(self) -> Brdf:
        """Estimated BRDF in colour, in 1/sr; its albedo at normal incidence is 0.5 unless it is absolute."""
        return self._brdf

    @property
    def luminance(self) -> Floats:
        """Luminance of the estimate, shape (90, 90), on the scale of quantiles and draws."""
        return self._found["luminance"]

    @property
    def colors(self) -> Doubles:
        """Linear colours of body and highlight, each scaled to a luminance of one, shape (2, 3)."""
        return self._found["colors"]

    @property
    def pictures(self) -> dict[str, Bytes]:
        """sRGB pictures of shape (height, width, 3) by name."""
        return self._found["pictures"]

    @property
    def model(self) -> _gonio.Model:
        """Model of the inference."""
        return self._found["model"]

    @property
    def result(self) -> dict[str, Any]:
        """All numbers by name, as in ``result.json``."""
        if self._result is None:
            self._result = json.loads(self._found["document"])
        assert self._result is not None
        return self._result

    def relight(
        self, light: Picture | None = None, shape: Shape = "sphere", size: int | tuple[int, int] = 256, **options: Any
    ) -> Floats:
        """Render the material on a shape under a light: :func:`gonio.render` of :attr:`brdf`.

        Parameters
        ----------
        light, shape, size
            See :func:`gonio.render`.
        **options
            Other arguments of :func:`gonio.render`.

        Returns
        -------
        ndarray of float32
            Radiance and coverage, shape (height, width, 4).

        Examples
        --------
        >>> found.relight(gonio.studio_light(32), shape="bunny", size=(64, 48)).shape
        (48, 64, 4)
        """
        return self.brdf.render(light, shape=shape, size=size, **options)

    def save(self, directory: Path) -> None:
        """Write the folder of results, as ``gonio infer`` does, atomically.

        Parameters
        ----------
        directory : str or os.PathLike
            The folder. Results of an earlier run in it are replaced; all other files are kept.

        Examples
        --------
        >>> found.save(folder / "ball")
        >>> sorted(path.name for path in (folder / "ball").glob("*.json"))
        ['posterior.json', 'result.json']
        """
        result: SavedResult = {
            "table": self.brdf.table,
            "likelihood": None,
            "light": None,
            "albedo_map": None,
            "luminance_quantiles": None,
            "rgb_quantiles": None,
            "pictures": self.pictures,
            "document": json.dumps(self.result, indent=2, allow_nan=False),
            "page": None,
        }
        self._complete(result)
        _gonio.save(os.fspath(directory), result)

    def _complete(self, result: SavedResult) -> None:
        """Adds further contents to a result folder."""

    def export(
        self,
        directory: Path,
        to: Sequence[str] | str | None = None,
        *,
        name: str | None = None,
        albedo: float | None = None,
        tables: bool = False,
        draws: int = 16,
        output_colorspace: str = "rec709",
        progress: Callable[[str, float], object] | None = None,
    ) -> dict[str, Any]:
        """Write files for renderers into a folder, as ``gonio export`` does.

        The exported scenes use the light of the photograph, if it is known.

        Parameters
        ----------
        directory, to, name, albedo, tables, output_colorspace, progress
            See :meth:`Brdf.export`.
        draws : int, default 16
            Number of draws from the posterior, from which the intervals of fitted parameters are
            computed; 0 disables intervals. Results without a posterior have no intervals.

        Returns
        -------
        dict
            Contents of ``export.json``: the files and their errors.

        Examples
        --------
        >>> summary = found.export(folder / "mitsuba", "mitsuba")
        >>> summary["exports"]["mitsuba"]["files"]
        ['principled.xml', 'scene.xml', 'light.exr']
        """
        return self.brdf.export(
            directory,
            to,
            name=name,
            albedo=albedo,
            tables=tables,
            draws=self._drawn(integer(draws, "draws")),
            roughness=self._roughness(),
            light=self._lit(),
            output_colorspace=output_colorspace,
            progress=progress,
        )

    def _drawn(self, count: int) -> Floats | None:
        """Returns draws in colour, if there is a posterior."""
        return None

    def _roughness(self) -> Sequence[float] | None:
        """Returns the 90 % interval of the roughness, if there is a posterior."""
        return None

    def to_mitsuba(self, plugin: str = "measured") -> Any:
        """Create a Mitsuba 3 BSDF: :meth:`Brdf.to_mitsuba` of :attr:`brdf`.

        Parameters
        ----------
        plugin : {"measured", "principled"}, default "measured"
            The table itself, or the best-fitting parameters.

        Returns
        -------
        mitsuba.BSDF
            BSDF for the current Mitsuba variant.
        """
        return self.brdf.to_mitsuba(plugin)

    def _lit(self) -> Floats | None:
        """Returns the estimated or known light of the photograph, if any."""
        return None

    def __getstate__(self) -> dict[str, Any]:
        # Cached values are not pickled; they are computed again.
        return {**self.__dict__, "_result": None}


class Material(Result):
    """A material with its uncertainty."""

    _found: MaterialData

    def __init__(self, found: MaterialData, name: str) -> None:
        super().__init__(found, name)
        dull, glossy = found["ends"]
        self._ends = (Brdf(dull, name=f"{name}, dull end"), Brdf(glossy, name=f"{name}, glossy end"))
        self._luminance_draws: Floats | None = None
        self._rgb_draws: Floats | None = None

    @property
    def ends(self) -> tuple[Brdf, Brdf]:
        """Dull and glossy end of the 90 % interval along the direction that changes a rendered sphere most."""
        return self._ends

    @property
    def luminance_quantiles(self) -> Floats:
        """5, 25, 75 and 95 % quantiles of the luminance of each cell, shape (4, 90, 90)."""
        return self._found["luminance_quantiles"]

    @property
    def undetermined(self) -> NDArray[np.bool_]:
        """Cells of the table that the photograph does not determine, shape (90, 90)."""
        return self._found["undetermined"]

    @property
    def undetermined_share(self) -> float:
        """Share of undetermined cells among those with both angles below 80 degrees."""
        return self._found["undetermined_share"]

    @property
    def materials(self) -> list[tuple[str, float]]:
        """Measured materials with the most similar highlight (not colour), and their weights."""
        return self._found["materials"]

    @property
    def peak_height(self) -> Doubles:
        """5, 50 and 95 % quantiles of the ratio of the BRDF along the normal to its mean at half angles above 45 degrees."""
        return self._found["peak_height"]

    @property
    def ggx_alpha(self) -> Doubles:
        """5, 50 and 95 % quantiles of the width of the GGX lobe of equal sharpness; 1 without a highlight."""
        return self._found["ggx_alpha"]

    @property
    def roughness(self) -> Doubles:
        """Square root of :attr:`ggx_alpha`, as in the principled BSDFs of Mitsuba and Blender."""
        return np.sqrt(self.ggx_alpha)

    @property
    def gloss_units(self) -> dict[int, Doubles]:
        """5, 50 and 95 % quantiles of the gloss units at 20 and at 60 degrees (ASTM D523), by angle.

        Gloss units are proportional to the albedo. These are on the scale of :attr:`brdf`, whose
        albedo at normal incidence is 0.5 unless it is absolute.
        """
        return dict(zip((20, 60), self._found["gloss_units"], strict=True))

    @property
    def verdict(self) -> str:
        """Finish in words, and roughness and peak height with their 90 % intervals."""
        return self._found["verdict"]

    @property
    def luminance_draws(self) -> Floats:
        """64 luminance draws from the posterior, shape (64, 90, 90); see also :meth:`draw`."""
        if self._luminance_draws is None:
            self._luminance_draws = self.draw(DRAWS)
        return self._luminance_draws

    @property
    def rgb_draws(self) -> Floats:
        """:attr:`luminance_draws` in the estimated colours, shape (64, 90, 90, 3)."""
        if self._rgb_draws is None:
            self._rgb_draws = self._coloured(self.luminance_draws)
        return self._rgb_draws

    def draw(self, count: int, seed: int = 0, *, rgb: bool = False, errors: bool = False) -> Floats:
        """Draw from the posterior over the model's space of materials.

        :attr:`luminance_quantiles` are wider, because they include the error of this space. Draws with
        ``errors`` include it, too.

        Parameters
        ----------
        count : int
            Number of draws.
        seed : int, default 0
            Seed of the random numbers.
        rgb : bool, default False
            Return draws in the estimated colours instead of luminance. All draws have the same
            colours; only their luminance varies.
        errors : bool, default False
            Multiply each draw by a smooth random factor, so that the quantiles of the draws are
            :attr:`luminance_quantiles`. Use these draws for intervals of quantities computed from a BRDF.

        Returns
        -------
        ndarray of float32
            Tables in 1/sr, shape (count, 90, 90), or (count, 90, 90, 3) with ``rgb``.

        Examples
        --------
        >>> found.draw(5, seed=3).shape
        (5, 90, 90)
        >>> picture = gonio.render(found.draw(1, rgb=True)[0], size=32)
        """
        number, start = integer(count, "count"), integer(seed, "seed")
        drawn = _gonio.draw(self.model, self._found["likelihood"], number, start, flag(errors, "errors"))
        scale = self._scale()
        drawn = drawn if scale == 1.0 else drawn * np.float32(scale)
        return self._coloured(drawn) if flag(rgb, "rgb") else drawn

    def _drawn(self, count: int) -> Floats | None:
        return self.draw(count, rgb=True, errors=True) if count > 0 else None

    def _roughness(self) -> Sequence[float]:
        low, _, high = self.roughness.tolist()
        return low, high

    def relight(
        self,
        light: Picture | None = None,
        shape: Shape = "sphere",
        size: int | tuple[int, int] = 256,
        *,
        draws: int | None = None,
        seed: int = 0,
        **options: Any,
    ) -> Floats:
        """Render the material on a shape under a light, or draws from its posterior.

        Parameters
        ----------
        light, shape, size
            See :func:`gonio.render`.
        draws : int, optional
            Render this many draws instead of the estimate: those of :meth:`draw` with ``rgb`` and
            ``errors``. Their quantiles are the uncertainty of each pixel.
        seed : int, default 0
            Seed of the draws.
        **options
            Other arguments of :func:`gonio.render`.

        Returns
        -------
        ndarray of float32
            Radiance and coverage, shape (height, width, 4), or (draws, height, width, 4).

        Examples
        --------
        >>> pictures = found.relight(size=32, draws=20)
        >>> low, high = np.quantile(pictures[..., :3], [0.05, 0.95], axis=0)
        >>> bool((low <= high).all())
        True
        """
        if draws is None:
            return super().relight(light, shape, size, **options)
        tables = self.draw(integer(draws, "draws"), seed, rgb=True, errors=True)
        pictures = [Brdf(table, name=f"draw {at}").render(light, shape=shape, size=size, **options) for at, table in enumerate(tables)]
        return np.stack(pictures)

    @property
    def rgb_quantiles(self) -> Floats | None:
        """5, 25, 75 and 95 % quantiles of each channel, shape (4, 90, 90, 3); None for several photographs."""
        return self._found["rgb_quantiles"]

    def _coloured(self, tables: Floats) -> Floats:
        """Colours luminance tables of shape (count, 90, 90) by the estimated chroma of each cell."""
        luminance = np.maximum(self.luminance, np.float32(1e-30))
        coloured = np.asarray(tables[..., None] * (self._found["table"] / luminance[..., None]), dtype=np.float32)
        return coloured

    def _scale(self) -> float:
        """Returns the factor from the scale of the model to that of the BRDF."""
        return 1.0

    def _complete(self, result: SavedResult) -> None:
        super()._complete(result)
        result["likelihood"] = self._found["likelihood"]
        result["luminance_quantiles"] = self.luminance_quantiles
        result["rgb_quantiles"] = self.rgb_quantiles

    def to_xarray(self) -> xarray.Dataset:
        """Convert to an xarray dataset: BRDF, quantiles, draws and numbers with named axes.

        Returns
        -------
        xarray.Dataset
            ``brdf``, ``luminance``, ``luminance_quantiles`` (over ``quantile``), ``undetermined`` and
            ``luminance_draws`` (over ``draw``), all over ``theta_h`` and ``theta_d`` (radians);
            ``peak_height``, ``ggx_alpha`` and ``gloss_units`` over ``bound``: ``"low"``, ``"median"``
            and ``"high"``, the 5, 50 and 95 % quantiles; for one photograph, also ``light`` over
            ``elevation`` and ``azimuth``.

        Raises
        ------
        ImportError
            If xarray is not installed.

        Examples
        --------
        >>> data = found.to_xarray()
        >>> data.brdf.dims
        ('theta_h', 'theta_d', 'channel')
        >>> bool(data.ggx_alpha.sel(bound="median") == found.ggx_alpha[1])
        True
        """
        return dataset(self, self._lit())

    def to_inference_data(self, count: int = 200, seed: int = 0) -> Any:
        """Convert draws from the posterior and their highlights for ArviZ.

        The draws are independent and form one chain.

        Parameters
        ----------
        count : int, default 200
            Number of draws.
        seed : int, default 0
            Seed of the random numbers.

        Returns
        -------
        arviz.InferenceData or xarray.DataTree
            The type depends on the version of ArviZ (before 1.0, or 1.0 and later). The group
            ``posterior`` contains ``peak_height``, ``ggx_alpha``, ``gloss_units_20``, ``gloss_units_60``
            and ``brdf`` (luminance), all over ``chain`` and ``draw``.

        Raises
        ------
        ImportError
            If ArviZ is not installed.

        Examples
        --------
        >>> found.to_inference_data(50).posterior.brdf.dims
        ('chain', 'draw', 'theta_h', 'theta_d')
        """
        return inference_data(self.draw(count, seed))

    def __getstate__(self) -> dict[str, Any]:
        return {**super().__getstate__(), "_luminance_draws": None, "_rgb_draws": None}
