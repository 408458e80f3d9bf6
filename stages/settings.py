"""The whole of params.yaml as frozen models: every knob of the pipeline, checked before any stage works.

One model a component, each field followed by a line that says what it changes. To add a component, write its model
and name it as a field of the one above; unknown keys, wrong types and impossible values are then errors by themselves.
"""

from __future__ import annotations

import difflib
import json
from dataclasses import is_dataclass
from pathlib import Path
from typing import Annotated, Any, Literal, get_args, get_type_hints

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, StringConstraints, ValidationError, field_validator
from pydantic_core import ErrorDetails
from ruamel.yaml import YAML
from ruamel.yaml.error import MarkedYAMLError, YAMLError

from predplan.control.kinds import MethodName
from predplan.control.tasks import find_task
from predplan.errors import InputError
from predplan.labelling.ablations import VARIATIONS
from predplan.labelling.corpora import OwnFiles, SplitSettings
from predplan.labelling.readers import Style
from predplan.labelling.supervised import BaselineSettings
from predplan.labelling.training import TrainingSettings
from predplan.planning.kinds import SuiteKind

ItemName = Annotated[str, StringConstraints(pattern=r"^[a-z0-9][a-z0-9_-]*$")]
"""The name of a corpus, suite or task: it becomes part of stage names and folders."""


def _known_task(name: str) -> str:
    try:
        find_task(name)
    except InputError as error:
        raise ValueError(str(error).removeprefix("task: ")) from error
    return name


TaskName = Annotated[str, AfterValidator(_known_task)]
SchedulerAddress = Annotated[str, StringConstraints(pattern=r"^(tcp|tls)://.+:\d+$")]


class Component(BaseModel):
    """Base of every model: frozen, strict, finite numbers, and unknown keys answered with the known ones."""

    model_config = ConfigDict(
        frozen=True, strict=True, extra="forbid", allow_inf_nan=False, use_attribute_docstrings=True
    )


class CorpusSettings(Component):
    """One corpus of the labelling branch."""

    source: Literal["brown", "turkish", "twitter", "malagasy", "files"]
    """A declared source of corpora, or files of one's own."""

    style: Style = "spaces"
    """How raw lines become tokens: at white space, or as tweets."""

    split: SplitSettings | None = None
    """How brown and turkish are cut into labelled, dev, test and raw text."""

    files: OwnFiles | None = None
    """Paths of a corpus of one's own (source files)."""

    tagmap: str | None = None
    """File that maps the tags of one's own corpus to the universal ones; without it they stay as they are."""

    dictionary: bool = False
    """Whether the tag dictionary of malagasy is used."""

    languages: tuple[str, ...] = ()
    """Languages (ISO 639) whose raw lines are kept; empty keeps all."""

    sizes: tuple[Annotated[int, Field(ge=1)], ...]
    """Labelled sentences of the training sets of the tables."""

    curve: tuple[Annotated[int, Field(ge=1)], ...]
    """Labelled sentences of the training sets of the learning curves."""

    draws: Annotated[int, Field(ge=1)]
    """Training sets drawn of each size; of all labelled sentences there is only one."""


class LabellingSettings(Component):
    """The labelling branch."""

    corpora: dict[ItemName, CorpusSettings]
    """The corpora to run, by name."""

    seed: int = 0
    """Seed of everything random that is not the draw of a training set."""

    composite_iterations: Annotated[int, Field(ge=1)] = 10
    """Iterations of Algorithm 4."""

    iterations: Annotated[int, Field(ge=1)] = 8
    """Most models that EM and self-training of the HMM try, the supervised one included; dev chooses."""

    feature_iterations: Annotated[int, Field(ge=1)] = 3
    """The same for the feature HMM."""

    ablations: tuple[str, ...] = tuple(VARIATIONS)
    """Components of training whose knobs are turned one by one."""

    training: TrainingSettings = TrainingSettings()
    """Knobs of the anchor models."""

    baselines: BaselineSettings = BaselineSettings()
    """Knobs of the baselines."""


