"""Learning models from measurements."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TypeAlias, cast

import numpy as np
from numpy.typing import ArrayLike

from . import _gonio
from ._arguments import Path, Picture, floats, is_path
from ._brdf import Brdf
from ._files import light_map
from ._gonio import Model
from ._types import Floats, LightingOptions, Listeners, PosteriorOptions, ReflectanceOptions

Lights: TypeAlias = "Path | Sequence[Picture]"
"""A folder of lat-long maps (.hdr, .exr, .pfm), or maps as files or arrays."""
Materials: TypeAlias = "Path | Mapping[str, Brdf | ArrayLike]"
"""A folder of ``.binary`` (MERL) and ``_rgb.bsdf`` (RGL) files, or BRDFs by name."""
Progress: TypeAlias = "Callable[[str, float], object]"


@dataclass(frozen=True, repr=False)
class Part:
    """A part of a model that was learnt: what :func:`train_model` joins."""

    kind: str
    """``"lighting"``, ``"reflectance"`` or ``"posterior"``."""
    provenance: str
    """What it was learnt from and how."""
    data: bytes
    """The file of it."""
    errors: dict[str, float] = field(default_factory=dict)
    """For a basis of reflectance: how far it is from each material (root mean square over the trusted cells, 1/sr)."""

    def write(self, path: Path) -> None:
        """Writes it as ``gonio train`` does, whole or not at all."""
        _gonio.write_file(os.fspath(path), self.data)

    def __repr__(self) -> str:
        return f"<gonio.Part: {self.provenance}>"


def train_lighting(
    lights: Lights,
    *,
    grid: int = 128,
    layout: str = "equal-area",
    turns: int = 1,
    seed: int = 1,
    progress: Progress | None = None,
) -> Part:
    """Learns the prior of light.

    :param lights: a folder of lat-long maps, or files or arrays of them.
    :param grid: texels along a side of the finest grid that it shall serve, a power of two.
    :param layout: of the sphere on the square: ``"equal-area"`` or ``"praun-hoppe"``.
    :param turns: azimuths at which each map is seen.
    """
    options: LightingOptions = {"grid": grid, "layout": layout, "turns": turns, "seed": seed}
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
    """Learns the basis and the prior of reflectance.

    :param materials: a folder of measured BRDFs, or BRDFs by name.
    :param rank: number of basis functions.
    :param channel: ``"red"``, ``"green"``, ``"blue"`` or ``"luminance"``.
    :param restarts: starts of the factorisation.
    """
    options: ReflectanceOptions = {"rank": rank, "channel": channel, "restarts": restarts, "seed": seed}
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
    """Learns the posterior of materials that :func:`gonio.infer` needs, from simulated photographs of the materials in the lights.

    :param cameras: in each light. ``draws``: materials before each camera. ``steps``: of the training, each on 128 photographs.
    """
    options: PosteriorOptions = {"channel": channel, "cameras": cameras, "draws": draws, "steps": steps, "seed": seed}
    data, provenance = _gonio.train_posterior(_lights(lights), _materials(materials), options, _listeners(progress))
    return Part("posterior", provenance, data)


def train_model(lighting: Part | Path, reflectance: Part | Path, posterior: Part | Path | None = None) -> Model:
    """Joins what was learnt, or the files of it, to a model for :func:`gonio.infer`, which needs the posterior too."""
    return _gonio.join(_part(lighting), _part(reflectance), None if posterior is None else _part(posterior))


def _part(part: Part | Path) -> tuple[bytes, str]:
    if isinstance(part, Part):
        return part.data, f"the {part.kind}"
    path = os.fspath(part)
    return _gonio.read_file(path), path


def _listeners(progress: Progress | None) -> Listeners:
    return {"progress": progress, "poll": None}


def _lights(lights: Lights) -> str | list[Floats]:
    if is_path(lights):
        return os.fspath(cast(Path, lights))
    return [light_map(map, f"light {i}") for i, map in enumerate(cast("Sequence[Picture]", lights))]


def _materials(materials: Materials) -> str | list[tuple[str, Floats]]:
    if isinstance(materials, Mapping):
        tables = {name: value if isinstance(value, Brdf) else Brdf(value) for name, value in materials.items()}
        return [(name, floats(np.asarray(brdf))) for name, brdf in tables.items()]
    return os.fspath(materials)
