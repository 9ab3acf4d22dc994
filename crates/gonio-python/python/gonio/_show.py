"""Display of text and images."""

from __future__ import annotations

from html import escape

import numpy as np
from numpy.typing import NDArray

from ._arguments import Array
from ._arrays import array_of
from ._errors import GonioError


def escaped(text: str) -> str:
    """Escapes text for HTML."""
    return escape(text, quote=True)


def tonemapped(picture: Array, *, exposure: float | None = None) -> NDArray[np.uint8]:
    """Tone-map linear radiance for display.

    Parameters
    ----------
    picture : array
        Shape (height, width), (height, width, 3), or (height, width, 4) with coverage, on a white
        background.
    exposure : float, optional
        Factor of the radiance. By default, the 90 % quantile maps to 60 % of white, and brighter
        values are compressed.

    Returns
    -------
    ndarray of uint8
        sRGB samples of shape (height, width, 3).

    Examples
    --------
    >>> gonio.tonemapped(np.full((2, 2), 0.5), exposure=0.4)[0, 0].tolist()
    [124, 124, 124]
    """
    array = np.asarray(array_of(picture, "the image"), np.float32)
    if array.ndim == 2:
        array = np.repeat(array[:, :, np.newaxis], 3, axis=2)
    if array.ndim != 3 or array.shape[2] not in (3, 4):
        raise GonioError(f"the image: has the shape {array.shape}; use (height, width), (height, width, 3) or (height, width, 4)")
    alpha = array[:, :, 3:] if array.shape[2] == 4 else np.ones_like(array[:, :, :1])
    colours = array[:, :, :3]
    if exposure is None:
        seen = colours[alpha[:, :, 0] > 0.99]
        level = float(np.quantile(seen.max(axis=1), 0.9)) if len(seen) else 1.0
        exposure = 0.6 / max(level, 1e-30)
    linear = exposure * colours
    linear = np.where(linear < 0.5, linear, 1 - 0.5 * np.exp(1 - 2 * linear)) + (1 - alpha)
    coded = np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * np.maximum(linear, 1e-9) ** (1 / 2.4) - 0.055)
    samples: NDArray[np.uint8] = np.round(255 * np.clip(coded, 0, 1)).astype(np.uint8)
    return samples
