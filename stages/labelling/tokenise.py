"""Raw text to token ids: tokens.parquet and the vocabulary they index; malformed lines are counted, not fatal."""

from __future__ import annotations

from functools import partial

from predplan.artifacts.files import write_json
from predplan.artifacts.tables import open_writer, write_table
from predplan.labelling.counting import WordIndex
from predplan.labelling.readers import RawText
from predplan.labelling.tables import TOKENS, VOCABULARY, token_rows
from predplan.labelling.tokenising import LineReport, read_blocks, tokenise_block
from predplan.parallel import run
from stages.common import CorpusStage, run_stage


def main(stage: CorpusStage) -> None:
    paths = tuple(sorted(stage.path("raw").iterdir()))
    provenance = stage.provenance(*paths, style=stage.corpus.style)
    index, report = WordIndex(), LineReport()
    blocks = read_blocks(RawText(paths, stage.corpus.style))
    settings = stage.settings
    work = partial(tokenise_block, style=stage.corpus.style)
    batches = run(work, blocks, workers=settings.workers, scheduler=settings.scheduler)
    with open_writer(stage.path("tokens.parquet"), TOKENS, provenance) as write:
        for batch, lines in batches:
            report += lines
            write(token_rows(index.global_ids(batch), batch.offsets))
    write_table(stage.path("vocabulary.parquet"), VOCABULARY, {"word": index.words}, provenance)
    write_json(
        stage.path("tokenise.json"),
        {
            "lines": report.lines,
            "tokens": report.tokens,
            "words": len(index.words),
            "malformed": {"bad_utf8": report.bad_utf8, "nul": report.nul, "too_long": report.too_long},
        },
    )


if __name__ == "__main__":
    run_stage(CorpusStage, main)
