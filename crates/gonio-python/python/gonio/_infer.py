"""Inference."""

from __future__ import annotations

import os
import warnings
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any, Literal, TypedDict, cast, overload

from . import _gonio
from ._arguments import Camera, Path, Photograph, Picture, Progress, Shape, is_path
from ._arrays import environment_map, name_of
from ._validation import choice, circle, flag, integer, listener, numbers, reflectances, shown, space, space_if_given
from ._errors import GonioError, GonioWarning
from ._gonio import Model
from ._posterior import BasisPosterior, Posterior
from ._scene import given_scene
from ._types import PosteriorData, GivenScene, Settings

if TYPE_CHECKING:
    from typing_extensions import Unpack

METHODS = ("learnt", "known-light", "variational", "joint-map", "known-light-basis", "paper")
"""Estimation methods."""

IN_BASIS = ("variational", "joint-map", "known-light-basis", "paper")
"""Methods of the paper, which estimate basis coefficients."""


def read_model(path: Path) -> Model:
    """Read a model that :func:`gonio.train_model` or ``gonio train model`` wrote.

    Parameters
    ----------
    path : str or os.PathLike
        The file.

    Returns
    -------
    Model
        Model for the argument ``model`` of :func:`gonio.infer`.

    Raises
    ------
    GonioError
        If the file is not a model, or damaged.
    FileError
        If the file cannot be read.

    Examples
    --------
    >>> gonio.Model.embedded().write(folder / "my.model")
    >>> gonio.read_model(folder / "my.model").largest_grid
    128
    """
    return Model.read(os.fspath(path))


