"""A Dask cluster as a backend of joblib; needs the extra `dask`."""

from __future__ import annotations

from asyncio import CancelledError
from collections.abc import Callable, Iterator
from concurrent.futures import Future
from contextlib import contextmanager
from typing import Any

from distributed import Client

# joblib.parallel_config takes the backend by name only as it is, which waits for ever once a worker is lost.
from joblib._dask import DaskDistributedBackend

from predplan.errors import InputError, PredplanError

CONNECT_TIMEOUT_S = 5


@contextmanager
def connect(scheduler: str) -> Iterator[tuple[DaskDistributedBackend, int]]:
    """A backend on the scheduler's workers, and the number of their threads.

    Raises InputError if no scheduler answers at the address (tcp://host:port), or one without workers.
    """
    try:
        client = Client(scheduler, timeout=CONNECT_TIMEOUT_S, set_as_default=False)
    except (OSError, ValueError) as error:
        raise InputError(
            f"scheduler: no Dask scheduler answers at {scheduler!r} within {CONNECT_TIMEOUT_S} s; "
            "expected tcp://host:port of one that runs (dask scheduler), or no scheduler at all"
        ) from error
    with client:
        try:
            client.wait_for_workers(1, timeout=CONNECT_TIMEOUT_S)
        except TimeoutError as error:
            raise InputError(
                f"scheduler: the Dask scheduler at {scheduler!r} has no workers; start some (dask worker)"
            ) from error
        yield _LossNoticingBackend(client=client), sum(client.nthreads().values())


class _LossNoticingBackend(DaskDistributedBackend):
    """joblib's Dask backend, which tells joblib of results only; this one tells it of lost work too."""

    def submit(self, func: Any, callback: Callable[[Any], None]) -> Future[Any]:
        future: Future[Any] = super().submit(func, callback)
        future.add_done_callback(lambda done: callback(done) if done.exception() else None)
        return future

    def retrieve_result_callback(self, out: Any) -> Any:
        try:
            return super().retrieve_result_callback(out.result() if isinstance(out, Future) else out)
        except PredplanError:
            raise
        except (Exception, CancelledError) as error:
            raise PredplanError(f"the Dask cluster lost work: {error}") from error
