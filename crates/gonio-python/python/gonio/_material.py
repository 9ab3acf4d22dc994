"""What every method finds, and materials with their uncertainty."""

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
from ._checks import flag, whole
from ._convert import dataset, inference_data
from ._types import Bytes, Doubles, Floats, FoundBrdf, FoundMaterial, SavedResult

if TYPE_CHECKING:
    import xarray

DRAWS = 64
"""Number of :attr:`Posterior.samples`."""


class Result:
    """A BRDF that was found. Results can be pickled, and hold no reference to the photograph."""

    def __init__(self, found: FoundBrdf, name: str) -> None:
        self._found = found
        self._brdf = Brdf(found["table"], name=name)
        self._told: dict[str, Any] | None = None

    @property
    def brdf(self) -> Brdf:
        """The estimate, in colour, in 1/sr; its albedo along the normal is 0.5 unless it is known."""
        return self._brdf

    @property
    def luminance(self) -> Floats:
        """The estimate in luminance, shape (90, 90): what quantiles and samples go with."""
        return self._found["luminance"]

    @property
    def colors(self) -> Doubles:
        """Linear colours of the body and of the highlight, each of luminance one, shape (2, 3)."""
        return self._found["colors"]

    @property
    def pictures(self) -> dict[str, Bytes]:
        """sRGB pictures of shape (height, width, 3) by name."""
        return self._found["pictures"]

    @property
    def model(self) -> _gonio.Model:
        """The model it was inferred with."""
        return self._found["model"]

    @property
    def notes(self) -> dict[str, Any]:
        """All numbers by name, as in ``result.json``."""
        if self._told is None:
            self._told = json.loads(self._found["notes"])
        assert self._told is not None
        return self._told

    def relight(
        self, light: Picture | None = None, shape: Shape = "sphere", size: int | tuple[int, int] = 256, **options: Any
    ) -> Floats:
        """Render the material on a shape under a light: :func:`gonio.render` of :attr:`brdf`.

        Parameters
        ----------
        light, shape, size
            As :func:`gonio.render` takes them.
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
        """Write the folder of results that the program writes, whole or not at all.

        Parameters
        ----------
        directory : str or os.PathLike
            The folder. Results of an earlier run that it holds are replaced; files of others stay.

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
            "quantiles": None,
            "rgb_quantiles": None,
            "pictures": self.pictures,
            "notes": json.dumps(self.notes, indent=2, allow_nan=False),
            "page": None,
        }
        self._complete(result)
        _gonio.save(os.fspath(directory), result)

    def _complete(self, result: SavedResult) -> None:
        """Adds to the contents of a folder of results what is known besides."""

    def export(
        self,
        directory: Path,
        to: Sequence[str] | str | None = None,
        *,
        name: str | None = None,
        albedo: float | None = None,
        tables: bool = False,
        output_colorspace: str = "rec709",
        progress: Callable[[str, float], object] | None = None,
    ) -> dict[str, Any]:
        """Write files for renderers into a folder, as ``gonio export`` does.

        The scenes are lit by the light of the photograph, if one photograph told it.

        Parameters
        ----------
        directory, to, name, albedo, tables, output_colorspace, progress
            As :meth:`Brdf.export` takes them.

        Returns
        -------
        dict
            What ``export.json`` says: which files there are, and how far each is off.

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
            light=self._lit(),
            output_colorspace=output_colorspace,
            progress=progress,
        )

    def to_mitsuba(self, plugin: str = "measured") -> Any:
        """Make a BSDF of Mitsuba 3: :meth:`Brdf.to_mitsuba` of :attr:`brdf`.

        Parameters
        ----------
        plugin : {"measured", "principled"}, default "measured"
            The table itself, or the parameters that come nearest.

        Returns
        -------
        mitsuba.BSDF
            For the variant of Mitsuba that is set.
        """
        return self.brdf.to_mitsuba(plugin)

    def _lit(self) -> Floats | None:
        """The light of the photograph, if it was found or given."""
        return None

    def __getstate__(self) -> dict[str, Any]:
        # What is computed when asked for is computed again.
        return {**self.__dict__, "_told": None}


class Material(Result):
    """A material with its uncertainty."""

    _found: FoundMaterial

    def __init__(self, found: FoundMaterial, name: str) -> None:
        super().__init__(found, name)
        dull, glossy = found["ends"]
        self._ends = (Brdf(dull, name=f"{name}, dull end"), Brdf(glossy, name=f"{name}, glossy end"))
        self._samples: Floats | None = None
        self._rgb_samples: Floats | None = None

    @property
    def ends(self) -> tuple[Brdf, Brdf]:
        """The dull and the glossy end of what is probable: 5 and 95 % of the posterior by gloss."""
        return self._ends

    @property
    def quantiles(self) -> Floats:
        """5, 25, 75 and 95 % quantiles of the luminance of each cell, shape (4, 90, 90)."""
        return self._found["quantiles"]

    @property
    def undetermined(self) -> NDArray[np.bool_]:
        """Cells of the table whose 90 % interval is most of what it is without a photograph, shape (90, 90)."""
        return self._found["undetermined"]

    @property
    def open(self) -> float:
        """Share of the undetermined cells in the domain in which both angles are below 80 degrees."""
        return self._found["open"]

    @property
    def materials(self) -> list[tuple[str, float]]:
        """The measured materials that are most like it in the shape of the highlight, not in colour, and their weights."""
        return self._found["materials"]

    @property
    def gloss(self) -> Doubles:
        """5, 50 and 95 % quantiles of the gloss: the BRDF along the normal over its mean at half angles beyond 45 degrees."""
        return self._found["gloss"]

    @property
    def alpha(self) -> Doubles:
        """5, 50 and 95 % quantiles of the width of the GGX lobe that is as sharp; one where there is no highlight."""
        return self._found["alpha"]

    @property
    def roughness(self) -> Doubles:
        """The root of :attr:`alpha`, which the principled models of Mitsuba and Blender take."""
        return np.sqrt(self.alpha)

    @property
    def gloss_units(self) -> dict[int, Doubles]:
        """5, 50 and 95 % quantiles of the gloss units at 20 and at 60 degrees (ASTM D523), by the angle.

        They are on the scale of :attr:`brdf`: of a material whose albedo along the normal is 0.5,
        unless light and photograph are on one scale. They are in proportion to the albedo.
        """
        return dict(zip((20, 60), self._found["gloss_units"], strict=True))

    @property
    def verdict(self) -> str:
        """How far the gloss is known, in words."""
        return self._found["verdict"]

    @property
    def samples(self) -> Floats:
        """64 draws from the posterior, in luminance, shape (64, 90, 90); :meth:`draw` gives others."""
        if self._samples is None:
            self._samples = self.draw(DRAWS)
        return self._samples

    @property
    def rgb_samples(self) -> Floats:
        """The same draws in the colours that were found, shape (64, 90, 90, 3)."""
        if self._rgb_samples is None:
            self._rgb_samples = self._coloured(self.samples)
        return self._rgb_samples

    def draw(self, count: int, seed: int = 0, *, rgb: bool = False) -> Floats:
        """Draw from the posterior over the model's space of materials.

        :attr:`quantiles` are wider: they allow for what the space misses.

        Parameters
        ----------
        count : int
            Number of draws.
        seed : int, default 0
            The same seed gives the same draws.
        rgb : bool, default False
            Give them in the colours that were found, not in luminance. The uncertainty is that of
            the luminance: colours are the same for all draws.

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
        drawn = _gonio.draw(self.model, self._found["likelihood"], whole(count, "count"), whole(seed, "seed"))
        scale = self._scale()
        drawn = drawn if scale == 1.0 else drawn * np.float32(scale)
        return self._coloured(drawn) if flag(rgb, "rgb") else drawn

    @property
    def rgb_quantiles(self) -> Floats | None:
        """5, 25, 75 and 95 % quantiles of each channel, shape (4, 90, 90, 3); None of several photographs."""
        return self._found["rgb_quantiles"]

    def _coloured(self, tables: Floats) -> Floats:
        """Luminance tables of shape (count, 90, 90) in the chroma that was found for every cell."""
        luminance = np.maximum(self.luminance, np.float32(1e-30))
        coloured = np.asarray(tables[..., None] * (self._found["table"] / luminance[..., None]), dtype=np.float32)
        return coloured

    def _scale(self) -> float:
        """Factor from the scale of the model to that of the BRDF."""
        return 1.0

    def _complete(self, result: SavedResult) -> None:
        super()._complete(result)
        result["likelihood"] = self._found["likelihood"]
        result["quantiles"] = self.quantiles
        result["rgb_quantiles"] = self.rgb_quantiles

    def to_xarray(self) -> xarray.Dataset:
        """Make a dataset of xarray: BRDF, quantiles, draws and numbers with named axes.

        Returns
        -------
        xarray.Dataset
            ``brdf``, ``luminance``, ``quantiles``, ``undetermined``, ``samples`` over ``theta_h``
            and ``theta_d`` (radians); ``gloss``, ``alpha``, ``gloss_units`` over ``quantile`` 0.05,
            0.5 and 0.95; of one photograph ``light`` over ``elevation`` and ``azimuth``.

        Raises
        ------
        ImportError
            If xarray is not installed.

        Examples
        --------
        >>> data = found.to_xarray()
        >>> data.brdf.dims
        ('theta_h', 'theta_d', 'channel')
        >>> bool(data.gloss.sel(quantile=0.5) == found.gloss[1])
        True
        """
        return dataset(self, self._lit())

    def to_inference_data(self, count: int = 200, seed: int = 0) -> Any:
        """Make what ArviZ works with: draws from the posterior, and what is said of each.

        The draws are independent: they stand in one chain.

        Parameters
        ----------
        count : int, default 200
            Number of draws.
        seed : int, default 0
            The same seed gives the same draws.

        Returns
        -------
        arviz.InferenceData or xarray.DataTree
            Of ArviZ before 1.0 and from 1.0 on. The group ``posterior`` has ``gloss``, ``alpha``,
            ``gloss_units_20``, ``gloss_units_60`` and ``brdf`` (luminance), all over ``chain`` and
            ``draw``.

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
        return {**super().__getstate__(), "_samples": None, "_rgb_samples": None}