class Options(TypedDict, total=False):
    """Keyword arguments of :func:`infer`, for type checkers."""

    mask: Picture | None
    model: Model | Path | None
    times: Sequence[float] | None
    response: Path | None
    align: bool
    trust_times: bool
    black_level: float | None
    flat: Path | None
    linear: bool
    layer: str | None
    colorspace: str | None
    output_colorspace: str
    clip: float | None
    one_material: bool
    force: bool
    normals: Picture | None
    normals_order: str
    normals_flip_x: bool
    normals_flip_y: bool
    normals_flip_z: bool
    trust_normals: bool
    normals_error: float
    depth: Picture | None
    depth_range: tuple[float, float] | None
    depth_along_rays: bool
    positions: Picture | None
    circle: tuple[float, float, float] | None
    depth_axis: float | None
    camera: Camera | None
    pose: Camera | None
    light: Picture | None
    mirror_ball: tuple[float, float, float] | None
    mirror_reflectance: float | tuple[float, float, float] | None
    align_light: str | None
    absolute: bool
    shadows: bool
    grid: int | None
    starts: int | None
    seed: int | None
    solver: str | None
    all_observations: bool
    color: str
    light_color: Sequence[float] | None
    white: tuple[float, float, float] | None
    grey_card: Picture | None
    grey_ball: tuple[float, float, float] | None
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
    method: Literal["variational", "joint-map", "known-light-basis", "paper"],
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
    align: bool = True,
    trust_times: bool = False,
    black_level: float | None = None,
    flat: Path | None = None,
    linear: bool = False,
    layer: str | None = None,
    colorspace: str | None = None,
    output_colorspace: str = "rec709",
    clip: float | None = None,
    one_material: bool = False,
    force: bool = False,
    normals: Picture | None = None,
    normals_order: str = "xyz",
    normals_flip_x: bool = False,
    normals_flip_y: bool = False,
    normals_flip_z: bool = False,
    trust_normals: bool = False,
    normals_error: float = 0.0,
    depth: Picture | None = None,
    depth_range: tuple[float, float] | None = None,
    depth_along_rays: bool = False,
    positions: Picture | None = None,
    circle: tuple[float, float, float] | None = None,
    depth_axis: float | None = None,
    camera: Camera | None = None,
    pose: Camera | None = None,
    light: Picture | None = None,
    mirror_ball: tuple[float, float, float] | None = None,
    mirror_reflectance: float | tuple[float, float, float] | None = None,
    align_light: str | None = None,
    absolute: bool = False,
    shadows: bool = True,
    method: str | None = None,
    grid: int | None = None,
    starts: int | None = None,
    seed: int | None = None,
    solver: str | None = None,
    all_observations: bool = False,
    color: str = "estimate",
    light_color: Sequence[float] | None = None,
    white: tuple[float, float, float] | None = None,
    grey_card: Picture | None = None,
    grey_ball: tuple[float, float, float] | None = None,
    color_checker: bool | str | Sequence[float] | Sequence[tuple[float, float]] = False,
    reference_reflectance: float | None = None,
    reference_color_only: bool = False,
    pictures: bool = True,
    report: bool = False,
    progress: Progress | None = None,
) -> Posterior | BasisPosterior:
    """Estimate the BRDF of an object from one photograph under unknown light.

    The function releases the GIL and stops on Ctrl-C. Array arguments can be NumPy arrays, lists,
    PIL images, ``xarray.DataArray`` and tensors. The axes of a ``DataArray`` are named y, x and
    channel, in any order. Tensors can also have their channels first.

    Parameters
    ----------
    image : path, array, bytes, open file, or list of paths
        The photograph: a file, its bytes, or an array of linear radiance with the shape (height,
        width, 3), (height, width) or (height, width, 4) with premultiplied alpha. float32 of shape
        (height, width, 3) in C order is not copied; do not change it before the call returns. Other
        arrays are copied; uint8 and uint16 are decoded as sRGB. A list of paths contains the
        exposures of one scene, which are merged.
    shape : str, path, array or pair of arrays, default "sphere"
        ``"sphere"`` or ``"ellipsoid"``, fitted to the outline; or ``"outline"``, a smooth surface inflated
        from the outline. It can also be a mesh file (OBJ, PLY, glTF); a built-in mesh, ``"blob"``, ``"bunny"`` or ``"bowl"``; (vertices, faces) as arrays; or an array
        of normals as for ``normals``.
    mask : path or array, optional
        Mask of the object, from 0 to 1, shape (height, width). By default, the object is detected by
        the alpha channel, a uniform background, or the edges of a ball. A mask of another size is
        scaled.
    model : Model or path, optional
        Model to use instead of the embedded model.
    times : sequence of float, optional
        Exposure times in seconds, one per file, which override the EXIF data.
    response : path, optional
        Response curve of the camera: ``"srgb"``, ``"linear"``, or a file that
        :meth:`Merged.write_response` wrote. By default, it is recovered from the exposures.
    align : bool, default True
        Shift exposures by whole pixels so that they match the first one.
    trust_times : bool, default False
        Use the exposure times without checking or correcting them, and ignore inconsistent pixels.
    black_level : float, optional
        Black level of linear 8- or 16-bit images, as a code value.
    flat : path, optional
        Flat field: image of an evenly lit surface, taken with the same lens.
    linear : bool, default False
        Interpret integer values as linear radiance, not as sRGB.
    layer : str, optional
        Layer to read from a multi-layer OpenEXR file.
    colorspace : str, optional
        Colour space of arrays and of files that state none: ``"rec709"`` (default, also
        ``"srgb"``), ``"display-p3"``, ``"rec2020"``, ``"acescg"``, ``"aces2065-1"``, ``"xyz"``
        (docs/colour-spaces.md). It also applies to the environment map.
    output_colorspace : str, default "rec709"
        Colour space of the BRDF and the light that :meth:`Posterior.save` writes. Arrays are always
        linear Rec. 709.
    clip : float, optional
        Radiance at which the camera clips; detected by default if many pixels share the maximum.
    one_material : bool, default False
        Use regions of another colour (stickers), a second paint and small spots such as dust as
        well. By default, they are ignored if gonio can distinguish them from reflections.
    force : bool, default False
        Estimate although the photograph contradicts the shape or the light. By default, a mesh whose
        silhouette is not that of the object and a relative RMS residual of the photograph above
        50 % are errors.
    normals : path or array, optional
        Normal map of the object, shape (height, width, 3), in camera coordinates: x points right, y
        up, and z towards the camera.
    normals_order : str, default "xyz"
        Order of the axes in the channels of the normal map.
    normals_flip_x, normals_flip_y, normals_flip_z : bool, default False
        The x axis of the normals points left, y down (as in DirectX), z away from the camera.
    trust_normals : bool, default False
        Use the normals even if they fail the consistency checks.
    normals_error : float, default 0
        Expected error of the normals in degrees, at most 45, for normals that a network predicts. If
        the photograph contradicts them, they are turned by about this angle at most, towards normals
        whose pixels have the same brightness.
    depth : path or array, optional
        Depth map of the object, shape (height, width), in units of the camera, to compute
        self-shadowing; 0 or NaN marks pixels without a surface. It requires ``normals``.
    depth_range : (float, float), optional
        Depths of the smallest and the largest code of an integer depth map.
    depth_along_rays : bool, default False
        Depths are distances along the viewing rays, not along the optical axis.
    positions : path or array, optional
        Position map of the object in camera coordinates, shape (height, width, 3), instead of
        ``depth``. It requires ``camera``.
    circle : (float, float, float), optional
        Outline of a sphere in pixels, instead of detecting it: x, y (from the top left corner) and
        radius.
    depth_axis : float, optional
        Semi-axis of an ellipsoid towards the camera, in pixels.
    camera, pose : path or dict, optional
        Camera parameters, and the pose of a mesh (docs/camera.md).
    light : path or array, optional
        Known light: a lat-long map in camera coordinates, shape (height, 2 height, 3), or a text file
        of directional lights. A known light narrows the intervals considerably.
    mirror_ball : (x, y, radius), optional
        Outline of a mirror ball in the photograph, in pixels, from which the light is measured. It must
        be beside the object. A ball beside it is detected; another object requires ``mask``.
    mirror_reflectance : float or three floats, optional
        Reflectance of the mirror ball at normal incidence; chrome has about 0.55. With it, the BRDF
        is absolute. By default, the ball is grey and the scale of the BRDF is unknown.
    align_light : {"small", "vertical", "fixed"}, optional
        Rotations of the environment map to search: a few degrees about any axis (default), additionally
        any angle about the vertical, or none.
    absolute : bool, default False
        Photograph and environment map have the same scale, so that the BRDF is absolute. By default, its
        albedo is 0.5 at normal incidence.
    shadows : bool, default True
        Model self-shadowing.
    method : str, optional
        ``"learnt"`` (default), ``"known-light"`` (default with ``light``), or a method of the paper,
        which returns a :class:`BasisPosterior`: ``"variational"`` (Algorithm 1), ``"joint-map"`` (joint MAP
        estimate), ``"known-light-basis"``, or ``"paper"`` (the paper's setup for a sphere).
    grid : int, optional
        Texels along a side of the light grid, a power of two; 32 by default. For glossy materials,
        ``infer`` refines the light to at most four times as many, and 128.
    starts, seed : int, optional
        Number of random starts of the paper's methods (default 4), and their seed (default 1).
    solver : {"blocks", "printed"}, optional
        Solver of ``method="variational"``.
    all_observations : bool, default False
        Run ``"variational"`` or ``"joint-map"`` on all observations instead of their projection.
    color : {"estimate", "median", "none"}, default "estimate"
        Colour of the BRDF. ``"estimate"``: estimated chroma for every pair of angles; a light of
        unknown colour counts as neutral. ``"median"``: the median colour of the photograph, as in
        the paper. ``"none"``: three equal channels.
    light_color : sequence of 3 floats, optional
        Known colour of the light: linear colour of a white matte ball at the object's position.
    white : (float, float, float), optional
        White patch in the image: x, y (from the top left corner) and radius of a disk in pixels.
        The patch determines the colour of the light. If it faces the camera beside the object, it
        also determines the scale of the BRDF.
    grey_card : path or array, optional
        Grey card in the image, for the same purpose: a mask above 0.5 on the card, shape (height,
        width).
    grey_ball : (float, float, float), optional
        Matte grey ball in the image, for the same purpose: x, y and radius in pixels. The ball shows
        the light on all visible normals.
    color_checker : bool or sequence, default False
        24-patch colour chart (ColorChecker Classic) in the image, for the same purpose. True detects
        the chart; four (x, y) in pixels, or eight numbers, are the centres of its corner patches in
        the order dark skin, bluish green, black, white.
    reference_reflectance : float, optional
        Diffuse reflectance of the reference; by default 0.9 for ``white``, otherwise
        0.18.
    reference_color_only : bool, default False
        Use only the colour of the reference, because it does not face the camera or is not under
        the same light as the object.
    pictures : bool, default True
        Draw :attr:`Posterior.pictures`, which takes a third of the time.
    report : bool, default False
        Also create the page ``report.html`` for :meth:`Posterior.save`.
    progress : callable, optional
        Called in this thread with the name of a stage and its completed fraction; an exception stops
        the inference.

    Returns
    -------
    Posterior or BasisPosterior
        The material with its uncertainty, and the light.

    Raises
    ------
    GonioError
        If an input is invalid; :class:`FileError` if a file cannot be read.
    TypeError
        If an argument has the wrong type.

    Warns
    -----
    GonioWarning
        If the result may be unreliable; :attr:`Posterior.warnings` contains the messages.

    Examples
    --------
    >>> found = gonio.infer("samples/ball.exr")
    >>> found.brdf.table.shape, round(found.brdf.albedo, 3)
    ((90, 90, 3), 0.5)
    >>> low, median, high = found.ggx_alpha
    >>> bool(low < median < high)
    True
    """
    options = dict(locals())
    found = run(options, None)
    for message in found.warnings:
        warnings.warn(message, GonioWarning, stacklevel=2)
    return found


