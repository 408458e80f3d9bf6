from pathlib import Path

import pytest

from predplan.artifacts.provenance import Provenance
from predplan.artifacts.tables import read_rows, write_rows
from predplan.control.benchmark_tables import PEERS
from predplan.reporting.control.speeds import PEER
from stages.control import speeds


def row(task: str, learner: str, seed: int) -> dict[str, object]:
    numbers = {"steps": 1000, "mean_return": 1.0, "final_return": 2.0, "cpu_s": 3.0}
    return {"task": task, "learner": learner, "seed": seed, **numbers}


def test_runs_that_are_in_the_table_are_not_repeated(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "peers.parquet"
    known = [row("cartpole", name, 0) for name in (PEER, "rpsp")]
    write_rows(path, PEERS, known, Provenance({}))

    def interrupted(*_: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(speeds, "train_peer", interrupted)
    monkeypatch.setattr(speeds, "PEER_TASKS", ("cartpole",))
    assert speeds.beside_peer(path, 1000, 1, again=False) == known
    with pytest.raises(KeyboardInterrupt):
        speeds.beside_peer(path, 1000, 2, again=False)
    assert read_rows(path, PEERS) == known
    with pytest.raises(KeyboardInterrupt):
        speeds.beside_peer(path, 1000, 1, again=True)
