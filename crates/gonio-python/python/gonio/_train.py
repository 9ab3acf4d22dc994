"""Training of models on measurements."""

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
from ._validation import choice, integer, listener, number, shown
from ._files import environment_map
from ._gonio import Model
from ._types import Floats, LightingOptions, Listeners, PosteriorOptions, ReflectanceOptions

Lights: TypeAlias = "Path | Sequence[Picture]"
"""A folder of lat-long maps (.hdr, .exr, .pfm), or maps as files or arrays."""
Materials: TypeAlias = "Path | Mapping[str, Brdf | Array]"
"""A folder of ``.binary`` (MERL) and ``_rgb.bsdf`` (RGL) files, or BRDFs by name."""

CHANNELS = ("red", "green", "blue", "luminance")


@dataclass(frozen=True, repr=False)
class ModelPart:
    """A trained part of a model, for :func:`train_model`.

    Attributes
    ----------
    kind : str
        ``"lighting"``, ``"reflectance"`` or ``"posterior"``.
    provenance : str
        Training data and settings.
    data : bytes
        Contents of the file.
    errors : dict of str to float
        For a reflectance basis: root mean square error of each material over the trusted cells,
        in 1/sr.
    """

    kind: str
    provenance: str
    data: bytes
    errors: dict[str, float] = field(default_factory=dict)

    def write(self, path: Path) -> None:
        """Write the part to a file, as ``gonio train`` does, atomically.

        Parameters
        ----------
        path : str or os.PathLike
            The file.
        """
        _gonio.write_file(os.fspath(path), self.data)

    def __repr__(self) -> str:
        return f"<gonio.ModelPart: {self.provenance}>"


def train_lighting(
    lights: Lights,
    *,
    grid: int = 128,
    mapping: str = "equal-area",
    rotations: int = 1,
    cap: float | None = None,
    seed: int = 1,
    progress: Progress | None = None,
) -> ModelPart:
    """Train the light prior.

    Parameters
    ----------
    lights : path, or sequence of paths or arrays
        A folder of lat-long maps, or their files or arrays.
    grid : int, default 128
        Texels along a side of the finest grid of the prior, a power of two.
    mapping : {"equal-area", "praun-hoppe"}, default "equal-area"
        Mapping of the sphere to the square.
    rotations : int, default 1
        Number of azimuths at which each map is used.
    cap : float, optional
        Multiple of its mean at which each map is clipped, like the limited range of a camera.
    seed : int, default 1
        Seed of the random starts of the fits.
    progress : callable, optional
        Called with the name of a stage and its completed fraction.

    Returns
    -------
    ModelPart
        The prior, for :func:`train_model`.

    Examples
    --------
    >>> rooms = [gonio.studio_light(32), np.roll(gonio.studio_light(32), 9, axis=1)]
    >>> gonio.train_lighting(rooms, grid=8).kind
    'lighting'
    """
    options: LightingOptions = {
        "grid": integer(grid, "grid"),
        "mapping": choice(mapping, "mapping", ("equal-area", "praun-hoppe")),
        "rotations": integer(rotations, "rotations"),
        "cap": None if cap is None else number(cap, "cap"),
        "seed": integer(seed, "seed"),
    }
    data, provenance = _gonio.train_lighting(_lights(lights), options, _listeners(progress))
    return ModelPart("lighting", provenance, data)


def train_reflectance(
    materials: Materials,
    *,
    rank: int = 10,
    channel: str = "green",
    starts: int | None = None,
    seed: int = 0,
    progress: Progress | None = None,
) -> ModelPart:
    """Train the reflectance basis and its prior.

    Parameters
    ----------
    materials : path, or dict of str to Brdf or array
        A folder of measured BRDFs, or BRDFs by name.
    rank : int, default 10
        Number of basis functions.
    channel : {"red", "green", "blue", "luminance"}, default "green"
        Channel of the BRDFs to factorise.
    starts : int, optional
        Number of random starts of the factorisation.
    seed : int, default 0
        Seed of the random starts.
    progress : callable, optional
        Called with the name of a stage and its completed fraction.

    Returns
    -------
    ModelPart
        The basis, for :func:`train_model`; :attr:`ModelPart.errors` has the error of each material.

    Examples
    --------
    >>> lobe = lambda width: gonio.Brdf.of(lambda h, d: 0.1 + np.exp(-((h / width) ** 2)))
    >>> materials = {str(width): lobe(width) for width in (0.1, 0.2, 0.3, 0.5)}
    >>> part = gonio.train_reflectance(materials, rank=2, starts=1)
    >>> sorted(part.errors)
    ['0.1', '0.2', '0.3', '0.5']
    """
    options: ReflectanceOptions = {
        "rank": integer(rank, "rank"),
        "channel": choice(channel, "channel", CHANNELS),
        "starts": None if starts is None else integer(starts, "starts"),
        "seed": integer(seed, "seed"),
    }
    data, provenance, errors = _gonio.train_reflectance(_materials(materials), options, _listeners(progress))
    return ModelPart("reflectance", provenance, data, dict(errors))


