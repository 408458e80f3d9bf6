"""What every stage does first and last: read its settings, find its item's folder, and say clearly what went wrong."""

from __future__ import annotations

import argparse
import os
import sys
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar, TypeVar

from pydantic import TypeAdapter

from predplan.artifacts.provenance import Provenance, hash_file
from predplan.errors import InputError, PredplanError
from stages.settings import Component, CorpusSettings, Settings, SuiteSettings, TaskSettings, load_settings


@dataclass(frozen=True)
class ItemStage(ABC):
    """One run of a stage on one item of a branch: the settings, and where the item's artifacts lie."""

    branch: ClassVar[str]
    kind: ClassVar[str]

    name: str
    settings: Settings

    @staticmethod
    @abstractmethod
    def items(settings: Settings) -> Mapping[str, Component]:
        """All items of the branch, by name."""

    @property
    @abstractmethod
    def seed(self) -> int:
        """The branch's."""

    def folder(self, item: str = "") -> Path:
        """Where the artifacts of this item, or of another, lie."""
        return Path(self.settings.out) / self.branch / (item or self.name)

    def path(self, artifact: str) -> Path:
        """Where an artifact of this item lies."""
        return self.folder() / artifact

    def result(self, name: str) -> Path:
        """Where a result of this item lies, in the folder that holds all that the report tells."""
        return Path(self.settings.out) / "results" / self.branch / self.name / name

    def provenance(self, *inputs: Path, **params: Any) -> Provenance:
        """Provenance of an artifact made from `inputs` with the settings `params`."""
        return Provenance(
            params={self.kind: self.name, **{key: plain(value) for key, value in params.items()}},
            seed=self.seed,
            upstream={path.name: hash_file(path) for path in inputs},
        )


@dataclass(frozen=True)
class CorpusStage(ItemStage):
    """A corpus of the labelling branch."""

    branch, kind = "labelling", "corpus"

    @staticmethod
    def items(settings: Settings) -> Mapping[str, CorpusSettings]:
        """Under labelling.corpora."""
        return settings.labelling.corpora

    @property
    def seed(self) -> int:
        """The branch's."""
        return self.settings.labelling.seed

    @property
    def corpus(self) -> CorpusSettings:
        """The corpus's own settings."""
        return self.settings.labelling.corpora[self.name]


@dataclass(frozen=True)
class SuiteStage(ItemStage):
    """A suite of the planning branch."""

    branch, kind = "planning", "suite"

    @staticmethod
    def items(settings: Settings) -> Mapping[str, SuiteSettings]:
        """Under planning.suites."""
        return settings.planning.suites

    @property
    def seed(self) -> int:
        """The branch's."""
        return self.settings.planning.seed

    @property
    def suite(self) -> SuiteSettings:
        """The suite's own settings."""
        return self.settings.planning.suites[self.name]


@dataclass(frozen=True)
class TaskStage(ItemStage):
    """A task of the control branch."""

    branch, kind = "control", "task"

    @staticmethod
    def items(settings: Settings) -> Mapping[str, TaskSettings]:
        """Under control.tasks."""
        return settings.control.tasks

    @property
    def seed(self) -> int:
        """The branch's."""
        return self.settings.control.seed

    @property
    def task(self) -> TaskSettings:
        """The task's own settings."""
        return self.settings.control.tasks[self.name]


Stage = TypeVar("Stage", bound=ItemStage)


def plain(value: Any) -> Any:
    """Settings as plain data, fit for JSON."""
    return TypeAdapter(type(value)).dump_python(value, mode="json")


def mirror_folder() -> Path | None:
    """PREDPLAN_MIRROR, or ../shared/data beside the project where that exists."""
    named = os.environ.get("PREDPLAN_MIRROR")
    folder = Path(named) if named else Path(__file__).resolve().parents[2] / "shared" / "data"
    return folder if named or folder.is_dir() else None


def run_stage(kind: type[Stage], work: Callable[[Stage], None]) -> None:
    """Entry point of a stage: `python -m stages.BRANCH.STAGE PARAMS ITEM`; exit codes as the command line's."""
    parser = argparse.ArgumentParser(description=sys.modules[work.__module__].__doc__)
    parser.add_argument("params", type=Path, help="params.yaml, relative to the folder the stages run in")
    parser.add_argument(kind.kind, help=f"name of a {kind.kind} in params.yaml")
    arguments = parser.parse_args()
    stage, item = Path(sys.argv[0]).stem, getattr(arguments, kind.kind)
    try:
        settings = load_settings(arguments.params)
        known = kind.items(settings)
        if item not in known:
            raise InputError(
                f"{arguments.params}: {kind.branch} has no {kind.kind} {item!r}; expected {', '.join(known)}"
            )
        work(kind(item, settings))
    except PredplanError as error:
        sys.stderr.write(f"stage {stage}@{item} failed: {error}\n")
        sys.exit(2 if isinstance(error, InputError) else 1)
