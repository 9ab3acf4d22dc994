"""Converts arguments to arrays, without copying suitable arrays. The extension reads files.

PIL images, xarray's arrays and tensors are detected by their interfaces; their packages are not imported.
"""

from __future__ import annotations

import os
from collections.abc import Iterable
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from ._arguments import Array, Path, Photograph, Picture, is_path
from ._validation import shown
from ._errors import GonioError
from ._types import Doubles, Floats, GivenPicture, GivenShots

ROWS = {"y", "row", "rows", "height", "lat", "latitude"}
COLUMNS = {"x", "col", "cols", "column", "columns", "width", "lon", "longitude"}
CHANNELS = {"c", "channel", "channels", "band", "bands", "rgb", "rgba", "color", "colour"}


def array_of(given: Array, name: str, *, indices: bool = False) -> NDArray[Any]:
    """Returns an array with the axes rows, columns and channels. Palette images keep their ``indices``, or
    are converted to colours."""
    if isinstance(given, np.ndarray):
        array = given
    elif callable(getattr(given, "getbands", None)) and hasattr(given, "mode"):
        array = np.asarray(given if indices else plain_mode(given))
    elif hasattr(given, "dims") and callable(getattr(given, "transpose", None)):
        array = np.asarray(in_order(given))
    elif hasattr(given, "__dlpack__"):
        array = of_tensor(given, name)
    else:
        try:
            array = np.asarray(given)
        except (TypeError, ValueError) as error:
            raise GonioError(f"{name}: cannot convert {shown(given)} to an array: {error}") from None
    if array.dtype.kind not in "biufc":
        raise GonioError(f"{name}: {shown(given)} is not an image; use a file, an array, a PIL image or a tensor")
    return array[:, :, 0] if array.ndim == 3 and array.shape[2] == 1 else array


def plain_mode(image: Any) -> Any:
    """Converts palettes and other colour modes of a PIL image to grey or RGB."""
    if image.mode in ("1", "L", "RGB", "RGBA", "F") or image.mode.startswith("I"):
        return image
    has_alpha = "A" in image.mode.upper().replace("LAB", "") or "transparency" in image.info
    return image.convert("RGBA" if has_alpha else "RGB")


def in_order(given: Any) -> Any:
    """Transposes an array with named axes to rows, columns, channels, if the names are known."""
    dims = [str(dim) for dim in given.dims]
    found = [[dim for dim in dims if dim.lower() in names] for names in (ROWS, COLUMNS, CHANNELS)]
    if sum(map(len, found)) != len(dims) or any(len(names) > 1 for names in found):
        return given
    return given.transpose(*(dim for names in found for dim in names))


def of_tensor(given: Any, name: str) -> NDArray[Any]:
    """Converts a tensor on any device to an array with channels last."""
    for step in ("detach", "cpu"):
        if callable(getattr(given, step, None)):
            given = getattr(given, step)()
    try:
        array = np.asarray(given) if hasattr(given, "__array__") else np.from_dlpack(given)
    except (BufferError, RuntimeError, TypeError, ValueError) as error:
        raise GonioError(f"{name}: NumPy cannot read the tensor: {error}; move it to main memory as float32") from None
    counts = (1, 3, 4)
    comes_first = array.ndim == 3 and array.shape[0] in counts and array.shape[2] not in counts
    return np.moveaxis(array, 0, -1) if comes_first else array


def floats(array: NDArray[Any]) -> Floats:
    """Returns native float32 in C order: the array itself, or a copy if necessary."""
    return np.require(array, np.float32, ["C_CONTIGUOUS", "ALIGNED"])


def doubles(array: NDArray[Any]) -> Doubles:
    """Returns native float64 in C order."""
    return np.require(array, np.float64, ["C_CONTIGUOUS", "ALIGNED"])


