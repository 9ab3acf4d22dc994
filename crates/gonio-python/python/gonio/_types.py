"""Types of the interface to the extension."""

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
GivenShots: TypeAlias = "GivenPicture | bytes | list[str]"
"""A picture, the bytes of a file, or the files of exposures."""


class Listeners(TypedDict):
    """Callbacks during a computation."""

    progress: Callable[[str, float], object] | None
    poll: Callable[[], object] | None


class GivenNormals(TypedDict):
    """A normal map and its conventions."""

    picture: str | Floats
    order: str
    flip_x: bool
    flip_y: bool
    flip_z: bool
    trusted: bool
    error: float
    depth: str | Doubles | None
    depth_range: tuple[float, float] | None
    depth_along_rays: bool
    positions: str | Doubles | None


class GivenShape(TypedDict):
    """Shape of an object."""

    shape: str
    mesh: str | tuple[Doubles, NDArray[np.uint32]] | None
    normals: GivenNormals | None
    camera: str | bytes | None
    pose: str | bytes | None
    circle: tuple[float, float, float] | None
    depth_axis: float | None


class GivenReading(TypedDict):
    """Options for reading the files of a photograph."""

    linear: bool
    layer: str | None
    times: list[float] | None
    response: str | None
    align: bool
    trust_times: bool
    black_level: float | None
    flat: str | None
    colorspace: str | None


class GivenReference(TypedDict):
    """A neutral reference in a photograph; empty corners mean that the chart is detected."""

    white: tuple[float, float, float] | None
    grey_card: str | Floats | None
    grey_ball: tuple[float, float, float] | None
    corners: list[tuple[float, float]] | None
    reflectance: float | None
    color_only: bool


class GivenScene(TypedDict):
    """A photograph and its object."""

    name: str
    image: GivenShots
    reading: GivenReading
    mask: str | Floats | None
    clip: float | None
    one_material: bool
    force: bool
    object: GivenShape
    reference: GivenReference | None


class GivenRegions(TypedDict):
    """Positions of the regions of a photograph."""

    labels: str | Floats | None
    circles: list[tuple[float, float, float]] | None


class Settings(TypedDict):
    """Settings of an inference."""

    method: str
    starts: int
    seed: int
    solver: str
    all_observations: bool
    grid: int
    light: str | Floats | None
    mirror_ball: tuple[float, float, float] | None
    mirror_reflectance: tuple[float, float, float] | None
    align_light: str
    absolute: bool
    shadows: bool
    color: str
    light_color: tuple[float, float, float] | None
    pictures: bool
    report: bool
    colorspace: str | None
    output_colorspace: str


class RenderSettings(TypedDict):
    """Settings of a rendering."""

    width: int
    height: int
    samples: int
    tolerance: float | None
    shadows: bool


class ProbeSettings(TypedDict):
    """Settings of a light probe."""

    reflectance: tuple[float, float, float]
    rows: int | None
    second_azimuth: float | None


class BrdfData(TypedDict):
    """An estimated BRDF."""

    table: Floats
    colors: Doubles
    luminance: Floats
    pictures: dict[str, Bytes]
    document: str
    model: Model


class BasisData(BrdfData):
    """Result of all methods from one photograph."""

    light: Floats
    albedo_map: Floats | None
    light_color: Doubles
    misfit: float
    warnings: list[str]
    page: str | None


class MaterialData(BrdfData):
    """A material with its uncertainty."""

    ends: tuple[Floats, Floats]
    luminance_quantiles: Floats
    rgb_quantiles: Floats | None
    undetermined: NDArray[np.bool_]
    undetermined_share: float
    materials: list[tuple[str, float]]
    peak_height: Doubles
    ggx_alpha: Doubles
    gloss_units: list[Doubles]
    verdict: str
    likelihood: Likelihood


class PosteriorData(MaterialData, BasisData):
    """Result of an inference."""

    scale: float
    scatter: float


class CheckData(TypedDict):
    """Result of a check."""

    picture: Bytes
    outlines: list[str]
    document: str
    warnings: list[str]


class MergeData(TypedDict):
    """Exposures merged into one image."""

    picture: Floats
    alpha: Floats | None
    origin: NDArray[np.int16]
    clip_level: float
    response: Doubles
    response_file: bytes
    document: str
    warnings: list[str]


class CombinedData(MaterialData):
    """Material from several photographs."""

    agreement: list[float]


class PairData(TypedDict):
    """Comparison of two results."""

    of: list[str]
    agreement: str
    distance: float | None
    sentence: str


class SavedResult(TypedDict):
    """Contents of a result folder."""

    table: Floats
    likelihood: Likelihood | None
    light: Floats | None
    albedo_map: Floats | None
    luminance_quantiles: Floats | None
    rgb_quantiles: Floats | None
    pictures: dict[str, NDArray[np.uint8]]
    document: str
    page: str | None


class LightingOptions(TypedDict):
    """Settings for training the light prior."""

    grid: int
    mapping: str
    rotations: int
    cap: float | None
    seed: int


class ReflectanceOptions(TypedDict):
    """Settings for training the reflectance basis."""

    rank: int
    channel: str
    starts: int | None
    seed: int


class PosteriorOptions(TypedDict):
    """Settings for training the posterior of materials."""

    channel: str
    views: int | None
    group_materials: int | None
    steps: int | None
    initial: Model | None
    seed: int
