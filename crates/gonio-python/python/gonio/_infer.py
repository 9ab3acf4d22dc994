"""Inference."""

from __future__ import annotations

import os
import warnings
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any, Literal, TypedDict, cast, overload

from . import _gonio
from ._arguments import Camera, Path, Photograph, Picture, Progress, Shape, is_path
from ._arrays import light_map, name_of
from ._checks import choice, flag, listener, numbers, shown, space, space_if_given, whole
from ._errors import GonioError, GonioWarning
from ._gonio import Model
from ._posterior import BasisPosterior, Posterior
from ._scene import given_scene
from ._types import Found, GivenScene, Settings

if TYPE_CHECKING:
    from typing_extensions import Unpack

METHODS = ("learnt", "known-light", "variational", "map", "known-light-basis", "paper")
"""How a material may be found."""

IN_BASIS = ("variational", "map", "known-light-basis", "paper")
"""Methods of the paper, which find coefficients in a basis."""


def read_model(path: Path) -> Model:
    """Read a model, as :func:`gonio.train_model` or ``gonio train model`` makes one.

    Parameters
    ----------
    path : str or os.PathLike
        The file.

    Returns
    -------
    Model
        To be given as ``model`` to :func:`gonio.infer`.

    Raises
    ------
    GonioError
        If it is no model, or damaged.
    FileError
        If it cannot be read.

    Examples
    --------
    >>> gonio.Model.embedded().write(folder / "my.model")
    >>> gonio.read_model(folder / "my.model").largest_grid
    128
    """
    return Model.read(os.fspath(path))


class Options(TypedDict, total=False):
    """Arguments of :func:`infer` by name, for those who check types."""

    mask: Picture | None
    model: Model | Path | None
    times: Sequence[float] | None
    response: Path | None
    black_level: float | None
    flat: Path | None
    linear: bool
    layer: str | None
    colorspace: str | None
    output_colorspace: str
    clip: float | None
    keep_colors: bool
    normals: Picture | None
    normals_order: str
    normals_flip_x: bool
    normals_flip_y: bool
    normals_flip_z: bool
    trust_normals: bool
    depth: Picture | None
    depth_range: tuple[float, float] | None
    depth_along_rays: bool
    positions: Picture | None
    circle: tuple[float, float, float] | None
    depth_axis: float | None
    camera: Camera | None
    pose: Camera | None
    light: Picture | None
    align_light: str | None
    absolute: bool
    shadows: bool
    grid: int | None
    starts: int | None
    seed: int | None
    solver: str | None
    full_rows: bool
    color: str
    light_color: Sequence[float] | None
    white: tuple[float, float, float] | None
    grey_card: Picture | None
    color_checker: bool | str | Sequence[float] | Sequence[tuple[float, float]]
    reference_reflectance: float | None
    reference_color_only: bool
    pictures: bool
    report: bool
    progress: Progress | None


