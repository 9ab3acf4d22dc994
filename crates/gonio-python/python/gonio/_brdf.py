"""Measured, inferred and made-up BRDFs."""

from __future__ import annotations

import base64
import json
import os
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from . import _gonio
from ._arguments import Camera, Path, Picture, Shape, floats
from ._errors import GonioError
from ._files import light_map
from ._render import drawn, frame
from ._show import escaped, tonemapped
from ._types import Floats, Listeners

THETA_H: NDArray[np.float64] = (np.arange(90) / 90) ** 2 * (np.pi / 2)
"""Half angles of the rows of a table, in radians: denser towards the highlight, as in the MERL database."""
THETA_D: NDArray[np.float64] = np.radians(np.arange(90))
"""Difference angles of its columns, in radians."""

EXPORTS: dict[str, str] = dict(_gonio.export_targets())
"""What :meth:`Brdf.export` can write, and what each is."""


class Brdf:
    """An isotropic BRDF in 1/sr: a table of shape (90, 90, 3) over half angle (:data:`THETA_H`), difference angle (:data:`THETA_D`) and
    linear Rec. 709 colour. ``np.asarray(brdf)`` is the table."""

    def __init__(self, table: ArrayLike, full: ArrayLike | None = None, *, name: str = "gonio") -> None:
        array = np.asarray(table)
        if array.shape == (90, 90):
            array = np.repeat(array[:, :, np.newaxis], 3, axis=2)
        if array.shape != (90, 90, 3):
            raise GonioError(f"a BRDF has the shape (90, 90, 3) or (90, 90), not {array.shape}")
        self.table: Floats = floats(array)
        """Shape (90, 90, 3), in 1/sr."""
        self.full: Floats | None = None if full is None else floats(np.asarray(full))
        """Shape (3, 90, 90, 180): all of a table that depends on the third angle, as it was read; negative where there is no value."""
        self.name = name
        """What exported files call it."""
        if self.full is not None and self.full.shape != (3, 90, 90, 180):
            raise GonioError(f"a whole MERL table has the shape (3, 90, 90, 180), not {self.full.shape}")

    @classmethod
    def of(cls, function: Callable[[NDArray[np.float64], NDArray[np.float64]], ArrayLike], *, name: str = "gonio") -> Brdf:
        """Of a formula: ``function(theta_h, theta_d)``, in radians, gives values of the shape of the angles or with an axis of three colours
        more."""
        h, d = np.meshgrid(THETA_H, THETA_D, indexing="ij")
        values = np.asarray(function(h, d))
        return cls(np.broadcast_to(values, (90, 90)) if values.ndim < 2 else values, name=name)

    @property
    def luminance(self) -> Floats:
        """Shape (90, 90)."""
        return floats(self.table @ np.array([0.2126, 0.7152, 0.0722], np.float32))

    @property
    def albedo(self) -> float:
        """Share of light along the normal that is reflected, of the luminance."""
        return _gonio.normal_albedo(self.table)

    def scaled(self, albedo: float) -> Brdf:
        """The same with another :attr:`albedo`, which a photograph under unknown light does not tell."""
        factor = np.float32(albedo / self.albedo)
        return Brdf(self.table * factor, None if self.full is None else self.full * factor, name=self.name)

    def eval(self, theta_h: ArrayLike, theta_d: ArrayLike) -> NDArray[np.float64]:
        """Values at half and difference angles in radians, linear between the samples of the table; one axis of three colours is added
        to the shape of the angles."""
        h, d = np.broadcast_arrays(np.asarray(theta_h, np.float64), np.asarray(theta_d, np.float64))
        return _gonio.eval(self.table, np.ravel(h), np.ravel(d)).reshape(*h.shape, 3)

    def write(self, path: Path) -> None:
        """Writes it by the ending of the name: ``.binary`` (MERL), ``_spec.bsdf`` or ``.bsdf`` (RGL, for pbrt and Mitsuba 3)."""
        _gonio.write_brdf(os.fspath(path), self.table, self.full, self.name)

    def export(
        self,
        directory: Path,
        to: Sequence[str] | str | None = None,
        *,
        name: str | None = None,
        albedo: float | None = None,
        tables: bool = False,
        light: Picture | None = None,
        progress: Callable[[str, float], object] | None = None,
    ) -> dict[str, Any]:
        """Writes files for renderers into a folder, the same as ``gonio export`` does: those of :data:`EXPORTS` that ``to`` names, or all.

        ``albedo`` scales the BRDF first, ``tables`` adds the table of each fitted model. ``light`` is the light of the scenes, a lat-long
        picture; a studio if not given. Returns what ``export.json`` says.
        """
        wanted = [to] if isinstance(to, str) else to
        listeners: Listeners = {"progress": progress, "poll": None}
        called = name or self.name
        lit = None if light is None else light_map(light)
        text = _gonio.export(os.fspath(directory), self.table, self.full, lit, wanted, called, albedo, tables, self.name, listeners)
        summary: dict[str, Any] = json.loads(text)
        return summary

    def render(self, light: Picture | None = None, **options: Any) -> Floats:
        """:func:`gonio.render` of it, in the light that gonio shows its results in if no other is given."""
        return render(self, light, **options)

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> NDArray[Any]:
        if dtype is None or np.dtype(dtype) == self.table.dtype:
            return self.table.copy() if copy else self.table
        if copy is False:
            raise ValueError("the table is float32; another type needs a copy")
        return self.table.astype(dtype)

    def __repr__(self) -> str:
        # The largest value within 80 degrees: beyond, measured tables are extrapolated.
        return f"<gonio.Brdf {self.name!r}: albedo {self.albedo:.3f}, at most {self.table[:84, :80].max():.3g} 1/sr>"

    def _repr_html_(self) -> str:
        data = base64.b64encode(_gonio.encode_png(tonemapped(self.render(size=160)))).decode()
        return f'<img alt="{escaped(self.name)}" src="data:image/png;base64,{data}">'