def train_posterior(
    lights: Lights,
    materials: Materials,
    *,
    channel: str = "luminance",
    views: int | None = None,
    group_materials: int | None = None,
    steps: int | None = None,
    initial: Model | None = None,
    seed: int = 1,
    progress: Progress | None = None,
) -> ModelPart:
    """Train the posterior of materials for :func:`gonio.infer`.

    The training uses simulated photographs of the materials under the lights, and takes hours.

    Parameters
    ----------
    lights, materials
        See :func:`train_lighting` and :func:`train_reflectance`.
    channel : {"red", "green", "blue", "luminance"}, default "luminance"
        Channel of the measured BRDFs.
    views : int, optional
        Number of views of lights in each group of simulated scenes.
    group_materials : int, optional
        Number of materials in each group of simulated scenes.
    steps : int, optional
        Number of training steps, each on 128 simulated photographs.
    initial : Model, optional
        Model whose network initialises the training, for example ``gonio.Model.embedded()``. The
        training then needs fewer steps.
    seed : int, default 1
        Seed of all random numbers.
    progress : callable, optional
        Called with the name of a stage and its completed fraction.

    Returns
    -------
    ModelPart
        The posterior, for :func:`train_model`.

    Examples
    --------
    >>> part = gonio.train_posterior("lights/", "materials/")  # doctest: +SKIP
    """
    options: PosteriorOptions = {
        "channel": choice(channel, "channel", CHANNELS),
        "views": None if views is None else integer(views, "views"),
        "group_materials": None if group_materials is None else integer(group_materials, "group_materials"),
        "steps": None if steps is None else integer(steps, "steps"),
        "initial": initial,
        "seed": integer(seed, "seed"),
    }
    data, provenance = _gonio.train_posterior(_lights(lights), _materials(materials), options, _listeners(progress))
    return ModelPart("posterior", provenance, data)


def train_colours(
    lights: Lights,
    materials: Materials,
    *,
    model: Model | None = None,
    progress: Progress | None = None,
) -> Model:
    """Train only the colour model of an existing model.

    The colour model describes the differences between the channels of a material, the errors with
    which the network estimates these differences, and the chroma of lights.

    Parameters
    ----------
    lights, materials
        See :func:`train_lighting` and :func:`train_reflectance`.
    model : Model, optional
        Model with a posterior of materials. The default is the embedded model.
    progress : callable, optional
        Called with the name of a stage and its completed fraction.

    Returns
    -------
    Model
        The model with the new colour model, for :func:`gonio.infer`.

    Examples
    --------
    >>> model = gonio.train_colours("lights/", "materials/")  # doctest: +SKIP
    """
    given = Model.embedded() if model is None else model
    return _gonio.train_colours(given, _lights(lights), _materials(materials), _listeners(progress))


def train_model(
    lighting: ModelPart | Path | None = None,
    reflectance: ModelPart | Path | None = None,
    posterior: ModelPart | Path | None = None,
) -> Model:
    """Join trained parts into a model.

    Parameters
    ----------
    lighting, reflectance : ModelPart or path, optional
        Results of :func:`train_lighting` and :func:`train_reflectance`, or their files. The default
        is the part of the embedded model.
    posterior : ModelPart or path, optional
        Result of :func:`train_posterior`, or its file. :func:`gonio.infer` requires it, except for
        the methods of the paper.

    Returns
    -------
    Model
        Model for :func:`gonio.infer`.

    Examples
    --------
    >>> model = gonio.train_model("lighting.prior", "reflectance.basis")  # doctest: +SKIP
    """
    return _gonio.join(_part(lighting), _part(reflectance), _part(posterior))


def _part(part: ModelPart | Path | None) -> tuple[bytes, str] | None:
    if part is None:
        return None
    if isinstance(part, ModelPart):
        return part.data, f"the {part.kind}"
    if not is_path(part):
        raise TypeError(f"part: must be a ModelPart or its file, not {shown(part)}")
    path = os.fspath(part)
    return _gonio.read_file(path), path


def _listeners(progress: Progress | None) -> Listeners:
    listener(progress)
    return {"progress": progress, "poll": None}


def _lights(lights: Lights) -> str | list[Floats]:
    if is_path(lights):
        return os.fspath(cast(Path, lights))
    if not isinstance(lights, Sequence):
        raise TypeError(f"lights: must be a folder or a list of maps, not {shown(lights)}")
    return [environment_map(map, f"light {i}") for i, map in enumerate(lights)]


def _materials(materials: Materials) -> str | list[tuple[str, Floats]]:
    if isinstance(materials, Mapping):
        tables = {name: value if isinstance(value, Brdf) else Brdf(value) for name, value in materials.items()}
        return [(name, floats(np.asarray(brdf))) for name, brdf in tables.items()]
    if not is_path(materials):
        raise TypeError(f"materials: must be a folder or a dictionary of BRDFs by name, not {shown(materials)}")
    return os.fspath(materials)