@overload
def infer(
    image: Photograph, shape: Shape = ..., *, method: Literal["learnt", "known-light"] | None = ..., **options: Unpack[Options]
) -> Posterior: ...
@overload
def infer(
    image: Photograph,
    shape: Shape = ...,
    *,
    method: Literal["variational", "map", "known-light-basis", "paper"],
    **options: Unpack[Options],
) -> BasisPosterior: ...
def infer(
    image: Photograph,
    shape: Shape = "sphere",
    mask: Picture | None = None,
    model: Model | Path | None = None,
    *,
    times: Sequence[float] | None = None,
    response: Path | None = None,
    black_level: float | None = None,
    flat: Path | None = None,
    linear: bool = False,
    layer: str | None = None,
    colorspace: str | None = None,
    output_colorspace: str = "rec709",
    clip: float | None = None,
    keep_colors: bool = False,
    normals: Picture | None = None,
    normals_order: str = "xyz",
    normals_flip_x: bool = False,
    normals_flip_y: bool = False,
    normals_flip_z: bool = False,
    trust_normals: bool = False,
    depth: Picture | None = None,
    depth_range: tuple[float, float] | None = None,
    depth_along_rays: bool = False,
    positions: Picture | None = None,
    circle: tuple[float, float, float] | None = None,
    depth_axis: float | None = None,
    camera: Camera | None = None,
    pose: Camera | None = None,
    light: Picture | None = None,
    align_light: str | None = None,
    absolute: bool = False,
    shadows: bool = True,
    method: str | None = None,
    grid: int | None = None,
    starts: int | None = None,
    seed: int | None = None,
    solver: str | None = None,
    full_rows: bool = False,
    color: str = "estimate",
    light_color: Sequence[float] | None = None,
    white: tuple[float, float, float] | None = None,
    grey_card: Picture | None = None,
    color_checker: bool | str | Sequence[float] | Sequence[tuple[float, float]] = False,
    reference_reflectance: float | None = None,
    reference_color_only: bool = False,
    pictures: bool = True,
    report: bool = False,
    progress: Progress | None = None,
) -> Posterior | BasisPosterior:
    """Infer what an object is made of from one photograph under unknown light.

    The work runs beside Python: other threads go on, and Ctrl-C ends it. Arrays are NumPy arrays,
    or anything that becomes one: lists, PIL images, ``xarray.DataArray`` (axes named y, x and
    channel in any order), tensors (PyTorch's channels-first too).

    Parameters
    ----------
    image : path, array, bytes, open file, or list of paths
        The photograph: a file, its bytes, or an array of linear radiance of shape (height, width,
        3), (height, width) or (height, width, 4), whose colours are multiplied by alpha. float32 of
        shape (height, width, 3) in C order is read where it is: do not change it before the call
        returns. Everything else is converted, which copies it; uint8 and uint16 are taken as
        sRGB-coded. A list of paths is the exposures of one scene, to be merged.
    shape : str, path, array or pair of arrays, default "sphere"
        ``"sphere"``, found by its outline; ``"ellipsoid"``; the file of a mesh (OBJ, PLY, glTF), or
        ``"blob"``, ``"bunny"``, ``"bowl"``; (vertices, faces) as arrays; or an array of normals as
        ``normals`` takes it.
    mask : path or array, optional
        Where the object is, 0 to 1, shape (height, width). Without one the alpha channel or a
        plain background tells, or the edges of a ball. One of another size is scaled.
    model : Model or path, optional
        Instead of the model that travels with the package.
    times : sequence of float, optional
        Exposure times in seconds, one for each file, in place of those of the EXIF data.
    response : path, optional
        The camera's curve, if it is not to be recovered from the exposures: ``"srgb"``,
        ``"linear"``, or a file as :meth:`Merged.write_response` makes it.
    black_level : float, optional
        Black level of linear integer files, in their codes (0 to 255, or to 65535).
    flat : path, optional
        Picture of an evenly lit surface by the same lens, to divide by.
    linear : bool, default False
        Values of integers are linear radiance, not sRGB-coded.
    layer : str, optional
        Layer of an OpenEXR file that holds several.
    colorspace : str, optional
        Colour space of files that state none, and of arrays: ``"rec709"`` (if not given; also
        ``"srgb"``), ``"display-p3"``, ``"rec2020"``, ``"acescg"``, ``"aces2065-1"``, ``"xyz"``
        (docs/colour-spaces.md). It holds for the light map too.
    output_colorspace : str, default "rec709"
        Colour space of the BRDF and the light that :meth:`Posterior.save` writes. Arrays are linear
        Rec. 709 whatever it is.
    clip : float, optional
        Radiance at which the camera clips; found where many pixels share the maximum.
    keep_colors : bool, default False
        Observe regions of another colour (paint, stickers) as well, which are left out where they
        are told safely from reflections.
    normals : path or array, optional
        The object's normals, shape (height, width, 3), in camera space: x right, y up, z towards
        the camera.
    normals_order : str, default "xyz"
        Which axis each channel of the normals holds.
    normals_flip_x, normals_flip_y, normals_flip_z : bool, default False
        The normals' x points left, their y down (as for DirectX), their z away from the camera.
    trust_normals : bool, default False
        Take the normals as they are even if they contradict themselves.
    depth : path or array, optional
        The object's depth, shape (height, width), in the unit of the camera, to know which light it
        keeps from itself; 0 or NaN where there is no surface. It goes with ``normals``.
    depth_range : (float, float), optional
        Depths that the codes 0 and 1 of an integer picture stand for.
    depth_along_rays : bool, default False
        Depths are distances along the rays, not along the camera's axis.
    positions : path or array, optional
        The object's positions in coordinates of the camera, shape (height, width, 3), instead of
        ``depth``. They need ``camera``.
    circle : (float, float, float), optional
        Outline of a sphere in pixels, x, y (from the top left corner) and radius, if it is not to
        be found.
    depth_axis : float, optional
        Semi-axis of an ellipsoid towards the camera, in pixels.
    camera, pose : path or dict, optional
        The camera, and where a mesh is (docs/camera.md).
    light : path or array, optional
        The light, if it is known: a lat-long map in coordinates of the camera, shape (height, 2
        height, 3), or a text file of directional lights. The answer is then much sharper.
    align_light : {"near", "around", "fixed"}, optional
        How far the light may be turned from where its map has it: by a few degrees (if not given),
        by any angle about the vertical, or not at all.
    absolute : bool, default False
        Photograph and light map are on one scale, so that reflectance is absolute and not of albedo
        0.5.
    shadows : bool, default True
        Whether the object keeps light from itself.
    method : str, optional
        ``"learnt"`` (if not given and ``light`` is not), ``"known-light"`` (if ``light`` is), or a
        method of the paper, which returns a :class:`BasisPosterior`: ``"variational"`` (Algorithm
        1), ``"map"`` (the joint maximum), ``"known-light-basis"``, ``"paper"`` (the paper's own
        version, on a sphere).
    grid : int, optional
        Texels along a side of the light's grid, a power of two; 32 if not given.
    starts, seed : int, optional
        Random starts of the methods of the paper (4), and their seed (1).
    solver : {"blocks", "parallel", "printed"}, optional
        Solver of ``method="variational"``.
    full_rows : bool, default False
        Run ``"variational"`` or ``"map"`` on all observations instead of their projection.
    color : {"estimate", "median", "none"}, default "estimate"
        How the BRDF, which is found from luminance, is coloured.
    light_color : sequence of 3 floats, optional
        Linear colour of a white matte ball in the object's place, where it is known.
    white : (float, float, float), optional
        White patch in the picture: x, y (from the top left corner) and radius of a disk in pixels.
        It fixes the colour of the light and, if it faces the camera beside the object, the scale of
        the BRDF.
    grey_card : path or array, optional
        Grey card in the picture, for the same: a mask that is above 0.5 on it, shape (height,
        width).
    color_checker : bool or sequence, default False
        24-patch colour chart (ColorChecker Classic) in the picture, for the same: True detects it;
        four (x, y) in pixels, or eight numbers, are the centres of its corner patches in the order
        dark skin, bluish green, black, white.
    reference_reflectance : float, optional
        Diffuse reflectance of the patch: 0.9 for ``white`` and 0.18 for ``grey_card`` if not given.
    reference_color_only : bool, default False
        Use the colour of the reference and not the scale: it does not face the camera, or gets
        other light than the object.
    pictures : bool, default True
        Draw what :attr:`Posterior.pictures` holds, which takes a third of the time.
    report : bool, default False
        Also make the page ``report.html`` for :meth:`Posterior.save`.
    progress : callable, optional
        Called in this thread with the name of a stage and the fraction of it that is done; an
        exception ends the work.

    Returns
    -------
    Posterior or BasisPosterior
        The material with its uncertainty, and the light.

    Raises
    ------
    GonioError
        When something given cannot be used; :class:`FileError` if it is a file that cannot be read.
    TypeError
        When something given is of another type.

    Warns
    -----
    GonioWarning
        When something speaks against the answer; it stays in :attr:`Posterior.warnings`.

    Examples
    --------
    >>> found = gonio.infer("samples/ball.exr")
    >>> found.brdf.table.shape, round(found.brdf.albedo, 3)
    ((90, 90, 3), 0.5)
    >>> low, median, high = found.alpha
    >>> bool(low < median < high)
    True
    """
    options = dict(locals())
    found = run(options, None)
    for message in found.warnings:
        warnings.warn(message, GonioWarning, stacklevel=2)
    return found


