"""The command line. Exit codes: 0 done, 1 the work failed, 2 bad input or usage.

Commands import what they need when they run, so that help appears at once.
"""

from __future__ import annotations

import contextlib
import io
import logging
import os
import sys
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, cast

from cyclopts import App, CycloptsError, Parameter

from predplan import __version__
from predplan.cli_control import control
from predplan.errors import InputError, PredplanError

if TYPE_CHECKING:
    from rich.status import Status

    from predplan.artifacts.provenance import Provenance
    from predplan.labelling.evaluation import Scores

DONE, FAILED, BAD_INPUT, INTERRUPTED, PIPE_CLOSED = 0, 1, 2, 130, 141

LEARNING = ("gymnasium", "safetensors", "torch")
"""Packages that control alone needs."""

app = App(
    name="predplan",
    help="Prediction and planning with kernels and moments.",
    version=__version__,
    help_format="markdown",
    result_action="return_value",
)
label = App(name="label", help="Tag words, from raw text and a few labelled sentences.")
app.command(label)
app.command(control)


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
    except ModuleNotFoundError as error:
        extra = (
            "control" if str(error.name).split(".")[0] in LEARNING or control.name[0] in arguments[:1] else "planning"
        )
        needed = f"the package {error.name} is not installed; pip install 'predplan[{extra}]' brings what is needed"
        return _failed(PredplanError(needed), BAD_INPUT)
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
def plan(
    *,
    robot: Annotated[Path, Parameter(help="The robot: URDF (with the SRDF beside it, if there is one) or MJCF.")],
    scene: Annotated[Path, Parameter(help="Obstacles: a MoveIt planning scene as YAML, or the bodies of an MJCF.")],
    request: Annotated[Path, Parameter(help="Start and goal by joint: a MoveIt motion-plan request as YAML.")],
    out: Annotated[Path, Parameter(help="MCAP to write the trajectory to; a file that is there is replaced.")],
    method: Annotated[
        Literal["cascade", "kernel", "sampled"],
        Parameter(help="Kernel starts and, where they fail, sampled ones; or either kind alone."),
    ] = "cascade",
    budget: Annotated[
        float, Parameter(help="Seconds to plan in, once files are read and compiled code is loaded.")
    ] = 1.0,
    seed: Annotated[int, Parameter(help="Seed of the draws and samples.")] = 0,
    cylinders_as: Annotated[
        Literal["cylinder", "capsule", "box"], Parameter(help="What the scene's cylinders are taken as.")
    ] = "cylinder",
    primitives: Annotated[
        Literal["all", "first"], Parameter(help="All parts of a MoveIt collision object, or its first alone.")
    ] = "all",
    acceleration_limit: Annotated[
        float | None, Parameter(help="rad/s² or m/s², of every joint; no robot format states any. By default 10.")
    ] = None,
    as_json: Annotated[bool, Parameter(name="--json", help="Write JSON.", negative="")] = False,
) -> None:
    """Plan a motion that is proved free of collision, not only where it was sampled, and time it within the limits.

    Plans the joints that the goal names; the start's other joints are held where they are. Exit code 1 says that no
    certified motion was found within the budget; nothing is written then.

    ```
    predplan plan --robot panda.urdf --scene s.yaml --request r.yaml --out p.mcap
    predplan plan --robot arm.xml --scene s.xml --request r.yaml --out p.mcap --json
    predplan show p.mcap
    ```

    The published MotionBenchMaker problems take `--primitives first --cylinders-as capsule` (in the set box: `box`).
    """
    import json
    import time

    from predplan.planning import Planner, read_request, read_robot, read_scene
    from predplan.planning.plan_files import write_plan
    from predplan.planning.summaries import as_plain_data, lines_of

    _check_plan_options(out, (robot, scene, request), budget, seed)
    with _progress():
        asked = read_request(request)
        held = {joint: value for joint, value in asked.start.items() if joint not in asked.goal}
        arm = read_robot(robot, joints=list(asked.goal), fixed=held, acceleration_limit=acceleration_limit)
        began = time.perf_counter()
        obstacles = read_scene(scene, cylinders_as=cylinders_as, primitives=primitives)
        scene_time = time.perf_counter() - began
        start, goal = asked.configurations(arm)
        logging.getLogger("predplan").info("loading compiled code; the first time, compiling takes a minute")
        planner = Planner(arm)
        found = planner.plan(obstacles, start, goal, budget, method, seed)
        if found.success:
            options = {"method": method, "cylinders_as": cylinders_as, "primitives": primitives}
            write_plan(out, found, _plan_provenance(options | asdict(planner.settings), seed, robot, scene, request))
    if as_json:
        sys.stdout.write(json.dumps(as_plain_data(found) | {"scene_time_s": scene_time}, indent=2) + "\n")
    elif found.success:
        for line in lines_of(found):
            sys.stdout.write(line + "\n")
        sys.stdout.write(f"scene read    {1000 * scene_time:.1f} ms\nwritten       {out}\n")
    if not found.success:
        raise PredplanError(found.reason)


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


def _check_plan_options(out: Path, inputs: Sequence[Path], budget: float, seed: int) -> None:
    """Raise InputError before anything slow begins."""
    if not 0.0 < budget < float("inf"):
        raise InputError(f"--budget is {budget} s; expected a finite number above 0")
    if seed < 0:
        raise InputError(f"--seed is {seed}; expected 0 or more")
    if out.is_dir():
        raise InputError(f"{out} is a folder; expected a file to write")
    if any(out.resolve() == one.resolve() for one in inputs):
        raise InputError(f"--out is {out}, which is read; expected another file")


def _plan_provenance(params: Mapping[str, Any], seed: int, robot: Path, scene: Path, request: Path) -> Provenance:
    from predplan.artifacts.provenance import Provenance, hash_file

    read = {"robot": robot, "scene": scene, "request": request}
    return Provenance(params, seed, upstream={name: hash_file(path) for name, path in read.items()})


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