def decoded(array: NDArray[Any], name: str, linear: bool, warnings: list[str]) -> Floats:
    """Converts an array of any type to radiance; integers are sRGB unless ``linear``."""
    if array.dtype == np.bool_ or array.dtype.kind not in "fiu":
        raise GonioError(f"{name}: has values of type {array.dtype}; use floating-point radiance")
    if array.dtype.kind == "f":
        return floats(array)
    if array.dtype not in (np.uint8, np.uint16):
        raise GonioError(f"{name}: has values of type {array.dtype}; use float32, uint8 or uint16")
    values = array.astype(np.float32) / np.float32(np.iinfo(array.dtype).max)
    if linear:
        return values
    warnings.append(
        f"{name}: {8 * array.dtype.itemsize}-bit image, decoded as sRGB; its highlights are probably clipped and its tone curve is "
        "unknown; use an HDR image for reliable results, or linear=True for linear radiance"
    )
    curve = np.where(values <= 0.04045, values / 12.92, ((values + 0.055) / 1.055) ** 2.4)
    return floats(curve)


def picture(given: Picture, name: str, linear: bool, warnings: list[str]) -> GivenPicture:
    """Converts an image. Float32 of shape (height, width, 3) in C order is not copied; grey images and alpha channels are
    converted to new arrays."""
    if is_path(given):
        return os.fspath(cast(Path, given))
    array = array_of(cast(Array, given), name)
    if array.ndim == 2:
        grey = decoded(array, name, linear, warnings)
        return np.repeat(grey[:, :, np.newaxis], 3, axis=2)
    if array.ndim == 3 and array.shape[2] == 3:
        return decoded(array, name, linear, warnings)
    if array.ndim == 3 and array.shape[2] == 4:
        colours = decoded(array[:, :, :3], name, linear, warnings)
        alpha = array[:, :, 3]
        scale = 1.0 if alpha.dtype.kind == "f" else float(np.iinfo(alpha.dtype).max)
        return colours, floats(alpha / scale)
    raise GonioError(f"{name}: has the shape {array.shape}; use (height, width), (height, width, 3) or (height, width, 4)")


def photograph(given: Photograph, name: str, linear: bool, warnings: list[str]) -> GivenShots:
    """Converts a photograph: an image, the bytes of a file, or the files of exposures."""
    if isinstance(given, (bytes, bytearray, memoryview)):
        return bytes(given)
    # An open file has the method `read`; a PIL image does not.
    if callable(getattr(given, "read", None)):
        read = cast(Any, given).read()
        if not isinstance(read, bytes):
            raise GonioError(f"{name}: is a text file; open it with mode \"rb\"")
        return read
    if isinstance(given, (list, tuple)) and (not given or any(is_path(one) for one in given)):
        return paths(given, name)
    return picture(cast(Picture, given), name, linear, warnings)


def paths(given: Iterable[object], name: str) -> list[str]:
    """Returns the files of the exposures of one scene."""
    files = list(given)
    if not files:
        raise GonioError(f"{name}: is an empty list; use a photograph, or the files of exposures of one scene")
    wrong = [one for one in files if not is_path(one)]
    if wrong:
        raise GonioError(f"{name}: exposures must be files, but {shown(wrong[0])} is not a path")
    return [os.fspath(cast(Path, file)) for file in files]


def name_of(given: Photograph, unnamed: str) -> str:
    """Returns the name of a photograph in messages."""
    if isinstance(given, (list, tuple)) and given and is_path(given[0]):
        return os.fspath(cast(Path, given[0]))
    return os.fspath(cast(Path, given)) if is_path(given) else unnamed


def mask_of(given: Picture | None, name: str = "the mask") -> str | Floats | None:
    """Converts a mask; float32 of shape (height, width) is not copied."""
    if given is None:
        return None
    if is_path(given):
        return os.fspath(cast(Path, given))
    array = array_of(cast(Array, given), name, indices=True)
    if array.ndim != 2:
        raise GonioError(f"{name}: has the shape {array.shape}; use (height, width)")
    if array.dtype.kind == "c":
        raise GonioError(f"{name}: has values of type {array.dtype}; use numbers from 0 to 1")
    if array.dtype in (np.uint8, np.uint16) and array.size and array.max() > 1:
        array = array / np.iinfo(array.dtype).max
    values = floats(array)
    if not (np.isfinite(values).all() and values.min(initial=0) >= 0 and values.max(initial=0) <= 1):
        raise GonioError(f"{name}: has values outside of 0 to 1 (for uint8 and uint16, outside of 0 to their maximum)")
    return values


def environment_map(given: Picture, warnings: list[str], name: str = "the light") -> str | Floats:
    """Converts an environment map: a file, or an array of shape (height, 2 height, 3)."""
    light = picture(given, name, False, warnings)
    return light[0] if isinstance(light, tuple) else light
