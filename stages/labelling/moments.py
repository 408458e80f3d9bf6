"""Count neighbouring words: words.parquet and bigrams.parquet. Each batch's counts are kept, so a cut run goes on."""

from __future__ import annotations

import shutil

from predplan.artifacts.tables import read_table
from predplan.labelling.counting import merge_parts, write_part
from predplan.labelling.tables import VOCABULARY, open_token_batches, write_bigrams
from stages.common import CorpusStage, run_stage


def main(stage: CorpusStage) -> None:
    tokens, vocabulary = stage.path("tokens.parquet"), stage.path("vocabulary.parquet")
    provenance = stage.provenance(tokens, vocabulary)
    words = read_table(vocabulary, VOCABULARY)["word"].to_pylist()
    parts_folder = stage.path("parts") / provenance.upstream["tokens.parquet"][:16]
    parts = []
    with open_token_batches(tokens) as batches:
        for number, (ids, offsets) in enumerate(batches):
            parts.append(parts_folder / f"part-{number:05d}.parquet")
            write_part(parts[-1], ids, offsets)
    write_bigrams(stage.path("words.parquet"), stage.path("bigrams.parquet"), merge_parts(parts, words), provenance)
    shutil.rmtree(stage.path("parts"))


if __name__ == "__main__":
    run_stage(CorpusStage, main)
