"""Extension module of the package gonio."""

import os
from collections.abc import Sequence
from typing import TypeAlias, final

import numpy as np
from numpy.typing import NDArray

from ._types import (
    PosteriorData,
    CheckData,
    BasisData,
    MergeData,
    PairData,
    CombinedData,
    GivenReading,
    GivenRegions,
    GivenScene,
    GivenShape,
    LightingOptions,
    Listeners,
    PosteriorOptions,
    ProbeSettings,
    ReflectanceOptions,
    RenderSettings,
    SavedResult,
    Settings,
)

__version__: str

_Floats: TypeAlias = NDArray[np.float32]
_Doubles: TypeAlias = NDArray[np.float64]
_Bytes: TypeAlias = NDArray[np.uint8]

@final
class Model:
    """Model of an inference: light prior, reflectance basis and posterior of materials."""

    @staticmethod
    def embedded() -> Model:
        """Returns the embedded model."""
    @staticmethod
    def read(path: str | os.PathLike[str]) -> Model:
        """Reads a model from a file."""
    @staticmethod
    def decode(bytes: bytes, name: str) -> Model:
        """Decodes a model from the bytes of its file."""
    def write(self, path: str | os.PathLike[str]) -> None:
        """Writes the model to a file, atomically."""
    @property
    def provenance(self) -> str:
        """Training data and settings."""
    @property
    def largest_grid(self) -> int:
        """Largest supported light grid, in texels per side."""
    @property
    def has_posterior(self) -> bool:
        """Whether the model has a posterior of materials."""

@final
class Likelihood:
    """Likelihood of the materials of a model given a photograph, for :func:`draw`."""

    @staticmethod
    def decode(json: str) -> Likelihood:
        """Decodes a pickled likelihood."""

def infer(scene: GivenScene, settings: Settings, model: Model, listeners: Listeners) -> PosteriorData | BasisData: ...
def check(scene: GivenScene, regions: GivenRegions | None, listeners: Listeners) -> CheckData: ...
def merge(images: list[str], reading: GivenReading, listeners: Listeners) -> MergeData: ...
def set_threads(count: int | None) -> None: ...
def light_probe(
    first: GivenScene, second: GivenScene | None, settings: ProbeSettings, listeners: Listeners
) -> tuple[_Floats, _Floats, _Bytes, str, list[str]]: ...
def render(
    table: _Floats,
    full: _Floats | None,
    light: _Floats,
    shape: GivenShape,
    settings: RenderSettings,
    listeners: Listeners,
) -> tuple[_Floats, _Floats, list[str]]: ...
def infer_regions(
    scene: GivenScene, regions: GivenRegions, settings: Settings, model: Model, listeners: Listeners
) -> tuple[list[tuple[str, PosteriorData]], list[str]]: ...
def compare(
    given: Sequence[tuple[str, str | tuple[str, _Floats, NDArray[np.uint8] | None]]],
) -> tuple[list[PairData], str, int]: ...
def combine_all(given: Sequence[str | tuple[str, Likelihood]], model: Model, listeners: Listeners) -> CombinedData: ...
def draw(model: Model, likelihood: Likelihood, count: int, seed: int, errors: bool) -> _Floats: ...
def studio(height: int) -> _Floats: ...
def highlights(tables: _Floats) -> _Doubles: ...
def normal_albedo(table: _Floats) -> float: ...
def eval(table: _Floats, theta_h: _Doubles, theta_d: _Doubles) -> _Doubles: ...
def colour_spaces() -> list[str]: ...
def convert_colours(rgb: _Floats, source: str, target: str) -> _Floats: ...
def read_image(
    path: str, linear: bool, layer: str | None, colorspace: str | None
) -> tuple[_Floats, _Floats | None, float | None, list[str]]: ...
def read_light(path: str, colorspace: str | None) -> _Floats: ...
def read_normals(path: str) -> _Floats: ...
def write_image(path: str, rgb: _Floats, alpha: _Floats | None, clip: float | None, colorspace: str | None) -> None: ...
def encode_png(samples: _Bytes) -> bytes: ...
def read_brdf(path: str, any: bool) -> tuple[_Floats, _Floats]: ...
def write_brdf(path: str, table: _Floats, full: _Floats | None, name: str) -> None: ...
def save(folder: str, result: SavedResult) -> None: ...
def read_file(path: str) -> bytes: ...
def write_file(path: str, bytes: bytes) -> None: ...
def export(
    folder: str,
    table: _Floats,
    full: _Floats | None,
    light: _Floats | None,
    to: Sequence[str] | None,
    name: str,
    albedo: float | None,
    absolute: bool,
    roughness: list[float] | None,
    tables: bool,
    draws: list[_Floats],
    colorspace: str,
    input: str,
    listeners: Listeners,
) -> str: ...
def export_targets() -> list[tuple[str, str]]: ...
def train_lighting(lights: str | list[_Floats], options: LightingOptions, listeners: Listeners) -> tuple[bytes, str]: ...
def train_reflectance(
    materials: str | list[tuple[str, _Floats]], options: ReflectanceOptions, listeners: Listeners
) -> tuple[bytes, str, list[tuple[str, float]]]: ...
def train_posterior(
    lights: str | list[_Floats], materials: str | list[tuple[str, _Floats]], options: PosteriorOptions, listeners: Listeners
) -> tuple[bytes, str]: ...
def train_colours(
    model: Model, lights: str | list[_Floats], materials: str | list[tuple[str, _Floats]], listeners: Listeners
) -> Model: ...
def join(
    lighting: tuple[bytes, str] | None, reflectance: tuple[bytes, str] | None, posterior: tuple[bytes, str] | None
) -> Model: ...
