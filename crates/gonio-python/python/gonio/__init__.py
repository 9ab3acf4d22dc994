"""Estimate the BRDF of an object of known shape from one photograph under unknown light.

>>> import gonio
>>> found = gonio.infer("samples/ball.exr")
>>> found.brdf.write(folder / "ball.binary")
>>> picture = found.relight("sky", shape="bunny", size=64)

Angles are in radians and BRDFs in 1/sr. Images contain linear radiance, with row 0 at the top. Axes
are those of the camera: x points right, y up, and z from the object towards the camera. The guide is
docs/python.md. The examples run in the root of the repository, with ``found`` as above and an empty
``folder``.

Constants
---------
THETA_H, THETA_D
    Half and difference angles of a table's rows and columns, in radians, shape (90,) each.
QUANTILES
    Probabilities of :attr:`Posterior.luminance_quantiles`.
EXPORTS
    Names and descriptions of the targets of :meth:`Brdf.export`.
METHODS
    Estimation methods of :func:`infer`.
"""

from ._brdf import EXPORTS, THETA_D, THETA_H, Brdf, render
from ._check import Checked, Merged, check, merge, set_threads
from ._combine import Combined, combine
from ._compare import Comparison, Pair, compare
from ._errors import FileError, GonioError, GonioWarning, MissingFileError
from ._files import read_image, read_normals, write_image
from ._gonio import Model, __version__
from ._infer import METHODS, infer, read_model
from ._many import Failure, infer_many
from ._posterior import QUANTILES, BasisPosterior, Posterior
from ._probe import LightProbe, light_probe
from ._regions import infer_regions
from ._render import studio_light
from ._show import tonemapped
from ._tables import read_brdf, read_merl, write_merl
from ._train import ModelPart, train_colours, train_lighting, train_model, train_posterior, train_reflectance

__all__ = [
    "EXPORTS",
    "METHODS",
    "QUANTILES",
    "THETA_D",
    "THETA_H",
    "BasisPosterior",
    "Brdf",
    "Checked",
    "Combined",
    "Comparison",
    "Failure",
    "FileError",
    "GonioError",
    "GonioWarning",
    "LightProbe",
    "Merged",
    "MissingFileError",
    "Model",
    "ModelPart",
    "Pair",
    "Posterior",
    "__version__",
    "check",
    "combine",
    "compare",
    "infer",
    "infer_many",
    "infer_regions",
    "light_probe",
    "merge",
    "read_brdf",
    "read_image",
    "read_merl",
    "read_model",
    "read_normals",
    "render",
    "set_threads",
    "studio_light",
    "tonemapped",
    "train_colours",
    "train_lighting",
    "train_model",
    "train_posterior",
    "train_reflectance",
    "write_image",
    "write_merl",
]
