"""BRDFs from and to files of measurements."""

from __future__ import annotations

import os

from . import _gonio
from ._arguments import Array, Path
from ._brdf import Brdf


def read_merl(path: Path) -> Brdf:
    """Read a table of the MERL database (``.binary``); the whole table is copied once on its way.

    Parameters
    ----------
    path : str or os.PathLike
        The file.

    Returns
    -------
    Brdf
        With :attr:`Brdf.full`.

    Examples
    --------
    >>> found.brdf.write(folder / "mine.binary")
    >>> gonio.read_merl(folder / "mine.binary").name
    'mine'
    """
    return _read(path, False)


def read_brdf(path: Path) -> Brdf:
    """Read a table of the MERL database or an RGB file of the RGL database (``.bsdf``).

    They are told apart by how they begin.

    Parameters
    ----------
    path : str or os.PathLike
        The file.

    Returns
    -------
    Brdf
        With :attr:`Brdf.full`.

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
    """Write a table of the MERL database.

    Parameters
    ----------
    path : str or os.PathLike
        The file; its name ends in ``.binary``.
    brdf : Brdf or array
        What to write.

    Examples
    --------
    >>> gonio.write_merl(folder / "chalk.binary", np.full((90, 90), 0.3))
    """
    (brdf if isinstance(brdf, Brdf) else Brdf(brdf)).write(path)
