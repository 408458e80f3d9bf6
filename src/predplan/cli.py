"""The command line. Exit codes: 0 done, 1 the work failed, 2 bad input or usage.

Commands import what they need when they run, so that help appears at once.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

from cyclopts import App, CycloptsError, Parameter

from predplan import __version__
from predplan.cli_control import control
from predplan.cli_label import label
from predplan.cli_plan import plan
from predplan.errors import InputError, PredplanError

DONE, FAILED, BAD_INPUT, INTERRUPTED, PIPE_CLOSED = 0, 1, 2, 130, 141

LEARNING = ("gymnasium", "safetensors", "torch")
"""Packages that control alone needs."""

app = App(
    name="predplan",
    help="Prediction and planning with kernels and moments.",
    version=__version__,
    help_format="markdown",
    result_action="return_value",
    suppress_keyboard_interrupt=False,
)
app.command(label)
app.command(plan)
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
