"""Measured, inferred and synthetic BRDFs."""

from __future__ import annotations

import base64
import json
import os
import warnings
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from . import _gonio
from ._arguments import Array, Camera, Path, Picture, Progress, Shape
from ._arrays import array_of, floats
from ._validation import choice, flag, listener, numbers, positive, shown, space, space_if_given, text
from ._convert import data_array, mitsuba_bsdf
from ._errors import GonioError, GonioWarning
from ._files import environment_map
from ._render import drawn, render_settings
from ._show import escaped, tonemapped
from ._types import Floats, Listeners

if TYPE_CHECKING:
    import xarray

THETA_H: NDArray[np.float64] = (np.arange(90) / 90) ** 2 * (np.pi / 2)
"""Half angles of the rows of a table, in radians; denser towards the highlight, as in the MERL database."""
THETA_D: NDArray[np.float64] = np.radians(np.arange(90))
"""Difference angles of the columns of a table, in radians."""

EXPORTS: dict[str, str] = dict(_gonio.export_targets())
"""Names and descriptions of the targets of :meth:`Brdf.export`."""


class Brdf:
    """An isotropic BRDF in 1/sr: a table over half angle, difference angle and linear Rec. 709 colour.

    ``np.asarray(brdf)`` is the table. Rows are at the half angles :data:`THETA_H`, columns at the
    difference angles :data:`THETA_D`, both in radians.

    Parameters
    ----------
    table : array
        Shape (90, 90, 3) or (90, 90).
    full : array, optional
        Full table over three angles, shape (3, 90, 90, 180).
    name : str, default "gonio"
        Name in exported files.

    Attributes
    ----------
    table : ndarray of float32
        Shape (90, 90, 3), in 1/sr.
    full : ndarray of float32 or None
        Full table as read from the file, shape (3, 90, 90, 180); negative values are missing.
    name : str
        Name in exported files.

    Examples
    --------
    >>> chalk = gonio.Brdf(np.full((90, 90), 0.9 / np.pi), name="chalk")
    >>> round(chalk.albedo, 3)
    0.9
    """

    def __init__(self, table: Array, full: Array | None = None, *, name: str = "gonio") -> None:
        array = array_of(table, "the BRDF")
        if array.shape == (90, 90):
            array = np.repeat(array[:, :, np.newaxis], 3, axis=2)
        if array.shape != (90, 90, 3):
            raise GonioError(f"a BRDF must have the shape (90, 90, 3) or (90, 90), not {array.shape}")
        self.table: Floats = floats(array)
        self.full: Floats | None = None if full is None else floats(np.asarray(full))
        self.name = text(name, "name")
        if self.full is not None and self.full.shape != (3, 90, 90, 180):
            raise GonioError(f"a full MERL table must have the shape (3, 90, 90, 180), not {self.full.shape}")

    @classmethod
    def of(cls, function: Callable[[NDArray[np.float64], NDArray[np.float64]], ArrayLike], *, name: str = "gonio") -> Brdf:
        """Create a BRDF from a function.

        Parameters
        ----------
        function : callable
            ``function(theta_h, theta_d)`` with angles in radians. It returns values with the shape
            of the angles, optionally with an additional axis of three colours.
        name : str, default "gonio"
            Name in exported files.

        Returns
        -------
        Brdf
            The tabulated function.

        Examples
        --------
        >>> gonio.Brdf.of(lambda h, d: 0.1 + np.exp(-((h / 0.2) ** 2)), name="satin")
        <gonio.Brdf 'satin': albedo 0.767, at most 1.1 1/sr>
        """
        h, d = np.meshgrid(THETA_H, THETA_D, indexing="ij")
        values = np.asarray(function(h, d))
        return cls(np.broadcast_to(values, (90, 90)) if values.ndim < 2 else values, name=name)

    @property
    def luminance(self) -> Floats:
        """Luminance of the table, shape (90, 90)."""
        return floats(self.table @ np.array([0.2126, 0.7152, 0.0722], np.float32))

    @property
    def albedo(self) -> float:
        """Luminance albedo at normal incidence."""
        return _gonio.normal_albedo(self.table)

    @property
    def peak_height(self) -> float:
        """Ratio of the BRDF along the normal to its mean at half angles above 45 degrees; 1 for chalk, thousands for polished metal."""
        return self._highlight()[0]

    @property
    def ggx_alpha(self) -> float:
        """Width of the GGX lobe of equal sharpness; 1 without a highlight."""
        return self._highlight()[1]

    @property
    def gloss_units(self) -> dict[int, float]:
        """Gloss units at 20 and at 60 degrees (ASTM D523: black glass has 100), by angle."""
        return dict(zip((20, 60), self._highlight()[2:]))

    def _highlight(self) -> list[float]:
        values: list[float] = _gonio.highlights(self.luminance[np.newaxis])[0].tolist()
        return values

    def scaled(self, albedo: float) -> Brdf:
        """Scale the BRDF to another :attr:`albedo`, which a photograph under unknown light does not determine.

        Parameters
        ----------
        albedo : float
            Luminance albedo at normal incidence.

        Returns
        -------
        Brdf
            A scaled copy.

        Examples
        --------
        >>> round(found.brdf.scaled(0.2).albedo, 4)
        0.2
        """
        factor = np.float32(positive(albedo, "albedo") / self.albedo)
        return Brdf(self.table * factor, None if self.full is None else self.full * factor, name=self.name)

    def grey(self) -> Brdf:
        """Return the BRDF with the luminance in all channels.

        Returns
        -------
        Brdf
            A grey copy, without :attr:`full`.

        Examples
        --------
        >>> grey = found.brdf.grey().table
        >>> bool((grey[..., 0] == grey[..., 2]).all())
        True
        """
        return Brdf(self.luminance, name=self.name)

    def eval(self, theta_h: ArrayLike, theta_d: ArrayLike) -> NDArray[np.float64]:
        """Evaluate the BRDF by linear interpolation of the table.

        Parameters
        ----------
        theta_h, theta_d : array
            Half and difference angles in radians, of shapes that broadcast.

        Returns
        -------
        ndarray of float64
            Values in 1/sr, with the shape of the angles and an additional axis of three colours.

        Examples
        --------
        >>> gonio.Brdf.of(lambda h, d: 1 + 0 * h).eval([0, 0.1, 0.2], 0.3).shape
        (3, 3)
        """
        try:
            h, d = np.broadcast_arrays(np.asarray(theta_h, np.float64), np.asarray(theta_d, np.float64))
        except (TypeError, ValueError) as error:
            raise GonioError(f"theta_h and theta_d: must be angles in radians: {error}") from None
        return _gonio.eval(self.table, np.ravel(h), np.ravel(d)).reshape(*h.shape, 3)

    def write(self, path: Path) -> None:
        """Write the BRDF to a file, atomically.

        Parameters
        ----------
        path : str or os.PathLike
            The extension determines the format: ``.binary`` (MERL), ``_spec.bsdf`` or ``.bsdf`` (RGL, for pbrt
            and Mitsuba 3), ``.mbsdf`` (NVIDIA's MDL), ``.npz`` or ``.csv``.

        Examples
        --------
        >>> found.brdf.write(folder / "ball.binary")
        """
        _gonio.write_brdf(os.fspath(path), self.table, self.full, self.name)

    def export(
        self,
        directory: Path,
        to: Sequence[str] | str | None = None,
        *,
        name: str | None = None,
        albedo: float | Literal["fit"] | None = None,
        tables: bool = False,
        draws: ArrayLike | None = None,
        roughness: Sequence[float] | None = None,
        light: Picture | None = None,
        output_colorspace: str = "rec709",
        progress: Progress | None = None,
    ) -> dict[str, Any]:
        """Write files for renderers into a folder, as ``gonio export`` does.

        Parameters
        ----------
        directory : str or os.PathLike
            The folder.
        to : str or sequence of str, optional
            Names from :data:`EXPORTS`; all but the large tables ``merl`` and ``merl-grey`` by default.
        name : str, optional
            Name of the material.
        albedo : float or "fit", optional
            Scale the BRDF to this albedo first. "fit" is the albedo, at most that of the BRDF, at
            which the models of renderers fit best: the default of ``gonio export`` for a
            photograph that does not determine the albedo.
        tables : bool, default False
            Also write the table of each fitted model.
        draws : array_like, optional
            Draws from the posterior of the BRDF, shape (n, 90, 90, 3), such as
            ``found.draw(16, rgb=True, errors=True)``. With draws, the summary contains the 90 %
            interval of each fitted parameter.
        roughness : sequence of two float, optional
            Ends of the interval of the roughness of the highlight. The models of renderers then
            have a roughness within the interval and no coat, unless the error would increase
            clearly.
        light : path or array, optional
            Light of the exported scenes, a lat-long map; a studio light by default.
        output_colorspace : str, default "rec709"
            Colour space of the tables ``merl`` and ``bsdf``; all other files are linear Rec. 709.
        progress : callable, optional
            Called with the name of a stage and its completed fraction.

        Returns
        -------
        dict
            Contents of ``export.json``: the files and their errors.

        Warns
        -----
        GonioWarning
            If a model cannot represent the BRDF.

        Examples
        --------
        >>> summary = found.brdf.export(folder / "export", ["merl", "ward"])
        >>> list(summary["exports"])
        ['merl', 'ward']
        """
        wanted = [to] if isinstance(to, str) else to
        if wanted is not None and not all(isinstance(one, str) for one in wanted):
            raise TypeError(f"to: must be names of gonio.EXPORTS, not {shown(to)}")
        listener(progress)
        listeners: Listeners = {"progress": progress, "poll": None}
        called = text(name or self.name, "name")
        scale = None if albedo is None or albedo == "fit" else positive(albedo, "albedo")
        lit = None if light is None else environment_map(light)
        written = space(output_colorspace, "output_colorspace")
        ends = None if roughness is None else numbers(roughness, "roughness", "two numbers", 2)
        given = [] if draws is None else [Brdf(table).table for table in np.asarray(draws)]
        document = _gonio.export(
            os.fspath(directory),
            self.table,
            self.full,
            lit,
            wanted,
            called,
            scale,
            albedo != "fit",
            ends,
            flag(tables, "tables"),
            given,
            written,
            self.name,
            listeners,
        )
        summary: dict[str, Any] = json.loads(document)
        for message in summary["warnings"]:
            warnings.warn(message, GonioWarning, stacklevel=2)
        return summary

    def render(self, light: Picture | None = None, **options: Any) -> Floats:
        """Render the BRDF with :func:`gonio.render`.

        Parameters
        ----------
        light : path or array, optional
            A lat-long map; :func:`gonio.studio_light` by default.
        **options
            Other arguments of :func:`gonio.render`.

        Returns
        -------
        ndarray of float32
            Radiance and coverage, shape (height, width, 4).

        Examples
        --------
        >>> found.brdf.render(size=32).shape
        (32, 32, 4)
        """
        return render(self, light, **options)

    def to_xarray(self) -> xarray.DataArray:
        """Convert to an xarray array with named axes.

        Returns
        -------
        xarray.DataArray
            Array over ``theta_h``, ``theta_d`` (radians) and ``channel``.

        Raises
        ------
        ImportError
            If xarray is not installed.

        Examples
        --------
        >>> found.brdf.to_xarray().sel(channel="red").dims
        ('theta_h', 'theta_d')
        """
        return data_array(self)

    def to_mitsuba(self, plugin: str = "measured") -> Any:
        """Create a Mitsuba 3 BSDF for the current variant.

        Parameters
        ----------
        plugin : {"measured", "principled"}, default "measured"
            The table itself (RGB or spectral, depending on the variant), or the best fit of Mitsuba's
            ``principled`` BSDF, which takes some seconds.

        Returns
        -------
        mitsuba.BSDF
            BSDF for a scene.

        Raises
        ------
        ImportError
            If Mitsuba is not installed.
        GonioError
            If no Mitsuba variant is set.

        Examples
        --------
        >>> import mitsuba                                        # doctest: +SKIP
        >>> mitsuba.set_variant("llvm_ad_rgb")                    # doctest: +SKIP
        >>> sphere = {"type": "sphere", "material": found.brdf.to_mitsuba()}  # doctest: +SKIP
        """
        return mitsuba_bsdf(self, choice(plugin, "plugin", ("measured", "principled")))

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> NDArray[Any]:
        if dtype is None or np.dtype(dtype) == self.table.dtype:
            return self.table.copy() if copy else self.table
        if copy is False:
            raise ValueError("the table is float32; another type requires a copy")
        return self.table.astype(dtype)

    def __repr__(self) -> str:
        # The largest value below 80 degrees, because measured tables are extrapolated above.
        return f"<gonio.Brdf {self.name!r}: albedo {self.albedo:.3f}, at most {self.table[:84, :80].max():.3g} 1/sr>"

    def _repr_html_(self) -> str:
        data = base64.b64encode(_gonio.encode_png(tonemapped(self.render(size=160)))).decode()
        return f'<img alt="{escaped(self.name)}" src="data:image/png;base64,{data}">'


