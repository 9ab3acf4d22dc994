"""What goes to the extension and comes back from it."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, TypeAlias, TypedDict

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from ._gonio import Likelihood, Model

Floats: TypeAlias = NDArray[np.float32]
Doubles: TypeAlias = NDArray[np.float64]
Bytes: TypeAlias = NDArray[np.uint8]

GivenPicture: TypeAlias = "str | Floats | tuple[Floats, Floats]"
"""A file, colours, or colours and coverage."""


class Listeners(TypedDict):
    """Who hears of work while it goes on."""

    progress: Callable[[str, float], object] | None
    poll: Callable[[], object] | None


class GivenShape(TypedDict):
    """What is known of an object's shape."""

    shape: str
    mesh: str | tuple[Doubles, NDArray[np.uint32]] | None
    normals: str | Floats | None
    camera: str | bytes | None
    pose: str | bytes | None
    circle: tuple[float, float, float] | None
    depth_axis: float | None
    trust_normals: bool


class GivenScene(TypedDict):
    """A photograph and its object."""

    name: str
    image: GivenPicture
    linear: bool
    layer: str | None
    mask: str | Floats | None
    clip: float | None
    keep_colors: bool
    object: GivenShape


class GivenRegions(TypedDict):
    """Where the regions of a photograph are."""

    labels: str | Floats | None
    circles: list[tuple[float, float, float]] | None


class Settings(TypedDict):
    """How an answer is to be found."""

    grid: int
    light: str | Floats | None
    align_light: str
    absolute: bool
    shadows: bool
    color: str
    light_color: tuple[float, float, float] | None
    pictures: bool
    report: bool


class RenderSettings(TypedDict):
    """How a picture is made."""

    width: int
    height: int
    samples: int
    tolerance: float | None
    shadows: bool


class ProbeSettings(TypedDict):
    """How a light probe is found."""

    reflectance: tuple[float, float, float]
    rows: int | None
    second_yaw: float | None


class FoundMaterial(TypedDict):
    """A material with its uncertainty."""

    table: Floats
    ends: tuple[Floats, Floats]
    luminance: Floats
    quantiles: Floats
    undetermined: NDArray[np.bool_]
    open: float
    materials: list[tuple[str, float]]
    gloss: list[float]
    alpha: list[float]
    gloss_units: list[list[float]]
    verdict: str
    likelihood: Likelihood
    pictures: dict[str, Bytes]
    notes: str
    model: Model


class Found(FoundMaterial):
    """Everything that inference finds."""

    scale: float
    scatter: float
    light: Floats
    light_color: Floats
    misfit: float
    warnings: list[str]
    page: str | None


class FoundTogether(FoundMaterial):
    """Everything that several photographs tell of a material."""

    agreement: list[float]


class SavedResult(TypedDict):
    """What goes into a folder of results."""

    table: Floats
    likelihood: Likelihood
    light: Floats | None
    quantiles: Floats
    pictures: dict[str, NDArray[np.uint8]]
    notes: str
    page: str | None


class LightingOptions(TypedDict):
    """How the prior of light is learnt."""

    grid: int
    layout: str
    turns: int
    seed: int


class ReflectanceOptions(TypedDict):
    """How the basis of reflectance is learnt."""

    rank: int
    channel: str
    restarts: int | None
    seed: int


class PosteriorOptions(TypedDict):
    """How the posterior of materials is learnt."""

    channel: str
    cameras: int | None
    draws: int | None
    steps: int | None
    seed: int
