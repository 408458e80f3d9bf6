"""Many independent pieces of work, in this process, in processes of this machine, or on a Dask cluster.

The results are the same, bit for bit, wherever they are computed: every piece runs with single-threaded linear
algebra, and results come back in the order of the items.
"""

from __future__ import annotations

import reprlib
from collections.abc import Callable, Generator, Iterable, Iterator
from concurrent.futures import BrokenExecutor, ThreadPoolExecutor
from contextlib import contextmanager
from typing import TypeVar, cast

from joblib import Parallel, delayed, parallel_config
from threadpoolctl import threadpool_limits

from predplan.errors import InputError, PredplanError

Item = TypeVar("Item")
Result = TypeVar("Result")

# Results waiting for the caller, for each worker, before no further items are taken.
WAITING_PER_WORKER = 8


def run(
    function: Callable[[Item], Result], items: Iterable[Item], *, workers: int, scheduler: str | None = None
) -> Iterator[Result]:
    """Results of `function` for each item, in order, while later ones are computed.

    `items` may be a generator of any length: it is read as workers become free, and not further than
    WAITING_PER_WORKER items a worker ahead of the caller. With one worker and no scheduler all happens in this
    process. `scheduler` is the address of a Dask scheduler (tcp://host:port), whose workers are used, all of them, in
    place of processes; they need predplan installed.

    `function` must be importable, or a functools.partial of such a function. An error in it is raised as a
    PredplanError (an InputError stays one) that names the item.
    """
    if workers < 1:
        raise InputError(f"workers: found {workers}, expected at least 1")
    if scheduler is None and workers == 1:
        return (_attempt(function, index, item) for index, item in enumerate(items))
    return _distribute(function, items, workers, scheduler)


def ahead(items: Iterable[Item]) -> Iterator[Item]:
    """The items, each made by a thread while the caller works on the one before.

    It pays where making them waits for files or leaves the interpreter to others, as NumPy and numba do.
    """
    source, end = iter(items), object()
    with ThreadPoolExecutor(1) as thread:
        coming = thread.submit(next, source, end)
        while (item := coming.result()) is not end:
            coming = thread.submit(next, source, end)
            yield cast(Item, item)


def _distribute(
    function: Callable[[Item], Result], items: Iterable[Item], workers: int, scheduler: str | None
) -> Generator[Result, None, None]:
    """Rounds of a joblib generator. joblib hands out a new item whenever one is done, even if the caller is slow to
    take results; so a round stops taking items when too many results wait, and the next begins when they are taken.
    """
    source, exhausted = enumerate(items), False
    taken = given = 0

    def admitted() -> Iterator[tuple[int, Item]]:
        nonlocal taken, exhausted
        while taken - given < limit:
            following = next(source, None)
            if following is None:
                exhausted = True
                return
            taken += 1
            yield following

    with _backend(workers, scheduler) as cores, Parallel(return_as="generator", batch_size=1) as parallel:
        limit = WAITING_PER_WORKER * cores
        while not exhausted:
            for result in _or_lost(parallel(delayed(_attempt)(function, *item) for item in admitted())):
                given += 1
                yield result


@contextmanager
def _backend(workers: int, scheduler: str | None) -> Iterator[int]:
    """Configure joblib, and give the number of workers."""
    if scheduler is None:
        # Copy-on-write: large arrays are shared between processes, yet can be written to as in this process.
        with parallel_config("loky", n_jobs=workers, inner_max_num_threads=1, mmap_mode="c"):
            yield workers
        return
    try:
        from predplan import cluster
    except ImportError as error:
        raise InputError(
            f"scheduler: found {scheduler!r}, which needs the extra: pip install 'predplan[dask]'"
        ) from error
    with cluster.connect(scheduler) as (backend, cores), parallel_config(backend, n_jobs=-1):
        yield cores


def _or_lost(results: Iterator[Result]) -> Iterator[Result]:
    """The results, with a clear error where a worker process died."""
    try:
        yield from results
    except BrokenExecutor as error:
        raise PredplanError(
            "a worker process died at its work, most often for want of memory; try fewer workers"
        ) from error


def _attempt(function: Callable[[Item], Result], index: int, item: Item) -> Result:
    """function(item) with single-threaded linear algebra and an error that names the item."""
    try:
        with threadpool_limits(1):
            return function(item)
    except InputError as error:
        raise InputError(f"item {index} ({reprlib.repr(item)}): {error}") from error
    except PredplanError as error:
        raise PredplanError(f"item {index} ({reprlib.repr(item)}): {error}") from error
    except Exception as error:
        raise PredplanError(f"item {index} ({reprlib.repr(item)}): {type(error).__name__}: {error}") from error