def render(
    brdf: Brdf | Array,
    light: Picture | None = None,
    shape: Shape = "sphere",
    size: int | tuple[int, int] = 256,
    *,
    camera: Camera | None = None,
    pose: Camera | None = None,
    samples: int = 1,
    tolerance: float | None = None,
    shadows: bool = True,
    colorspace: str | None = None,
    progress: Progress | None = None,
) -> Floats:
    """Render an object with a BRDF under a light.

    Parameters
    ----------
    brdf : Brdf or array
        BRDF of the object.
    light : path, str or array, optional
        A lat-long map, as a file or an array of shape (height, 2 height, 3); a text file of
        directional lights; or a built-in light, ``"studio"``, ``"sky"`` or ``"lamp"``. A map is in
        camera coordinates: row 0 is up, the centre is -z, and the right half is +x. The default is
        :func:`studio_light`.
    shape : str, path or pair of arrays, default "sphere"
        ``"sphere"``, ``"blob"``, ``"bunny"``, ``"bowl"``, the file of a mesh, or (vertices, faces).
    size : int or (int, int), default 256
        Size in pixels, or (width, height).
    camera, pose : path or dict, optional
        Camera parameters and pose of a mesh (docs/camera.md).
    samples : int, default 1
        Samples per pixel along each axis.
    tolerance : float, optional
        Upper bound of the relative error of the radiance. The true error is smaller, by about fifty
        times under detailed light and by five in the worst known case (a coarse uniform map). 0.2
        takes ten times as long as the default, which samples half vectors at the resolution of the
        environment map with an error of about 0.5 %.
    shadows : bool, default True
        Model self-shadowing of a mesh.
    colorspace : str, optional
        Colour space of an environment map that states none, as for :func:`infer`.
    progress : callable, optional
        Called with the name of a stage and its completed fraction.

    Returns
    -------
    ndarray of float32
        Radiance and coverage, shape (height, width, 4); colours are premultiplied by coverage.

    Examples
    --------
    >>> chalk = gonio.Brdf.of(lambda h, d: 0.25 + 0 * h)
    >>> gonio.render(chalk, "sky", "bunny", size=(40, 30)).shape
    (30, 40, 4)
    """
    given, settings = render_settings(shape, size, camera, pose, samples, tolerance, shadows)
    what = brdf if isinstance(brdf, Brdf) else Brdf(brdf)
    return drawn(what.table, what.full, light, given, settings, progress, space_if_given(colorspace, "colorspace"))