def prepared(options: dict[str, Any]) -> tuple[GivenScene, Settings, Model, list[str]]:
    """Converts the arguments of :func:`infer` for the extension; also returns warnings."""
    messages: list[str] = []
    listener(options["progress"])
    method = method_of(options)
    scene = given_scene(options["image"], options, messages)
    refuse_unused(options, method, scene["object"]["mesh"] is not None or scene["object"]["normals"] is not None)
    color = choice(options["color"], "color", ("estimate", "median", "none"))
    light_color = options["light_color"]
    if light_color is not None:
        what = "three positive linear numbers"
        light_color = numbers(light_color, "light_color", what, 3)
        if min(light_color) <= 0:
            raise GonioError(f"light_color: must be {what}")
        if color != "estimate":
            raise GonioError('light_color requires color="estimate"')
        if options["light"] is not None:
            raise GonioError("light_color and light both specify the colour of the light; use only one of them")
    light = options["light"]
    ball, reflectance = mirror_of(options)
    report = flag(options["report"], "report")
    settings: Settings = {
        "method": method,
        "starts": 4 if options["starts"] is None else integer(options["starts"], "starts", 1, 1000),
        "seed": 1 if options["seed"] is None else integer(options["seed"], "seed"),
        "solver": choice(options["solver"] or "blocks", "solver", ("blocks", "printed")),
        "all_observations": flag(options["all_observations"], "all_observations"),
        "light": None if light is None else environment_map(light, messages),
        "mirror_ball": ball,
        "mirror_reflectance": reflectance,
        "align_light": choice(options["align_light"] or "small", "align_light", ("small", "vertical", "fixed")),
        "absolute": flag(options["absolute"], "absolute"),
        "grid": 32 if options["grid"] is None else integer(options["grid"], "grid"),
        "shadows": flag(options["shadows"], "shadows"),
        "color": color,
        "pictures": flag(options["pictures"], "pictures") or report,
        "report": report,
        "colorspace": space_if_given(options["colorspace"], "colorspace"),
        "output_colorspace": space(options["output_colorspace"], "output_colorspace"),
        "light_color": None if light_color is None else cast("tuple[float, float, float]", tuple(light_color)),
    }
    return scene, settings, model_of(options["model"]), messages


