"""Make a recording of every artifact worth a look: recordings/ARTIFACT.rrd, to open with `predplan show` or Rerun."""

from __future__ import annotations

from predplan.inspection import record
from stages.common import CorpusStage, run_corpus_stage

ARTIFACTS = ("bigrams", "anchors", "posteriors", "transitions")
RESULTS = ("confusion", "tagged", "curve", "scores")


def main(stage: CorpusStage) -> None:
    for artifact in (*map(stage.path, map(table, ARTIFACTS)), *map(stage.result, map(table, RESULTS))):
        record(artifact, stage.path("recordings") / f"{artifact.stem}.rrd")


def table(name: str) -> str:
    """The file of a table."""
    return f"{name}.parquet"


if __name__ == "__main__":
    run_corpus_stage(main)
