"""Several photographs of one material."""

from __future__ import annotations

import os
from collections.abc import Sequence
from . import _gonio
from ._arguments import Path, is_path
from ._errors import GonioError
from ._gonio import Model
from ._infer import Progress, read_model
from ._posterior import Material, Posterior
from ._types import FoundTogether


class Combined(Material):
    """What several photographs tell of one material. Albedos are 0.5 along the normal.

    :attr:`pictures` holds combined (all together, and each photograph by itself), uncertainty, and relit.
    """

    agreement: tuple[float, ...]
    """For each photograph, the logarithm of the odds of one material for all to another one for it; above zero if they agree."""

    def __init__(self, found: FoundTogether, name: str) -> None:
        super().__init__(found, name)
        self.agreement = tuple(found["agreement"])

    def save(self, directory: Path) -> None:
        """Writes the folder of results that ``gonio combine`` writes, whole or not at all."""
        self._write(directory, None, None)

    def __repr__(self) -> str:
        low, median, high = self.gloss
        return (
            f"<gonio.Combined of {len(self.agreement)} photographs: gloss {median:.3g} ({low:.3g} to {high:.3g}), "
            f"GGX alpha {self.alpha[1]:.2g} ({self.alpha[0]:.2g} to {self.alpha[2]:.2g})>"
        )


def combine(
    posteriors: Sequence[Posterior | Combined | Path],
    model: Model | Path | None = None,
    *,
    progress: Progress | None = None,
) -> Combined:
    """Combines what several photographs of one object or material tell of it: other lights, other views, other exposures.

    :param posteriors: what :func:`gonio.infer` returns for each photograph, or folders of results. Either all were found under unknown
        light, or all with ``light`` given.
    :param model: the model that folders were found with, if it is not that of a posterior given, or the one of the package.
    :param progress: called with the name of a stage and the fraction of it that is done; an exception ends the work.
    :raises GonioError: if the photographs cannot be of one material, one is given twice, or they were found with different models.
    """
    if is_path(posteriors) or isinstance(posteriors, Material):
        raise GonioError("give a list of posteriors or folders, one for each photograph")
    given: list[str | tuple[str, _gonio.Likelihood]] = []
    for one in posteriors:
        if isinstance(one, Material):
            given.append((one.brdf.name, one._likelihood))
        elif is_path(one):
            given.append(os.fspath(one))
        else:
            raise GonioError(f"{one!r}: give posteriors of gonio.infer, or folders of results")
    found_with = [one.model for one in posteriors if isinstance(one, Material)]
    if model is None:
        known = found_with[0] if found_with else Model.embedded()
    else:
        known = model if isinstance(model, Model) else read_model(model)
    return Combined(_gonio.combine_all(given, known, {"progress": progress, "poll": None}), "combined")
