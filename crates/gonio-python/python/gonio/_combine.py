"""Several photographs of one material."""

from __future__ import annotations

import os
from collections.abc import Sequence

from . import _gonio
from ._arguments import Path, Progress, is_path
from ._validation import listener
from ._errors import GonioError
from ._gonio import Model
from ._infer import model_of
from ._material import Material
from ._posterior import Posterior
from ._types import CombinedData


class Combined(Material):
    """Material from several photographs, scaled to an albedo of 0.5 at normal incidence.

    :attr:`pictures` contains combined (joint estimate and estimate of each photograph), uncertainty
    and relit.
    """

    _found: CombinedData

    @property
    def agreement(self) -> tuple[float, ...]:
        """For each photograph, the log odds that it shows the same material as the others.

        Values above zero mean agreement.
        """
        return tuple(self._found["agreement"])

    def __repr__(self) -> str:
        return f"<gonio.Combined of {len(self.agreement)} photographs: {self.verdict}>"


def combine(
    posteriors: Sequence[Posterior | Combined | Path],
    model: Model | Path | None = None,
    *,
    progress: Progress | None = None,
) -> Combined:
    """Combine the posteriors of several photographs of one material.

    The photographs can differ in light, view and exposure.

    Parameters
    ----------
    posteriors : sequence of Posterior or path
        Results of :func:`gonio.infer`, one per photograph, or folders of results. Either all or none
        of them must have a known light.
    model : Model or path, optional
        Model that inferred the folders; by default that of the first posterior, or the embedded
        model.
    progress : callable, optional
        Called with the name of a stage and its completed fraction; an exception stops the
        computation.

    Returns
    -------
    Combined
        The material, with narrower intervals.

    Raises
    ------
    GonioError
        If the posteriors contradict each other, have the same photograph, or are from different
        models.

    Examples
    --------
    >>> room, hall = gonio.studio_light(32), np.roll(gonio.studio_light(32), 20, axis=1)
    >>> seen = [gonio.infer(found.relight(light, size=64), pictures=False) for light in (room, hall)]
    >>> both = gonio.combine(seen)
    >>> len(both.agreement)
    2
    """
    if is_path(posteriors) or isinstance(posteriors, Material):
        raise GonioError("posteriors: must be a list of posteriors or folders, one per photograph")
    listener(progress)
    given: list[str | tuple[str, _gonio.Likelihood]] = []
    for one in posteriors:
        if isinstance(one, Material):
            given.append((one.brdf.name, one._found["likelihood"]))
        elif is_path(one):
            given.append(os.fspath(one))
        else:
            raise GonioError(f"{one!r}: must be a posterior of gonio.infer or a folder of results")
    found_with = [one.model for one in posteriors if isinstance(one, Material)]
    known = found_with[0] if model is None and found_with else model_of(model)
    return Combined(_gonio.combine_all(given, known, {"progress": progress, "poll": None}), "combined")
