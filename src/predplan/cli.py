"""The command line. Exit codes: 0 done, 1 the work failed, 2 bad input or usage.

Commands import what they need when they run, so that help appears at once.
"""

from __future__ import annotations

import contextlib
import io
import logging
import os
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal, cast

from cyclopts import App, CycloptsError, Parameter

from predplan import __version__
from predplan.errors import InputError, PredplanError

if TYPE_CHECKING:
    from rich.status import Status

    from predplan.labelling.evaluation import Scores

DONE, FAILED, BAD_INPUT, INTERRUPTED, PIPE_CLOSED = 0, 1, 2, 130, 141

app = App(
    name="predplan",
    help="Prediction and planning with kernels and moments.",
    version=__version__,
    help_format="markdown",
    result_action="return_value",
)
label = App(name="label", help="Tag words, from raw text and a few labelled sentences.")
app.command(label)


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the command line and leave with its exit code."""
    sys.exit(run(sys.argv[1:] if arguments is None else arguments))


def run(arguments: Sequence[str]) -> int:
    """Run one command and give its exit code; faults are one line on stderr."""
    try:
        app(arguments, exit_on_error=False, print_error=False)
        sys.stdout.flush()
    except (CycloptsError, InputError) as error:
        return _failed(error, BAD_INPUT)
    except BrokenPipeError:
        # What Python would still flush at its end has nowhere to go.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return PIPE_CLOSED
    except (PredplanError, OSError) as error:
        return _failed(error, FAILED)
    except KeyboardInterrupt:
        return INTERRUPTED
    return DONE


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
    with _progress():
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


@app.command
def show(
    artifact: Annotated[Path, Parameter(help="A file or folder that a stage or command of predplan wrote.")],
    /,
    *,
    save: Annotated[Path | None, Parameter(help="Write a recording here and open no viewer.")] = None,
) -> None:
    """Look at an artifact in the Rerun viewer.

    ```
    predplan show data/labelling/brown/posteriors.parquet
    predplan show model --save model.rrd
    ```
    """
    if not artifact.exists():
        raise InputError(f"{artifact}: no such file or folder; expected an artifact of predplan")
    from predplan.inspection import show as look_at

    look_at(artifact, save)


def _failed(error: Exception, code: int) -> int:
    message = " ".join(str(error).split())
    sys.stderr.write(f"predplan: {message}\n")
    return code


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


@contextmanager
def _progress() -> Iterator[None]:
    """While the block runs, its log lines stand beside a spinner, if stderr is a terminal; warnings are lines."""
    logger = logging.getLogger("predplan")
    handlers: list[logging.Handler] = [_WarningLines(logging.WARNING)]
    level = logger.level
    with contextlib.ExitStack() as stack:
        if sys.stderr.isatty():
            from rich.console import Console

            handlers.append(_Spinner(stack.enter_context(Console(stderr=True).status("reading"))))
            logger.setLevel(logging.INFO)
        for handler in handlers:
            logger.addHandler(handler)
            stack.callback(logger.removeHandler, handler)
        stack.callback(logger.setLevel, level)
        yield


class _WarningLines(logging.Handler):
    def emit(self, record: logging.LogRecord) -> None:
        sys.stderr.write(f"predplan: {record.getMessage()}\n")


class _Spinner(logging.Handler):
    def __init__(self, status: Status) -> None:
        super().__init__(logging.INFO)
        self._status = status

    def emit(self, record: logging.LogRecord) -> None:
        if record.levelno < logging.WARNING:
            self._status.update(record.getMessage())


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
