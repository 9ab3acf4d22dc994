"""How text and pictures are shown."""

from __future__ import annotations

from html import escape

import numpy as np
from numpy.typing import ArrayLike, NDArray


def escaped(text: str) -> str:
    """Text within HTML."""
    return escape(text, quote=True)


def tonemapped(picture: ArrayLike, *, exposure: float | None = None) -> NDArray[np.uint8]:
    """Linear radiance as 8-bit sRGB to look at, shape (height, width, 3). Where there is coverage, as a fourth channel, the rest becomes
    white. ``exposure`` multiplies the radiance; without one bright parts get six tenths of white, and what is brighter keeps apart."""
    array = np.asarray(picture, np.float32)
    if array.ndim == 2:
        array = np.repeat(array[:, :, np.newaxis], 3, axis=2)
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