class SuiteSettings(Component):
    """One suite of the planning branch: problems on which all methods of its kind are compared."""

    kind: SuiteKind
    """Which problems, and which methods."""

    problems: Annotated[int, Field(ge=1)]
    """Problems the methods are compared on; tests need two at least."""

    tuning: Annotated[int, Field(ge=1)]
    """Other problems, on which each method's step is chosen."""

    iterations: Annotated[int, Field(ge=1)]
    """Iterations of every descent."""

    epsilon: Annotated[float, Field(gt=0)]
    """m: clearance at which obstacles begin to cost."""

    inverse_steps: Annotated[tuple[Annotated[float, Field(gt=0)], ...], Field(min_length=1)]
    """λ that are tried on the tuning problems; kernels are normalised."""

    steps_of: ItemName
    """The suite on whose tuning problems steps are chosen: this one, or another to see what tuning is worth."""

    timings: tuple[Annotated[int, Field(ge=2)], ...] = ()
    """Samples of a descent with which the time of an iteration is measured, besides the methods' own."""


class PlanningSettings(Component):
    """The planning branch."""

    suites: dict[ItemName, SuiteSettings] = {}
    """The suites to run, by name."""

    seed: int = 0
    """Seed of all random problems."""

    shrinkage: Annotated[float, Field(ge=0, lt=1)] = 0.025
    """β/λ: the share of the trajectory's bends that an iteration takes off."""

    repeats: Annotated[int, Field(ge=2)] = 20
    """Descents whose time is measured."""

    @field_validator("suites")
    @classmethod
    def _steps_of_known_suites(cls, suites: dict[str, SuiteSettings]) -> dict[str, SuiteSettings]:
        for name, suite in suites.items():
            if suite.steps_of not in suites:
                known = ", ".join(suites)
                raise ValueError(f"steps_of of {name} is {suite.steps_of!r}, expected one of {known}")
        return suites


class ConditionSettings(Component):
    """How badly a task is observed."""

    noise: Annotated[float, Field(ge=0)] = 0.0
    """Standard deviation of the noise on each position, in units of its spread while exploring."""

    drop: Annotated[float, Field(ge=0, lt=1)] = 0.0
    """Chance that an observation is lost."""


class TaskSettings(Component):
    """One task of the control branch, on which all methods are compared."""

    task: TaskName
    """cartpole, swimmer, hopper, walker2d, or the id of another of Gymnasium's MuJoCo tasks."""

    horizon: Annotated[int, Field(ge=1)] | None = None
    """Steps until an episode is cut off; without it the task's own."""

    steps: Annotated[int, Field(ge=1)]
    """Environment steps of a run, exploration included."""

    copies: Annotated[int, Field(ge=1)] = 16
    """Copies of the environment in a run, side by side."""

    length: Annotated[int, Field(ge=1)] = 64
    """Steps of each copy in a batch."""

    methods: Annotated[tuple[MethodName, ...], Field(min_length=1)]
    """Methods that run in every condition."""

    ablations: tuple[MethodName, ...] = ()
    """Methods that run in the first condition only."""

    conditions: Annotated[tuple[ConditionSettings, ...], Field(min_length=1)]
    """Noise and losses."""

    seeds: Annotated[int, Field(ge=1)]
    """Runs of each method in each condition; more of them later leave those that are done as they are."""

    explored: Annotated[int, Field(ge=2)] = 100
    """Exploring trajectories that filters and other predictors are learned from."""

    held_out: Annotated[int, Field(ge=1)] = 50
    """Further ones, on which they are compared."""

    explored_length: Annotated[int, Field(ge=1)] = 500
    """Steps of a trajectory at most."""

    least_length: Annotated[int, Field(ge=1)] = 12
    """Steps of a trajectory at least."""

    predictors: tuple[Literal["gru", "kernel", "refined", "corrected"], ...] = ("refined",)
    """What is compared besides regressions and the filter learned by regression; corrected needs refined."""