def render(
    brdf: Brdf | ArrayLike,
    light: Picture | None = None,
    shape: Shape = "sphere",
    size: int | tuple[int, int] = 256,
    *,
    camera: Camera | None = None,
    pose: Camera | None = None,
    samples: int = 1,
    tolerance: float | None = None,
    shadows: bool = True,
    progress: Callable[[str, float], object] | None = None,
) -> Floats:
    """Renders an object of a BRDF under a light.

    :param brdf: what it is made of.
    :param light: a lat-long map in coordinates of the camera (row 0 is up, the centre looks along -z, the right half is +x), as a file or an
        array of shape (height, 2 height, 3); without one :func:`studio_light`.
    :param shape: ``"sphere"``, ``"blob"``, ``"bunny"``, ``"bowl"``, the file of a mesh, or (vertices, faces).
    :param size: width and height in pixels, or both as a pair.
    :param camera: where the camera of a mesh is (docs/camera.md), ``pose``: where the mesh is.
    :param samples: along each side of a pixel.
    :param tolerance: bound the error: the sum of error bounds relative to the radiance; the true error is
        smaller, by some fifty times in detailed light, by five in the worst case known (a coarse even
        map). 0.2 takes ten times as long as the default, a fixed set of half vectors as fine as the
        light's pixels, whose error is about half a percent.
    :param shadows: whether a mesh throws shadows on itself.
    :returns: radiance and coverage, shape (height, width, 4); colour is multiplied by coverage.
    """
    given, settings = frame(shape, size, camera, pose, samples, tolerance, shadows)
    what = brdf if isinstance(brdf, Brdf) else Brdf(brdf)
    return drawn(what.table, what.full, light, given, settings, progress)


def read_merl(path: Path) -> Brdf:
    """Reads a table of the MERL database (``.binary``); the whole table is copied once on its way."""
    return _read(path, False)


def read_brdf(path: Path) -> Brdf:
    """Reads a table of the MERL database or an RGB file of the RGL database (``.bsdf``), told apart by how they begin."""
    return _read(path, True)


def _read(path: Path, any_format: bool) -> Brdf:
    table, full = _gonio.read_brdf(os.fspath(path), any_format)
    return Brdf(table, full, name=os.path.splitext(os.path.basename(os.fspath(path)))[0])


def write_merl(path: Path, brdf: Brdf | ArrayLike) -> None:
    """Writes a table of the MERL database; the name ends in ``.binary``."""
    (brdf if isinstance(brdf, Brdf) else Brdf(brdf)).write(path)
