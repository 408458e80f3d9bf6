import logging
import os
import socket
import time
from collections.abc import Iterator
from functools import partial

import numpy as np
import psutil
import pytest
from distributed import LocalCluster
from numpy.typing import NDArray
from threadpoolctl import threadpool_info

from predplan.errors import InputError, PredplanError
from predplan.parallel import WAITING_PER_WORKER, run


def spectrum(seed: int) -> bytes:
    matrix = np.random.default_rng(seed).standard_normal((60, 60))
    return np.linalg.svd(matrix @ matrix.T, compute_uv=False).tobytes()


def process_and_threads(_: int) -> tuple[int, int]:
    np.linalg.norm(np.eye(3))
    return os.getpid(), max(pool["num_threads"] for pool in threadpool_info())


def slow_process(_: int) -> int:
    time.sleep(0.05)
    return os.getpid()


def add_in_place(total: NDArray[np.float64], amount: float) -> float:
    total += amount
    return float(total[0])


def fail_at_three(item: int) -> int:
    if item == 3:
        raise ValueError("a number I dislike")
    return item


def refuse(item: str) -> str:
    raise InputError(f"{item}: empty file")


def die(_: int) -> int:
    os._exit(1)


def keep_first_waiting(item: int) -> int:
    time.sleep(0.3 if item == 0 else 0)
    return item


def two_processes() -> LocalCluster:
    return LocalCluster(
        n_workers=2,
        threads_per_worker=1,
        processes=True,
        protocol="tcp",
        host="127.0.0.1",
        dashboard_address="127.0.0.1:0",
        worker_dashboard_address="127.0.0.1:0",
        silence_logs=logging.CRITICAL,
    )


@pytest.fixture(scope="module")
def cluster() -> Iterator[LocalCluster]:
    with two_processes() as cluster:
        yield cluster


def test_same_bytes_here_in_processes_and_on_a_cluster(cluster: LocalCluster) -> None:
    here = list(run(spectrum, range(12), workers=1))
    assert here == list(run(spectrum, range(12), workers=2))
    assert here == list(run(spectrum, range(12), workers=1, scheduler=cluster.scheduler_address))


def test_the_cluster_is_two_processes_that_listen_on_loopback_only(cluster: LocalCluster) -> None:
    processes = set(run(slow_process, range(20), workers=1, scheduler=cluster.scheduler_address))
    assert len(processes) == 2
    assert os.getpid() not in processes
    for process in [psutil.Process(), *map(psutil.Process, processes)]:
        listening = {c.laddr.ip for c in process.net_connections("tcp") if c.status == psutil.CONN_LISTEN}
        assert listening <= {"127.0.0.1"}


def test_linear_algebra_runs_on_one_thread_everywhere(cluster: LocalCluster) -> None:
    places = [{"workers": 1}, {"workers": 2}, {"workers": 1, "scheduler": cluster.scheduler_address}]
    for place in places:
        assert {threads for _, threads in run(process_and_threads, range(3), **place)} == {1}


@pytest.mark.parametrize("on_cluster", [False, True])
@pytest.mark.parametrize("workers", [1, 2])
def test_an_error_names_its_item(workers: int, on_cluster: bool, cluster: LocalCluster) -> None:
    scheduler = cluster.scheduler_address if on_cluster else None
    with pytest.raises(PredplanError, match=r"item 3 \(3\): ValueError: a number I dislike"):
        list(run(fail_at_three, range(5), workers=workers, scheduler=scheduler))
    with pytest.raises(InputError, match=r"item 0 \('a.txt'\): a.txt: empty file"):
        list(run(refuse, ["a.txt"], workers=workers, scheduler=scheduler))


def test_a_lost_worker_is_said() -> None:
    with pytest.raises(PredplanError, match="worker process died"):
        list(run(die, range(2), workers=2))


def test_a_cluster_that_loses_work_is_said() -> None:
    with two_processes() as cluster, pytest.raises(PredplanError, match=r"the Dask cluster lost work: .*workers died"):
        list(run(die, range(2), workers=1, scheduler=cluster.scheduler_address))


@pytest.mark.filterwarnings("ignore:.*tasks have been successfully executed:UserWarning")
@pytest.mark.parametrize("workers", [1, 2])
def test_an_endless_generator_is_read_only_a_little_ahead(workers: int) -> None:
    taken = 0

    def endless() -> Iterator[int]:
        nonlocal taken
        while True:
            taken += 1
            yield taken - 1

    results = run(keep_first_waiting, endless(), workers=workers)
    for given in range(40):
        assert next(results) == given
        time.sleep(0.005)
        assert taken - given <= WAITING_PER_WORKER * workers + 1


def test_no_items_no_results() -> None:
    assert list(run(fail_at_three, [], workers=2)) == []


def test_shared_arrays_may_be_written_to_in_a_process_without_reaching_the_callers() -> None:
    total = np.zeros(1 << 18)
    assert list(run(partial(add_in_place, total), [1.0], workers=2)) == [1.0]
    assert not total.any()


def test_an_unreachable_scheduler_is_said_in_seconds() -> None:
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        address = f"tcp://127.0.0.1:{free.getsockname()[1]}"
    begin = time.monotonic()
    with pytest.raises(InputError, match=f"no Dask scheduler answers at '{address}'"):
        list(run(fail_at_three, range(2), workers=1, scheduler=address))
    assert time.monotonic() - begin < 15


def test_a_scheduler_without_workers_is_said() -> None:
    with (
        LocalCluster(n_workers=0, host="127.0.0.1", protocol="tcp", dashboard_address="127.0.0.1:0") as empty,
        pytest.raises(InputError, match="has no workers"),
    ):
        list(run(fail_at_three, range(2), workers=1, scheduler=empty.scheduler_address))


def test_no_workers_is_an_error() -> None:
    with pytest.raises(InputError, match="workers: found 0"):
        run(fail_at_three, [], workers=0)
