"""`predplan label`: learn a tagger, tag with it, and score it.

Commands import what they need when they run, so that help appears at once.
"""

from __future__ import annotations

import io
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal, cast

from cyclopts import App, Parameter

from predplan.cli_progress import progress
from predplan.errors import InputError

if TYPE_CHECKING:
    from predplan.labelling.evaluation import Scores

label = App(name="label", help="Tag words, from raw text and a few labelled sentences.")


@label.command
def fit(
    *,
    labelled: Annotated[Path, Parameter(help="Labelled sentences: CoNLL-U, or token and tag parted by a tab.")],
    out: Annotated[Path, Parameter(help="Folder to write the model to; a model that is there is replaced.")],
    raw: Annotated[
        list[Path] | None,
        Parameter(
            help="Raw text, one sentence a line, plain, gzip or zstd; several, or repeat.", consume_multiple=True
        ),
    ] = None,
    dictionary: Annotated[Path | None, Parameter(help="Tag dictionary: word and tag parted by a tab.")] = None,
    dev: Annotated[Path | None, Parameter(help="Labelled sentences to choose a few settings on.")] = None,
    model: Annotated[
        Literal["hmm", "fhmm", "crf"],
        Parameter(help="Hidden Markov model, one with features, or a conditional random field on the posteriors."),
    ] = "hmm",
    loss: Annotated[
        Literal["ls", "kl"], Parameter(help="Least squares or likelihood for the mixtures of words.")
    ] = "kl",
    lam: Annotated[float, Parameter(name="--lambda", help="Weight of a word's own labels, 0 to 1.")] = 1.0,
    seed: Annotated[int, Parameter(help="Seed: the same one gives the same bytes.")] = 0,
    style: Annotated[
        Literal["spaces", "tweets"], Parameter(help="Raw text has its tokens parted by spaces, or is tweets.")
    ] = "spaces",
    workers: Annotated[int, Parameter(help="Processes that tokenise; more than 1 pays above 10 million tokens.")] = 1,
) -> None:
    """Learn a tagger from a few labelled sentences and raw text.

    A token with the tag `_` is not labelled, and counts as raw text.

    ```
    predplan label fit --labelled train.conllu --raw raw.txt.gz --out model
    predplan label fit --labelled train.tsv --raw a.txt b.txt --model crf --out m
    predplan label fit --labelled a.tsv --raw b.gz --style tweets --out model
    ```
    """
    from predplan.labelling import AnchorTagger, read_dictionary, read_labelled
    from predplan.labelling.readers import RawText, read_raw
    from predplan.labelling.storage import check_target

    tagger = AnchorTagger(model, loss, lam, seed)
    check_target(out)
    text = read_raw(*raw, style=style) if raw else RawText((), style)
    with progress():
        tagger.fit(
            read_labelled(labelled),
            text,
            None if dictionary is None else read_dictionary(dictionary),
            None if dev is None else read_labelled(dev),
            workers,
        )
        tagger.save(out)


@label.command
def tag(
    model: Annotated[Path, Parameter(help="Folder of a model.")],
    file: Annotated[str, Parameter(help="Sentences to tag; - for standard input.", allow_leading_hyphen=True)] = "-",
    /,
) -> None:
    """Tag sentences: one a line with tokens parted by spaces, or CoNLL-U. Writes CoNLL-U.

    ```
    predplan label tag model sentences.txt > tagged.conllu
    echo "Tsy miampanga ." | predplan label tag model
    ```
    """
    from predplan.labelling import AnchorTagger
    from predplan.labelling.tagging import tag_lines

    tagger = AnchorTagger.load(model)
    name = "standard input" if file == "-" else file
    for text in tag_lines(tagger.predict, _lines(file), name):
        sys.stdout.buffer.write(text.encode())


@label.command
def score(
    model: Annotated[Path, Parameter(help="Folder of a model, or a file of predicted tags for the same words.")],
    gold: Annotated[Path, Parameter(help="Labelled sentences.")],
    /,
    *,
    as_json: Annotated[bool, Parameter(name="--json", help="Write JSON.", negative="")] = False,
) -> None:
    """Score a model on labelled sentences: accuracy, that on unknown words, and each tag's precision, recall and F1.

    Unknown words are those that no sentence the model learned from has labelled.

    ```
    predplan label score model test.conllu
    predplan label score tagged.conllu test.conllu --json
    ```
    """
    import json

    from predplan.labelling.scoring import as_plain_data, score_model, score_predictions

    scores = score_model(model, gold) if model.is_dir() or not model.exists() else score_predictions(model, gold)
    if as_json:
        sys.stdout.write(json.dumps(as_plain_data(scores), indent=2, ensure_ascii=False) + "\n")
    else:
        _print_table(scores)


def _lines(file: str) -> Iterator[bytes]:
    """The lines of a plain or compressed file, or of standard input for -."""
    from predplan.labelling.readers import open_bytes

    if file == "-":
        yield from sys.stdin.buffer
        return
    with open_bytes(file) as stream:
        try:
            yield from io.BufferedReader(cast(io.RawIOBase, stream))
        except OSError as error:
            raise InputError(f"{file}: cannot be read ({error}); is it cut short?") from error


def _print_table(scores: Scores) -> None:
    from rich.console import Console
    from rich.table import Table

    console = Console()
    table = Table("tag", title=f"accuracy {scores.accuracy:.2%} of {scores.tokens:,} tokens")
    for name in ("precision", "recall", "F1", "tokens"):
        table.add_column(name, justify="right")
    for tag in scores.per_tag:
        table.add_row(tag.tag, f"{tag.precision:.2%}", f"{tag.recall:.2%}", f"{tag.f1:.2%}", f"{tag.support:,}")
    console.print(table)
    if scores.unknown_accuracy is not None:
        console.print(f"unknown words: {scores.unknown_accuracy:.2%} of {scores.unknown_tokens:,} tokens")
    console.print(f"sentences without a wrong tag: {scores.sentence_accuracy:.2%}")