def prepared(options: dict[str, Any]) -> tuple[GivenScene, Settings, Model, list[str]]:
    """What :func:`infer` is given by name, for the extension, with warnings so far."""
    said: list[str] = []
    listener(options["progress"])
    method = method_of(options)
    scene = given_scene(options["image"], options, said)
    refuse_unused(options, method, scene["object"]["mesh"] is not None or scene["object"]["normals"] is not None)
    color = choice(options["color"], "color", ("estimate", "median", "none"))
    light_color = options["light_color"]
    if light_color is not None:
        what = "three positive numbers on a linear scale"
        light_color = numbers(light_color, "light_color", what, 3)
        if min(light_color) <= 0:
            raise GonioError(f"light_color: give {what}")
        if color != "estimate":
            raise GonioError('light_color serves color="estimate" alone')
        if options["light"] is not None:
            raise GonioError("light_color and light both say the light's colour: give one of them")
    light = options["light"]
    report = flag(options["report"], "report")
    settings: Settings = {
        "method": method,
        "starts": 4 if options["starts"] is None else whole(options["starts"], "starts", 1, 1000),
        "seed": 1 if options["seed"] is None else whole(options["seed"], "seed"),
        "solver": choice(options["solver"] or "blocks", "solver", ("blocks", "parallel", "printed")),
        "full_rows": flag(options["full_rows"], "full_rows"),
        "light": None if light is None else light_map(light, said),
        "align_light": choice(options["align_light"] or "near", "align_light", ("near", "around", "fixed")),
        "absolute": flag(options["absolute"], "absolute"),
        "grid": 32 if options["grid"] is None else whole(options["grid"], "grid"),
        "shadows": flag(options["shadows"], "shadows"),
        "color": color,
        "pictures": flag(options["pictures"], "pictures") or report,
        "report": report,
        "colorspace": space_if_given(options["colorspace"], "colorspace"),
        "output_colorspace": space(options["output_colorspace"], "output_colorspace"),
        "light_color": None if light_color is None else cast("tuple[float, float, float]", tuple(light_color)),
    }
    return scene, settings, model_of(options["model"]), said


