"""Converts results for other packages, which are imported only on demand."""

from __future__ import annotations

import importlib
import os
import tempfile
from typing import TYPE_CHECKING, Any

import numpy as np

from . import _gonio
from ._errors import GonioError
from ._types import Floats

if TYPE_CHECKING:
    import xarray

    from ._brdf import Brdf
    from ._material import Material

QUANTILES = (0.05, 0.25, 0.75, 0.95)
"""Probabilities of :attr:`Posterior.luminance_quantiles`."""

BOUNDS = ("low", "median", "high")
"""Names of the three numbers of attributes such as :attr:`Posterior.roughness`."""


def import_optional(module: str, asked: str, package: str | None = None) -> Any:
    """Imports a module, or raises an error with the command to install it."""
    try:
        return importlib.import_module(module)
    except ImportError as error:
        package = package or module
        raise ImportError(f"{asked} requires {package}; install it with: pip install {package}") from error


def angles() -> dict[str, Any]:
    """Returns the coordinates of a table."""
    from ._brdf import THETA_D, THETA_H

    return {"theta_h": ("theta_h", THETA_H, {"units": "rad"}), "theta_d": ("theta_d", THETA_D, {"units": "rad"})}


def data_array(brdf: Brdf) -> xarray.DataArray:
    """Converts a BRDF to an array with named axes."""
    module: Any = import_optional("xarray", "to_xarray")
    coordinates = {**angles(), "channel": ["red", "green", "blue"]}
    attributes = {"units": "1/sr", "long_name": "BRDF", "albedo": brdf.albedo}
    out: xarray.DataArray = module.DataArray(brdf.table, coordinates, ("theta_h", "theta_d", "channel"), brdf.name, attributes)
    return out


def dataset(found: Material, light: Floats | None) -> xarray.Dataset:
    """Converts a material to a dataset with named axes."""
    module: Any = import_optional("xarray", "to_xarray")
    cells = ("theta_h", "theta_d")
    per_sr = {"units": "1/sr"}
    values: dict[str, Any] = {
        "brdf": ((*cells, "channel"), found.brdf.table, per_sr),
        "luminance": (cells, found.luminance, per_sr),
        "luminance_quantiles": (("quantile", *cells), found.luminance_quantiles, per_sr),
        "undetermined": (cells, found.undetermined),
        "luminance_draws": (("draw", *cells), found.luminance_draws, per_sr),
        "peak_height": ("bound", found.peak_height),
        "ggx_alpha": ("bound", found.ggx_alpha),
        "gloss_units": (("angle", "bound"), np.stack(list(found.gloss_units.values()))),
    }
    coordinates: dict[str, Any] = {
        **angles(),
        "channel": ["red", "green", "blue"],
        "quantile": list(QUANTILES),
        "bound": list(BOUNDS),
        "angle": ("angle", list(found.gloss_units), {"units": "degree"}),
    }
    if light is not None:
        height, width = light.shape[:2]
        values["light"] = (("elevation", "azimuth", "channel"), light)
        coordinates["elevation"] = ("elevation", 90 - 180 * (np.arange(height) + 0.5) / height, {"units": "degree"})
        coordinates["azimuth"] = ("azimuth", 360 * (np.arange(width) + 0.5) / width - 180, {"units": "degree"})
    attributes = {"name": found.brdf.name, "albedo": found.brdf.albedo, "verdict": found.verdict, "undetermined_share": found.undetermined_share}
    out: xarray.Dataset = module.Dataset(values, coordinates, attributes)
    return out


def inference_data(draws: Floats) -> Any:
    """Converts draws for ArviZ: ``from_dict`` takes groups as keywords before 1.0, and as a dictionary since."""
    try:
        arviz: Any = importlib.import_module("arviz")
    except ImportError:
        # The package of ArviZ 1.0 that contains the conversion.
        arviz = import_optional("arviz_base", "to_inference_data", "arviz")
    numbers = _gonio.highlights(draws)
    names = ("peak_height", "ggx_alpha", "gloss_units_20", "gloss_units_60")
    posterior: dict[str, Any] = {name: numbers[np.newaxis, :, column] for column, name in enumerate(names)}
    posterior["brdf"] = draws[np.newaxis]
    coordinates = {name: values[1] for name, values in angles().items()}
    axes = {"brdf": list(coordinates)}
    if hasattr(arviz, "InferenceData"):
        return arviz.from_dict(posterior=posterior, coords=coordinates, dims=axes)
    return arviz.from_dict({"posterior": posterior}, coords=coordinates, dims=axes)


def mitsuba_bsdf(brdf: Brdf, plugin: str) -> Any:
    """Creates a Mitsuba BSDF from temporary files."""
    mitsuba = import_optional("mitsuba", "to_mitsuba")
    variant = mitsuba.variant()
    if variant is None:
        raise GonioError('to_mitsuba: no Mitsuba variant is set; first call mitsuba.set_variant("llvm_ad_rgb") or another variant')
    with tempfile.TemporaryDirectory(prefix="gonio-") as folder:
        if plugin == "principled":
            brdf.export(folder, "mitsuba")
            return mitsuba.load_file(os.path.join(folder, "principled.xml"))
        path = os.path.join(folder, "brdf_spec.bsdf" if "spectral" in variant else "brdf_rgb.bsdf")
        brdf.write(path)
        return mitsuba.load_dict({"type": "measured", "filename": path})
