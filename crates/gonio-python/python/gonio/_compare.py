"""Comparison of results."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from . import _gonio
from ._arguments import Path, is_path
from ._errors import GonioError
from ._material import Result
from ._show import escaped
from ._types import Bytes, Floats


@dataclass(frozen=True)
class Pair:
    """Comparison of two results.

    Attributes
    ----------
    names : tuple of str
        Names of both results.
    agreement : str
        ``agree`` if each estimate lies in the 90 % interval of the other, in roughness and in peak height;
        ``overlap`` if only the intervals overlap; ``differ``; or ``unknown``.
    distance : float or None
        Root mean square difference of the logarithms of both BRDFs at the best scale; None if a BRDF
        is missing or zero.
    sentence : str
        Agreement in words, with the intervals.
    """

    names: tuple[str, str]
    agreement: str
    distance: float | None
    sentence: str


@dataclass(frozen=True)
class Comparison:
    """Comparison of several results, from :func:`gonio.compare`.

    Attributes
    ----------
    pairs : list of Pair
        All pairs; empty for more than 24 results.
    page : str
        Self-contained HTML page with a table of the results, their intervals and their BRDFs.
    """

    pairs: list[Pair]
    page: str = field(repr=False)

    def _repr_html_(self) -> str:
        """Returns the sentences of all pairs as HTML, for notebooks."""
        return "".join(f"<p>{escaped(pair.sentence)}</p>" for pair in self.pairs)

    def write(self, path: Path) -> None:
        """Write the page to an HTML file.

        Parameters
        ----------
        path : str or os.PathLike
            The file.

        Examples
        --------
        >>> gonio.compare([found, found]).write(folder / "page.html")
        """
        _gonio.write_file(os.fspath(path), self.page.encode())


def compare(results: Mapping[str, Result | Path] | Sequence[Result | Path]) -> Comparison:
    """Compare several results: roughness, peak, colours and BRDFs.

    Parameters
    ----------
    results : sequence or mapping of Result or path
        Results of :func:`gonio.infer` or :func:`gonio.combine`, or folders of results; in a mapping,
        the keys are their names. A folder with several regions adds one result for each region.

    Returns
    -------
    Comparison
        The agreement and the distance of each pair, and a page.

    Raises
    ------
    GonioError
        If there is only one result.
    FileError
        If a folder contains no results.

    Examples
    --------
    >>> dull = gonio.infer(found.relight("sky", size=64), pictures=False)
    >>> comparison = gonio.compare({"studio": found, "sky": dull})
    >>> comparison.pairs[0].names
    ('studio', 'sky')
    """
    if is_path(results) or isinstance(results, Result):
        raise GonioError("results: must be a list or a dictionary of results or folders")
    named = list(results.items()) if isinstance(results, Mapping) else list(zip(_names(results), results))
    given: list[tuple[str, str | tuple[str, Floats, Bytes | None]]] = []
    for name, one in named:
        if isinstance(one, Result):
            given.append((name, (json.dumps(one.result), one.brdf.table, one.pictures.get("relit"))))
        elif is_path(one):
            given.append((name, os.fspath(one)))
        else:
            raise GonioError(f"{one!r}: must be a result of gonio.infer or a folder of results")
    pairs, page, count = _gonio.compare(given)
    if count < 2:
        raise GonioError("results: contains fewer than two results; specify at least two")
    return Comparison(
        [Pair((pair["of"][0], pair["of"][1]), pair["agreement"], pair["distance"], pair["sentence"]) for pair in pairs], page
    )


def _names(results: Sequence[Result | Path]) -> list[str]:
    """Returns the names of photographs and folders; the whole path of folders that have the same name, and numbers otherwise."""
    paths = ["" if isinstance(one, Result) else os.fspath(one) for one in results]
    names = [one.brdf.name if isinstance(one, Result) else os.path.basename(os.path.normpath(os.fspath(one))) for one in results]
    names = [path if path and names.count(name) > 1 else name for path, name in zip(paths, names)]
    return [f"{name} ({at})" if names.count(name) > 1 else name for at, name in enumerate(names, 1)]