def model_of(given: Model | Path | None) -> Model:
    """Returns the given model, or the embedded one."""
    if given is None:
        return Model.embedded()
    if isinstance(given, Model):
        return given
    if not is_path(given):
        raise TypeError(f"model: must be a file or a Model, not {shown(given)}")
    return read_model(given)


def mirror_of(options: dict[str, Any]) -> tuple[tuple[float, float, float] | None, tuple[float, float, float] | None]:
    """Returns the outline and the reflectance of the mirror ball."""
    ball, given = options["mirror_ball"], options["mirror_reflectance"]
    if ball is None:
        if given is not None:
            raise GonioError("mirror_reflectance requires mirror_ball")
        return None, None
    for other in ("light", "light_color", "align_light"):
        if options[other] is not None:
            raise GonioError(f"mirror_ball and {other} both describe the light; use only one of them")
    if options["absolute"]:
        raise GonioError("absolute is for light; with a mirror ball, specify mirror_reflectance")
    reflectance = None if given is None else reflectances(given, "mirror_reflectance")
    return circle(ball, "mirror_ball"), reflectance


def method_of(options: dict[str, Any]) -> str:
    """Returns the given method, or the default."""
    has_light = options["light"] is not None or options["mirror_ball"] is not None
    if options["method"] is None:
        return "known-light" if has_light else "learnt"
    method = choice(options["method"], "method", METHODS)
    if options["mirror_ball"] is not None and method != "known-light":
        raise GonioError(f'mirror_ball is for method="known-light"; method "{method}" does not use it')
    if method.startswith("known-light") != has_light:
        if has_light:
            raise GonioError('light is for method="known-light" and "known-light-basis"; the other methods estimate the light')
        raise GonioError(f'method="{method}" requires a known light; specify it with light=')
    return method


