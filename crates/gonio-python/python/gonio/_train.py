"""Learning models from measurements."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import TypeAlias, cast

import numpy as np

from . import _gonio
from ._arguments import Array, Path, Picture, Progress, is_path
from ._arrays import floats
from ._brdf import Brdf
from ._checks import choice, listener, number, shown, whole
from ._files import light_map
from ._gonio import Model
from ._types import Floats, LightingOptions, Listeners, PosteriorOptions, ReflectanceOptions

Lights: TypeAlias = "Path | Sequence[Picture]"
"""A folder of lat-long maps (.hdr, .exr, .pfm), or maps as files or arrays."""
Materials: TypeAlias = "Path | Mapping[str, Brdf | Array]"
"""A folder of ``.binary`` (MERL) and ``_rgb.bsdf`` (RGL) files, or BRDFs by name."""

CHANNELS = ("red", "green", "blue", "luminance")


@dataclass(frozen=True, repr=False)
class Part:
    """A part of a model that was learnt: what :func:`train_model` joins.

    Attributes
    ----------
    kind : str
        ``"lighting"``, ``"reflectance"`` or ``"posterior"``.
    provenance : str
        What it was learnt from and how.
    data : bytes
        The file of it.
    errors : dict of str to float
        For a basis of reflectance: how far it is from each material (root mean square over the
        trusted cells, 1/sr).
    """

    kind: str
    provenance: str
    data: bytes
    errors: dict[str, float] = field(default_factory=dict)

    def write(self, path: Path) -> None:
        """Write it as ``gonio train`` does, whole or not at all.

        Parameters
        ----------
        path : str or os.PathLike
            The file.
        """
        _gonio.write_file(os.fspath(path), self.data)

    def __repr__(self) -> str:
        return f"<gonio.Part: {self.provenance}>"


def train_lighting(
    lights: Lights,
    *,
    grid: int = 128,
    layout: str = "equal-area",
    turns: int = 1,
    cap: float | None = None,
    seed: int = 1,
    progress: Progress | None = None,
) -> Part:
    """Learn the prior of light.

    Parameters
    ----------
    lights : path, or sequence of paths or arrays
        A folder of lat-long maps, or files or arrays of them.
    grid : int, default 128
        Texels along a side of the finest grid that it shall serve, a power of two.
    layout : {"equal-area", "praun-hoppe"}, default "equal-area"
        Of the sphere on the square.
    turns : int, default 1
        Azimuths at which each map is seen.
    cap : float, optional
        Cut off each map at this many times its mean, as a camera's range does.
    seed : int, default 1
        Of the fits' starts.
    progress : callable, optional
        Called with the name of a stage and the fraction of it that is done.

    Returns
    -------
    Part
        The prior, for :func:`train_model`.

    Examples
    --------
    >>> rooms = [gonio.studio_light(32), np.roll(gonio.studio_light(32), 9, axis=1)]
    >>> gonio.train_lighting(rooms, grid=8).kind
    'lighting'
    """
    options: LightingOptions = {
        "grid": whole(grid, "grid"),
        "layout": choice(layout, "layout", ("equal-area", "praun-hoppe")),
        "turns": whole(turns, "turns"),
        "cap": None if cap is None else number(cap, "cap"),
        "seed": whole(seed, "seed"),
    }
    data, provenance = _gonio.train_lighting(_lights(lights), options, _listeners(progress))
    return Part("lighting", provenance, data)


def train_reflectance(
    materials: Materials,
    *,
    rank: int = 10,
    channel: str = "green",
    restarts: int | None = None,
    seed: int = 0,
    progress: Progress | None = None,
) -> Part:
    """Learn the basis and the prior of reflectance.

    Parameters
    ----------
    materials : path, or dict of str to Brdf or array
        A folder of measured BRDFs, or BRDFs by name.
    rank : int, default 10
        Number of basis functions.
    channel : {"red", "green", "blue", "luminance"}, default "green"
        What is factorised.
    restarts : int, optional
        Starts of the factorisation.
    seed : int, default 0
        Of the starts.
    progress : callable, optional
        Called with the name of a stage and the fraction of it that is done.

    Returns
    -------
    Part
        The basis, for :func:`train_model`; :attr:`Part.errors` has the error of each material.

    Examples
    --------
    >>> lobe = lambda width: gonio.Brdf.of(lambda h, d: 0.1 + np.exp(-((h / width) ** 2)))
    >>> materials = {str(width): lobe(width) for width in (0.1, 0.2, 0.3, 0.5)}
    >>> part = gonio.train_reflectance(materials, rank=2, restarts=1)
    >>> sorted(part.errors)
    ['0.1', '0.2', '0.3', '0.5']
    """
    options: ReflectanceOptions = {
        "rank": whole(rank, "rank"),
        "channel": choice(channel, "channel", CHANNELS),
        "restarts": None if restarts is None else whole(restarts, "restarts"),
        "seed": whole(seed, "seed"),
    }
    data, provenance, errors = _gonio.train_reflectance(_materials(materials), options, _listeners(progress))
    return Part("reflectance", provenance, data, dict(errors))


def train_posterior(
    lights: Lights,
    materials: Materials,
    *,
    channel: str = "luminance",
    cameras: int | None = None,
    draws: int | None = None,
    steps: int | None = None,
    seed: int = 1,
    progress: Progress | None = None,
) -> Part:
    """Learn the posterior of materials that :func:`gonio.infer` needs.

    It is learnt from simulated photographs of the materials in the lights, which takes hours.

    Parameters
    ----------
    lights, materials
        As :func:`train_lighting` and :func:`train_reflectance` take them.
    channel : {"red", "green", "blue", "luminance"}, default "luminance"
        Of the materials.
    cameras : int, optional
        Cameras in each light.
    draws : int, optional
        Materials before each camera.
    steps : int, optional
        Of the training, each on 128 photographs.
    seed : int, default 1
        Of everything random.
    progress : callable, optional
        Called with the name of a stage and the fraction of it that is done.

    Returns
    -------
    Part
        The posterior, for :func:`train_model`.

    Examples
    --------
    >>> part = gonio.train_posterior("lights/", "materials/")  # doctest: +SKIP
    """
    options: PosteriorOptions = {
        "channel": choice(channel, "channel", CHANNELS),
        "cameras": None if cameras is None else whole(cameras, "cameras"),
        "draws": None if draws is None else whole(draws, "draws"),
        "steps": None if steps is None else whole(steps, "steps"),
        "seed": whole(seed, "seed"),
    }
    data, provenance = _gonio.train_posterior(_lights(lights), _materials(materials), options, _listeners(progress))
    return Part("posterior", provenance, data)


def train_model(lighting: Part | Path, reflectance: Part | Path, posterior: Part | Path | None = None) -> Model:
    """Join what was learnt to a model.

    Parameters
    ----------
    lighting, reflectance : Part or path
        What :func:`train_lighting` and :func:`train_reflectance` return, or files of it.
    posterior : Part or path, optional
        What :func:`train_posterior` returns; :func:`gonio.infer` needs it for all but the methods
        of the paper.

    Returns
    -------
    Model
        For :func:`gonio.infer`.

    Examples
    --------
    >>> model = gonio.train_model("lighting.prior", "reflectance.basis")  # doctest: +SKIP
    """
    return _gonio.join(_part(lighting), _part(reflectance), None if posterior is None else _part(posterior))


def _part(part: Part | Path) -> tuple[bytes, str]:
    if isinstance(part, Part):
        return part.data, f"the {part.kind}"
    if not is_path(part):
        raise TypeError(f"give what train_lighting, train_reflectance or train_posterior returns, or files of it, not {shown(part)}")
    path = os.fspath(part)
    return _gonio.read_file(path), path


def _listeners(progress: Progress | None) -> Listeners:
    listener(progress)
    return {"progress": progress, "poll": None}


def _lights(lights: Lights) -> str | list[Floats]:
    if is_path(lights):
        return os.fspath(cast(Path, lights))
    if not isinstance(lights, Sequence):
        raise TypeError(f"lights: give a folder, or a list of maps, not {shown(lights)}")
    return [light_map(map, f"light {i}") for i, map in enumerate(lights)]


def _materials(materials: Materials) -> str | list[tuple[str, Floats]]:
    if isinstance(materials, Mapping):
        tables = {name: value if isinstance(value, Brdf) else Brdf(value) for name, value in materials.items()}
        return [(name, floats(np.asarray(brdf))) for name, brdf in tables.items()]
    if not is_path(materials):
        raise TypeError(f"materials: give a folder, or a dictionary of BRDFs by name, not {shown(materials)}")
    return os.fspath(materials)