class ControlSettings(Component):
    """The control branch."""

    tasks: dict[ItemName, TaskSettings] = {}
    """The tasks to run, by name."""

    seed: int = 0
    """Seed of the exploration on which predictors are compared, and of the recorded episodes."""

    every: Annotated[int, Field(ge=1)] = 20
    """Updates after which a run is put away, to go on from when it is interrupted."""

    episodes: Annotated[int, Field(ge=1)] = 32
    """Episodes that a learned policy is evaluated on."""


class Settings(Component):
    """The whole of params.yaml."""

    root: str
    """Folder in which the stages run, relative to the params file."""

    params: str
    """This file, relative to root: what the stages are given."""

    out: str
    """Folder under which the stages write, relative to root."""

    workers: Annotated[int, Field(ge=1)]
    """Processes for work of many independent pieces."""

    scheduler: SchedulerAddress | None = None
    """Address of a Dask scheduler whose workers take the place of processes."""

    reports: str
    """Folder of the report, relative to root."""

    labelling: LabellingSettings
    """The labelling branch."""

    planning: PlanningSettings = PlanningSettings()
    """The planning branch."""

    control: ControlSettings = ControlSettings()
    """The control branch."""


def load_settings(path: Path) -> Settings:
    """The settings in a params file.

    Raises InputError for a file that is missing or not YAML, and one that lists every fault of the settings: its
    dotted key, what was found and what is allowed.
    """
    # Arrays may stand for tuples and whole numbers for floats in strict JSON, as a writer of YAML expects.
    text = json.dumps(_read_yaml(path), default=str)
    try:
        return Settings.model_validate_json(text)
    except ValidationError as error:
        faults = [fault for details in error.errors() for fault in _faults(details)]
        listed = faults[0] if len(faults) == 1 else "".join(f"\n  {fault}" for fault in faults)
        raise InputError(f"{path}: {listed}") from error


def _read_yaml(path: Path) -> Any:
    """Read with DVC's own parser, so that both see the same values (1e-3 is a number, `no` a string)."""
    try:
        return YAML(typ="safe", pure=True).load(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror}") from error
    except UnicodeDecodeError as error:
        raise InputError(f"{path}: not UTF-8 at byte {error.start}; expected YAML") from error
    except MarkedYAMLError as error:
        line = f", line {error.problem_mark.line + 1}" if error.problem_mark else ""
        raise InputError(f"{path}{line}: {error.problem}") from error
    except YAMLError as error:
        raise InputError(f"{path}: not YAML: {error}") from error


def _faults(details: ErrorDetails) -> list[str]:
    """One line a fault."""
    place = details["loc"]
    if details["type"] in ("extra_forbidden", "unexpected_keyword_argument"):
        known = _known_keys(place[:-1])
        return [f"{_dotted(*place)}: unknown key;{_nearest(str(place[-1]), known)} allowed: {', '.join(known)}"]
    if details["type"] == "value_error":
        return [f"{_dotted(*place)}: {details['ctx']['error']}"]
    if details["type"] == "missing":
        return [f"{_dotted(*place)}: missing"]
    allowed = (
        details["msg"].removeprefix("Input should ").removeprefix("String should ").replace("an object", "a mapping")
    )
    return [f"{_dotted(*place)}: found {_shown(details['input'])}, must {allowed}"]


def _dotted(*place: int | str) -> str:
    return ".".join(str(part) for part in place if part != "[key]") or "the whole file"


def _known_keys(place: tuple[int | str, ...]) -> list[str]:
    """The keys allowed at a place, found by walking the models' annotations."""
    kind: Any = Settings
    for part in place:
        annotation = get_type_hints(kind)[str(part)] if isinstance(kind, type) else get_args(kind)[-1]
        kind = next((option for option in get_args(annotation) if is_dataclass(option)), annotation)
    return list(get_type_hints(kind))


def _nearest(key: str, known: list[str]) -> str:
    near = difflib.get_close_matches(key, known, n=1)
    return f" did you mean {near[0]!r}?" if near else ""


def _shown(value: Any) -> str:
    if isinstance(value, dict | list):
        return "a mapping" if isinstance(value, dict) else "a list"
    return json.dumps(value, ensure_ascii=False)