def refuse_unused(options: dict[str, Any], method: str, has_shadows: bool) -> None:
    """Rejects arguments that a method does not use."""
    blind = ("learnt", "variational", "joint-map")
    uses: list[tuple[str, bool, tuple[str, ...]]] = [
        ("absolute", bool(options["absolute"]), ("known-light",)),
        ("align_light", options["align_light"] is not None, ("known-light",)),
        ("solver", options["solver"] is not None, ("variational",)),
        ("starts", options["starts"] is not None, IN_BASIS),
        ("seed", options["seed"] is not None, IN_BASIS),
        ("all_observations", bool(options["all_observations"]), ("variational", "joint-map")),
        ("grid", options["grid"] is not None and not has_shadows, blind),
        ("model", options["model"] is not None, tuple(name for name in METHODS if name != "paper")),
    ]
    for name, given, methods in uses:
        if given and method not in methods:
            offered = ", ".join(f'"{one}"' for one in methods)
            raise GonioError(f'{name} is for method={offered}; method "{method}" does not use it')
    if method == "paper" and has_shadows:
        raise GonioError('method="paper" requires a sphere; use another method for a mesh or normals')


def run(options: dict[str, Any], poll: Callable[[], object] | None) -> Posterior | BasisPosterior:
    """Runs :func:`infer` without issuing warnings. ``poll`` is called often; it stops the inference by raising."""
    scene, settings, model, messages = prepared(options)
    found = _gonio.infer(scene, settings, model, {"progress": options["progress"], "poll": poll})
    found["warnings"] = messages + found["warnings"]
    name = stem_of(options["image"])
    if settings["method"] in IN_BASIS:
        return BasisPosterior(found, name)
    return Posterior(cast(PosteriorData, found), name)


def stem_of(image: Photograph) -> str:
    """Returns the name of a result."""
    return os.path.splitext(os.path.basename(name_of(image, "gonio")))[0]
