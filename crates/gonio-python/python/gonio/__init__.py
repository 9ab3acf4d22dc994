"""The BRDF of an object of known shape, with error bars, from one photograph under unknown light.

>>> import gonio
>>> found = gonio.infer("ball.exr")                 # doctest: +SKIP
>>> found.brdf.write("ball.binary")                 # doctest: +SKIP
>>> picture = found.relight("sunset.exr", "bunny")  # doctest: +SKIP

Angles are in radians, BRDFs in 1/sr, pictures linear radiance with row 0 at the top. Axes are those of the camera: x right, y up, z from the
object towards the camera.
"""

from ._brdf import EXPORTS, THETA_D, THETA_H, Brdf, read_brdf, read_merl, render, write_merl
from ._combine import Combined, combine
from ._errors import FileError, GonioError, GonioWarning, MissingFileError
from ._files import read_image, read_normals, write_image
from ._gonio import Model, __version__
from ._infer import infer, read_model
from ._many import Failure, infer_many
from ._posterior import QUANTILES, Posterior
from ._probe import LightProbe, light_probe
from ._regions import infer_regions
from ._render import studio_light
from ._show import tonemapped
from ._train import Part, train_lighting, train_model, train_posterior, train_reflectance

__all__ = [
    "EXPORTS",
    "QUANTILES",
    "THETA_D",
    "THETA_H",
    "Brdf",
    "Combined",
    "Failure",
    "FileError",
    "GonioError",
    "GonioWarning",
    "LightProbe",
    "MissingFileError",
    "Model",
    "Part",
    "Posterior",
    "__version__",
    "combine",
    "infer",
    "infer_many",
    "infer_regions",
    "light_probe",
    "read_brdf",
    "read_image",
    "read_merl",
    "read_model",
    "read_normals",
    "render",
    "studio_light",
    "tonemapped",
    "train_lighting",
    "train_model",
    "train_posterior",
    "train_reflectance",
    "write_image",
    "write_merl",
]
