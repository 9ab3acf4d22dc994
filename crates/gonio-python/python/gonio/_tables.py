"""Reads and writes measured BRDFs."""

from __future__ import annotations

import os

from . import _gonio
from ._arguments import Array, Path
from ._brdf import Brdf


def read_merl(path: Path) -> Brdf:
    """Read a table of the MERL database (``.binary``).

    Parameters
    ----------
    path : str or os.PathLike
        The file.

    Returns
    -------
    Brdf
        The BRDF with :attr:`Brdf.full`.

    Examples
    --------
    >>> found.brdf.write(folder / "mine.binary")
    >>> gonio.read_merl(folder / "mine.binary").name
    'mine'
    """
    return _read(path, False)


def read_brdf(path: Path) -> Brdf:
    """Read a BRDF: a result (``brdf.npz``), or a file of MERL (``.binary``), RGL (``.bsdf``, in RGB), MDL (``.mbsdf``) or text (``.csv``).

    The header or the extension of the file determines the format.

    Parameters
    ----------
    path : str or os.PathLike
        The file.

    Returns
    -------
    Brdf
        The BRDF with :attr:`Brdf.full`.

    Examples
    --------
    >>> found.brdf.write(folder / "mine.bsdf")
    >>> gonio.read_brdf(folder / "mine.bsdf").table.shape
    (90, 90, 3)
    """
    return _read(path, True)


def _read(path: Path, any_format: bool) -> Brdf:
    table, full = _gonio.read_brdf(os.fspath(path), any_format)
    return Brdf(table, full, name=os.path.splitext(os.path.basename(os.fspath(path)))[0])


def write_merl(path: Path, brdf: Brdf | Array) -> None:
    """Write a BRDF in the MERL format.

    Parameters
    ----------
    path : str or os.PathLike
        The file, with the extension ``.binary``.
    brdf : Brdf or array
        The BRDF to write.

    Examples
    --------
    >>> gonio.write_merl(folder / "chalk.binary", np.full((90, 90), 0.3))
    """
    (brdf if isinstance(brdf, Brdf) else Brdf(brdf)).write(path)
