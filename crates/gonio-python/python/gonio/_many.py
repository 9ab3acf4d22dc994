"""Many photographs at once."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterable, Mapping
from concurrent.futures import Future, ThreadPoolExecutor, as_completed
from typing import Any, cast

import numpy as np

from ._arguments import is_path
from ._arrays import name_of
from ._checks import defaults, known, listener, shown, whole
from ._infer import infer, run
from ._posterior import Posterior


class Failure:
    """What takes the place of a :class:`Posterior` where inference failed. It counts as false.

    Attributes
    ----------
    index : int
        Which item it was, from 0.
    name : str
        The item's file, or its number.
    error : BaseException
        Why.
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
    """Ends work for which nobody waits any more."""


def infer_many(
    items: Iterable[Any],
    client: Any = None,
    *,
    workers: int = 2,
    progress: Callable[[int, int], object] | None = None,
    **options: Any,
) -> list[Posterior | Failure]:
    """Infer many photographs, and go on where one fails.

    Parameters
    ----------
    items : iterable
        Photographs as :func:`gonio.infer` takes them, or dictionaries of its arguments.
    client : distributed.Client, optional
        The work is spread over its workers, which must have gonio and see the same files. Without
        one, threads of this process do it.
    workers : int, default 2
        Number of threads. A single inference uses several cores for most of its time, so that few
        are enough.
    progress : callable, optional
        Called with the number of items that are done and the number of all; an exception ends the
        work.
    **options
        Arguments of :func:`gonio.infer` for all items that do not give their own.

    Returns
    -------
    list of Posterior or Failure
        One for each item, in their order; a :class:`BasisPosterior` for methods of the paper.
        Warnings are in the posteriors and not issued.

    Raises
    ------
    TypeError
        If ``items`` is one photograph, or an option is none of :func:`gonio.infer`.

    Examples
    --------
    >>> results = gonio.infer_many(["samples/ball.exr", "missing.exr"], pictures=False)
    >>> [bool(result) for result in results]
    [True, False]
    >>> results[1].name
    'missing.exr'
    """
    known(options, infer, "infer")
    listener(progress)
    if is_path(items) or isinstance(items, bytes):
        what = "bytes" if isinstance(items, bytes) else "string" if isinstance(items, str) else "path"
        raise TypeError(f"items: {shown(items)} is one {what}; give a list of photographs: [{shown(items)}]")
    # A column of paths is a list, and so is a stack of pictures in colour.
    is_picture = len(getattr(items, "shape", ())) in (2, 3) or hasattr(items, "getbands")
    if isinstance(items, Mapping) or is_picture:
        what = "dictionary" if isinstance(items, Mapping) else "picture"
        raise TypeError(f"items: is one {what}; give a list of photographs, if only of this one: [photograph]")
    if not isinstance(items, Iterable):
        raise TypeError(f"items: give a list of photographs, not {shown(items)}")
    whole(workers, "workers", 1)
    tasks = [_task(item, options) for item in items]
    stop = threading.Event()
    pool = None if client is not None else ThreadPoolExecutor(workers, thread_name_prefix="gonio")
    try:
        futures = [_on_client(client, task) if pool is None else pool.submit(_one, task, stop) for task in tasks]
        results = _gather(tasks, futures, client, progress)
    except BaseException:
        # Ctrl-C, or an exception of `progress`: what runs stops soon, what waits never begins.
        stop.set()
        if client is not None:
            client.cancel(list(locals().get("futures", [])))
        raise
    finally:
        if pool is not None:
            pool.shutdown(wait=False, cancel_futures=True)
    return results


def _task(item: Any, options: Mapping[str, Any]) -> dict[str, Any]:
    """All arguments of infer for an item. What is wrong with them is told when it is inferred."""
    own = dict(item) if isinstance(item, Mapping) else {"image": item}
    return {**defaults(infer), **options, **own}


def _one(task: dict[str, Any], stop: threading.Event | None) -> Posterior:
    def poll() -> None:
        if stop is not None and stop.is_set():
            raise _Stopped

    known(task, infer, "infer")
    if task["image"] is defaults(infer)["image"]:
        raise TypeError("an item without an image")
    poll()
    return cast(Posterior, run(task, poll))


def _on_client(client: Any, task: dict[str, Any]) -> Any:
    """One task for a cluster. Pictures in memory go to a worker by themselves, not within the graph of tasks."""
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
