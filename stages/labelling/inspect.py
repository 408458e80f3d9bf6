"""Make a recording of every artifact worth a look: recordings/ARTIFACT.rrd, to open with `predplan show` or Rerun."""

from __future__ import annotations

from functools import partial
from pathlib import Path

from predplan.inspection import record
from predplan.parallel import run
from stages.common import CorpusStage, run_stage

ARTIFACTS = ("bigrams", "anchors", "posteriors", "transitions")
RESULTS = ("confusion", "tagged", "curve", "scores")


def main(stage: CorpusStage) -> None:
    artifacts = (*map(stage.result, map(table, RESULTS)), *map(stage.path, map(table, ARTIFACTS)))
    # A worker that was started elsewhere reads from there: whole paths.
    work = partial(record_into, folder=stage.path("recordings").absolute())
    list(
        run(
            work,
            [artifact.absolute() for artifact in artifacts],
            workers=stage.settings.workers,
            scheduler=stage.settings.scheduler,
        )
    )


def record_into(artifact: Path, folder: Path) -> None:
    """Write the recording of one artifact."""
    record(artifact, folder / f"{artifact.stem}.rrd")


def table(name: str) -> str:
    """The file of a table."""
    return f"{name}.parquet"


if __name__ == "__main__":
    run_stage(CorpusStage, main)
