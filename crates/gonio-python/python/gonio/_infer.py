"""Inference."""

from __future__ import annotations

import os
import warnings
from collections.abc import Callable
from typing import Any, TypeAlias, cast

from . import _gonio
from ._arguments import Camera, Path, Picture, Shape, is_path, light_map, mask as given_mask, picture, shape as given_shape
from ._errors import GonioError, GonioWarning
from ._gonio import Model
from ._posterior import Posterior
from ._types import GivenScene, Settings

Progress: TypeAlias = "Callable[[str, float], object]"
"""Told the name of a stage and the fraction of it that is done."""


def read_model(path: Path) -> Model:
    """Reads a model, as :func:`gonio.train_model` or ``gonio train model`` makes one."""
    return Model.read(os.fspath(path))


def infer(
    image: Picture,
    shape: Shape = "sphere",
    mask: Picture | None = None,
    model: Model | Path | None = None,
    *,
    normals: Picture | None = None,
    circle: tuple[float, float, float] | None = None,
    depth_axis: float | None = None,
    camera: Camera | None = None,
    pose: Camera | None = None,
    trust_normals: bool = False,
    clip: float | None = None,
    keep_colors: bool = False,
    linear: bool = False,
    layer: str | None = None,
    light: Picture | None = None,
    align_light: str = "near",
    absolute: bool = False,
    grid: int = 32,
    color: str = "estimate",
    light_color: tuple[float, float, float] | None = None,
    shadows: bool = True,
    pictures: bool = True,
    report: bool = False,
    progress: Progress | None = None,
) -> Posterior:
    """Infers what an object is made of from one photograph under unknown light.

    The work runs beside Python: other threads go on, and Ctrl-C ends it.

    :param image: the photograph: a file, or an array of linear radiance of shape (height, width, 3), (height, width) or
        (height, width, 4), whose colours are multiplied by alpha. An array of float32 of shape (height, width, 3) in C order is read
        where it is: do not change it before the call returns. Everything else is converted, which copies it; uint8 and uint16 are taken
        as sRGB-coded.
    :param shape: ``"sphere"``, found by its outline; ``"ellipsoid"``; the file of a mesh (OBJ, PLY, glTF), or ``"blob"``, ``"bunny"``,
        ``"bowl"``; (vertices, faces) as arrays; or an array of normals as ``normals`` takes it.
    :param mask: where the object is, 0 to 1: a file, or an array of shape (height, width). Without one the alpha channel or a constant
        background tells.
    :param model: a file, or what :func:`gonio.train_model` returns, instead of the model that travels with the package.
    :param normals: the object's normals, a file or an array of shape (height, width, 3), in camera space with x right, y up and z
        towards the camera; ``trust_normals`` takes them even if they contradict themselves.
    :param circle: outline of a sphere in pixels, x, y (from the top left corner) and radius, if it is not to be found.
    :param depth_axis: semi-axis of an ellipsoid towards the camera, in pixels.
    :param camera: the camera (docs/camera.md), a file or a dictionary; ``pose``: where a mesh is.
    :param clip: radiance at which the camera clips; found where many pixels share the maximum.
    :param keep_colors: observe regions of another colour (paint, stickers) as well, which are left
        out where they are told safely from reflections.
    :param linear: values of integers are linear radiance. ``layer``: which one of an OpenEXR file.
    :param light: the light, if it is known: a lat-long map in coordinates of the camera (a file, or an array of shape (height, 2 height, 3)),
        or a text file of directional lights. The answer is then much sharper.
    :param align_light: how far the light may be turned from where its map has it: ``"near"`` (by a few degrees), ``"around"`` (by any
        angle about the vertical) or ``"fixed"``.
    :param absolute: photograph and light map are on one scale, so that reflectance is absolute and not of albedo 0.5.
    :param grid: texels along a side of the light's grid, a power of two.
    :param color: ``"estimate"``, ``"median"`` or ``"none"``: how the BRDF, which is found from luminance, is coloured.
    :param light_color: linear colour of a white matte ball in the object's place, where it is known.
    :param shadows: whether the object keeps light from itself.
    :param pictures: draw what :attr:`Posterior.pictures` holds, which takes a third of the time.
    :param report: also make the page ``report.html`` for :meth:`Posterior.save`, which takes some seconds more.
    :param progress: called in this thread with the name of a stage and the fraction of it that is done; an exception ends the work.
    :raises GonioError: when something given cannot be used; :class:`FileError` if it is a file that cannot be read.
    """
    options = dict(locals())
    found = run(options, None)
    for message in found.warnings:
        warnings.warn(message, GonioWarning, stacklevel=2)
    return found


def prepared(options: dict[str, Any]) -> tuple[GivenScene, Settings, Model, list[str]]:
    """What :func:`infer` is given by name, for the extension, with warnings so far."""
    image = options["image"]
    name = os.fspath(image) if is_path(image) else "the image"
    said: list[str] = []
    clip = options["clip"]
    if clip is not None and not clip > 0:
        raise GonioError(f"clip {clip}: give a positive radiance")
    light_color = options["light_color"]
    if light_color is not None and len(light_color) != 3:
        raise GonioError("light_color: give three positive numbers on a linear scale")
    shape_names = ("normals", "camera", "pose", "circle", "depth_axis", "trust_normals")
    scene: GivenScene = {
        "name": name,
        "image": picture(image, name, options["linear"], said),
        "linear": options["linear"],
        "layer": options["layer"],
        "mask": given_mask(options["mask"]),
        "clip": clip,
        "keep_colors": options["keep_colors"],
        "object": given_shape(options["shape"], **{key: options[key] for key in shape_names}),
    }
    light = options["light"]
    settings: Settings = {
        "light": None if light is None else light_map(light, said),
        "align_light": options["align_light"],
        "absolute": options["absolute"],
        "grid": options["grid"],
        "shadows": options["shadows"],
        "color": options["color"],
        "pictures": options["pictures"] or options["report"],
        "report": options["report"],
        "light_color": None if light_color is None else cast("tuple[float, float, float]", tuple(light_color)),
    }
    given = options["model"]
    model = Model.embedded() if given is None else given if isinstance(given, Model) else read_model(given)
    return scene, settings, model, said


def run(options: dict[str, Any], poll: Callable[[], object] | None) -> Posterior:
    """:func:`infer` of its arguments by name, without warnings. ``poll`` is called often, and ends the work by raising."""
    scene, settings, model, said = prepared(options)
    found = _gonio.infer(scene, settings, model, {"progress": options["progress"], "poll": poll})
    found["warnings"] = said + found["warnings"]
    return Posterior(found, stem_of(options["image"]))


def stem_of(image: Picture) -> str:
    """What a result is called."""
    return os.path.splitext(os.path.basename(os.fspath(cast(Path, image))))[0] if is_path(image) else "gonio"
