"""Inference from many photographs."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterable, Mapping
from concurrent.futures import Future, ThreadPoolExecutor, as_completed
from typing import Any, cast

import numpy as np

from ._arguments import is_path
from ._arrays import name_of
from ._validation import check_arguments, defaults, integer, listener, shown
from ._infer import infer, run
from ._posterior import Posterior


class Failure:
    """Result of a failed inference, in place of a :class:`Posterior`. Its truth value is false.

    Attributes
    ----------
    index : int
        Index of the item, from 0.
    name : str
        File of the item, or its number.
    error : BaseException
        The exception.
    """

    def __init__(self, index: int, name: str, error: BaseException) -> None:
        self.index = index
        self.name = name
        self.error = error

    def __bool__(self) -> bool:
        return False

    def __repr__(self) -> str:
        return f"<gonio.Failure {self.name}: {self.error}>"


class _Stopped(BaseException):
    """Stops inferences after an interruption."""


def infer_many(
    items: Iterable[Any],
    client: Any = None,
    *,
    workers: int = 2,
    progress: Callable[[int, int], object] | None = None,
    **options: Any,
) -> list[Posterior | Failure]:
    """Infer the materials of many photographs, and continue after failures.

    Parameters
    ----------
    items : iterable
        Photographs as for :func:`gonio.infer`, or dictionaries of its arguments.
    client : distributed.Client, optional
        Dask client whose workers run the inferences; they must have gonio and access to the same
        files. By default, threads of this process run them.
    workers : int, default 2
        Number of threads. A single inference uses several cores most of the time, so a few threads
        suffice.
    progress : callable, optional
        Called with the number of finished items and the number of all items; an exception stops the
        inferences.
    **options
        Arguments of :func:`gonio.infer` for all items that do not override them.

    Returns
    -------
    list of Posterior or Failure
        One result per item, in order; a :class:`BasisPosterior` for methods of the paper. Warnings
        are stored in the posteriors, but not issued.

    Raises
    ------
    TypeError
        If ``items`` is one photograph, or :func:`gonio.infer` does not have an option.

    Examples
    --------
    >>> results = gonio.infer_many(["samples/ball.exr", "missing.exr"], pictures=False)
    >>> [bool(result) for result in results]
    [True, False]
    >>> results[1].name
    'missing.exr'
    """
    check_arguments(options, infer, "infer")
    listener(progress)
    if is_path(items) or isinstance(items, bytes):
        what = "bytes" if isinstance(items, bytes) else "string" if isinstance(items, str) else "path"
        raise TypeError(f"items: {shown(items)} is one {what}; use a list of photographs: [{shown(items)}]")
    # A one-dimensional array of paths and a stack of colour images are lists.
    is_picture = len(getattr(items, "shape", ())) in (2, 3) or hasattr(items, "getbands")
    if isinstance(items, Mapping) or is_picture:
        what = "dictionary" if isinstance(items, Mapping) else "image"
        raise TypeError(f"items: is one {what}; use a list of photographs: [photograph]")
    if not isinstance(items, Iterable):
        raise TypeError(f"items: must be a list of photographs, not {shown(items)}")
    integer(workers, "workers", 1)
    tasks = [_task(item, options) for item in items]
    stop = threading.Event()
    pool = None if client is not None else ThreadPoolExecutor(workers, thread_name_prefix="gonio")
    try:
        futures = [_on_client(client, task) if pool is None else pool.submit(_one, task, stop) for task in tasks]
        results = _gather(tasks, futures, client, progress)
    except BaseException:
        # Ctrl-C or an exception of `progress`: stop running inferences and cancel queued ones.
        stop.set()
        if client is not None:
            client.cancel(list(locals().get("futures", [])))
        raise
    finally:
        if pool is not None:
            pool.shutdown(wait=False, cancel_futures=True)
    return results


def _task(item: Any, options: Mapping[str, Any]) -> dict[str, Any]:
    """Returns all arguments of infer for an item. They are checked when the item is inferred."""
    own = dict(item) if isinstance(item, Mapping) else {"image": item}
    return {**defaults(infer), **options, **own}


def _one(task: dict[str, Any], stop: threading.Event | None) -> Posterior:
    def poll() -> None:
        if stop is not None and stop.is_set():
            raise _Stopped

    check_arguments(task, infer, "infer")
    if task["image"] is defaults(infer)["image"]:
        raise TypeError("the item has no image")
    poll()
    return cast(Posterior, run(task, poll))


def _on_client(client: Any, task: dict[str, Any]) -> Any:
    """Submits one task to a cluster. Images in memory are sent to workers separately from the task graph."""
    large = {key: value for key, value in task.items() if isinstance(value, np.ndarray)}
    rest = {key: value for key, value in task.items() if key not in large}
    sent = dict(zip(large, client.scatter(list(large.values()), hash=False))) if large else {}
    return client.submit(_assembled, rest, pure=False, **{f"array_{key}": value for key, value in sent.items()})


def _assembled(rest: dict[str, Any], **arrays: Any) -> Posterior:
    return _one({**rest, **{key.removeprefix("array_"): value for key, value in arrays.items()}}, None)


def _gather(
    tasks: list[dict[str, Any]], futures: list[Any], client: Any, progress: Callable[[int, int], object] | None
) -> list[Posterior | Failure]:
    index = {future: i for i, future in enumerate(futures)}
    results: list[Any] = [None] * len(futures)
    if client is None:
        finished: Iterable[Future[Posterior]] = as_completed(futures)
    else:
        import distributed

        on_cluster: Any = distributed.as_completed
        finished = on_cluster(futures)
    for done, future in enumerate(finished, 1):
        i = index[future]
        try:
            results[i] = future.result()
        except Exception as error:
            results[i] = Failure(i, name_of(tasks[i]["image"], f"item {i}"), error)
        if progress is not None:
            progress(done, len(futures))
    return results