def model_of(given: Model | Path | None) -> Model:
    """The model that is given, or the one of the package."""
    if given is None:
        return Model.embedded()
    if isinstance(given, Model):
        return given
    if not is_path(given):
        raise TypeError(f"model: give a file or what train_model returns, not {shown(given)}")
    return read_model(given)


def method_of(options: dict[str, Any]) -> str:
    """The method by its name, or the usual one."""
    has_light = options["light"] is not None
    if options["method"] is None:
        return "known-light" if has_light else "learnt"
    method = choice(options["method"], "method", METHODS)
    if method.startswith("known-light") != has_light:
        if has_light:
            raise GonioError('light is for method="known-light" and "known-light-basis": the other methods find it')
        raise GonioError(f'method="{method}" needs the light: give it with light=')
    return method


def refuse_unused(options: dict[str, Any], method: str, has_shadows: bool) -> None:
    """Refuses arguments that a method does not use."""
    blind = ("learnt", "variational", "map")
    uses: list[tuple[str, bool, tuple[str, ...]]] = [
        ("absolute", bool(options["absolute"]), ("known-light",)),
        ("align_light", options["align_light"] is not None, ("known-light",)),
        ("solver", options["solver"] is not None, ("variational",)),
        ("starts", options["starts"] is not None, IN_BASIS),
        ("seed", options["seed"] is not None, IN_BASIS),
        ("full_rows", bool(options["full_rows"]), ("variational", "map")),
        ("grid", options["grid"] is not None and not has_shadows, blind),
        ("model", options["model"] is not None, tuple(name for name in METHODS if name != "paper")),
    ]
    for name, given, methods in uses:
        if given and method not in methods:
            offered = ", ".join(f'"{one}"' for one in methods)
            raise GonioError(f'{name} is for method={offered}: "{method}" does not use it')
    if method == "paper" and has_shadows:
        raise GonioError('method="paper" is for a sphere: give another method for a mesh or normals')


def run(options: dict[str, Any], poll: Callable[[], object] | None) -> Posterior | BasisPosterior:
    """:func:`infer` of its arguments by name, without warnings. ``poll`` is called often, and ends the work by raising."""
    scene, settings, model, said = prepared(options)
    found = _gonio.infer(scene, settings, model, {"progress": options["progress"], "poll": poll})
    found["warnings"] = said + found["warnings"]
    name = stem_of(options["image"])
    if settings["method"] in IN_BASIS:
        return BasisPosterior(found, name)
    return Posterior(cast(Found, found), name)


def stem_of(image: Photograph) -> str:
    """What a result is called."""
    return os.path.splitext(os.path.basename(name_of(image, "gonio")))[0]
