"""Several photographs of one material."""

from __future__ import annotations

import os
from collections.abc import Sequence

from . import _gonio
from ._arguments import Path, Progress, is_path
from ._checks import listener
from ._errors import GonioError
from ._gonio import Model
from ._infer import model_of
from ._material import Material
from ._posterior import Posterior
from ._types import FoundTogether


class Combined(Material):
    """What several photographs tell of one material. Albedos are 0.5 along the normal.

    :attr:`pictures` holds combined (all together, and each photograph by itself), uncertainty, and
    relit.
    """

    _found: FoundTogether

    @property
    def agreement(self) -> tuple[float, ...]:
        """For each photograph, the logarithm of the odds of one material for all to another one for it.

        It is above zero if they agree.
        """
        return tuple(self._found["agreement"])

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
    """Combine what several photographs of one object or material tell of it.

    They may be of other lights, other views, other exposures.

    Parameters
    ----------
    posteriors : sequence of Posterior or path
        What :func:`gonio.infer` returns for each photograph, or folders of results. Either all were
        found under unknown light, or all with ``light`` given.
    model : Model or path, optional
        The model that folders were found with, if it is not that of a posterior given, or the one
        of the package.
    progress : callable, optional
        Called with the name of a stage and the fraction of it that is done; an exception ends the
        work.

    Returns
    -------
    Combined
        The material, with narrower intervals.

    Raises
    ------
    GonioError
        If the photographs cannot be of one material, one is given twice, or they were found with
        different models.

    Examples
    --------
    >>> room, hall = gonio.studio_light(32), np.roll(gonio.studio_light(32), 20, axis=1)
    >>> seen = [gonio.infer(found.relight(light, size=64), pictures=False) for light in (room, hall)]
    >>> both = gonio.combine(seen)
    >>> len(both.agreement)
    2
    """
    if is_path(posteriors) or isinstance(posteriors, Material):
        raise GonioError("give a list of posteriors or folders, one for each photograph")
    listener(progress)
    given: list[str | tuple[str, _gonio.Likelihood]] = []
    for one in posteriors:
        if isinstance(one, Material):
            given.append((one.brdf.name, one._found["likelihood"]))
        elif is_path(one):
            given.append(os.fspath(one))
        else:
            raise GonioError(f"{one!r}: give posteriors of gonio.infer, or folders of results")
    found_with = [one.model for one in posteriors if isinstance(one, Material)]
    known = found_with[0] if model is None and found_with else model_of(model)
    return Combined(_gonio.combine_all(given, known, {"progress": progress, "poll": None}), "combined")
