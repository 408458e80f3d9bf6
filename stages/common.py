"""What every stage does first and last: read its settings, find its item's folder, and say clearly what went wrong."""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pydantic import TypeAdapter

from predplan.artifacts.provenance import Provenance, hash_file
from predplan.errors import InputError, PredplanError
from stages.settings import CorpusSettings, Settings, SuiteSettings, TaskSettings, load_settings


@dataclass(frozen=True)
class CorpusStage:
    """One run of a stage of the labelling branch: the settings, the corpus's own, and where its artifacts lie."""

    name: str
    settings: Settings
    corpus: CorpusSettings
    folder: Path

    def path(self, artifact: str) -> Path:
        """Where an artifact of this corpus lies."""
        return self.folder / artifact

    def result(self, name: str) -> Path:
        """Where a result of this corpus lies, in the folder that holds all that the report tells."""
        return Path(self.settings.out) / "results" / "labelling" / self.name / name

    def provenance(self, *inputs: Path, **params: Any) -> Provenance:
        """Provenance of an artifact made from `inputs` with the settings `params`."""
        return Provenance(
            params={"corpus": self.name, **{key: plain(value) for key, value in params.items()}},
            seed=self.settings.labelling.seed,
            upstream={path.name: hash_file(path) for path in inputs},
        )


@dataclass(frozen=True)
class SuiteStage:
    """One run of a stage of the planning branch: the settings, the suite's own, and where its artifacts lie."""

    name: str
    settings: Settings
    suite: SuiteSettings

    def folder(self, suite: str = "") -> Path:
        """Where the artifacts of this suite, or of another, lie."""
        return Path(self.settings.out) / "planning" / (suite or self.name)

    def path(self, artifact: str) -> Path:
        """Where an artifact of this suite lies."""
        return self.folder() / artifact

    def result(self, name: str) -> Path:
        """Where a result of this suite lies, in the folder that holds all that the report tells."""
        return Path(self.settings.out) / "results" / "planning" / self.name / name

    def provenance(self, *inputs: Path, **params: Any) -> Provenance:
        """Provenance of an artifact made from `inputs` with the settings `params`."""
        return Provenance(
            params={"suite": self.name, **{key: plain(value) for key, value in params.items()}},
            seed=self.settings.planning.seed,
            upstream={path.name: hash_file(path) for path in inputs},
        )


@dataclass(frozen=True)
class TaskStage:
    """One run of a stage of the control branch: the settings, the task's own, and where its artifacts lie."""

    name: str
    settings: Settings
    task: TaskSettings

    def path(self, artifact: str) -> Path:
        """Where an artifact of this task lies."""
        return Path(self.settings.out) / "control" / self.name / artifact

    def result(self, name: str) -> Path:
        """Where a result of this task lies, in the folder that holds all that the report tells."""
        return Path(self.settings.out) / "results" / "control" / self.name / name

    def provenance(self, *inputs: Path, **params: Any) -> Provenance:
        """Provenance of an artifact made from `inputs` with the settings `params`."""
        return Provenance(
            params={"item": self.name, **{key: plain(value) for key, value in params.items()}},
            seed=self.settings.control.seed,
            upstream={path.name: hash_file(path) for path in inputs},
        )


def plain(value: Any) -> Any:
    """Settings as plain data, fit for JSON."""
    return TypeAdapter(type(value)).dump_python(value, mode="json")


def mirror_folder() -> Path | None:
    """PREDPLAN_MIRROR, or ../shared/data beside the project where that exists."""
    named = os.environ.get("PREDPLAN_MIRROR")
    folder = Path(named) if named else Path(__file__).resolve().parents[2] / "shared" / "data"
    return folder if named or folder.is_dir() else None


def run_corpus_stage(work: Callable[[CorpusStage], None]) -> None:
    """Entry point of a stage: `python -m stages.labelling.STAGE PARAMS CORPUS`; exit codes as the command line's."""
    parser = argparse.ArgumentParser(description=sys.modules[work.__module__].__doc__)
    parser.add_argument("params", type=Path, help="params.yaml, relative to the folder the stages run in")
    parser.add_argument("corpus", help="name of a corpus under labelling.corpora")
    arguments = parser.parse_args()
    stage = Path(sys.argv[0]).stem
    try:
        settings = load_settings(arguments.params)
        corpora: Mapping[str, CorpusSettings] = settings.labelling.corpora
        if arguments.corpus not in corpora:
            known = ", ".join(corpora)
            raise InputError(f"{arguments.params}: labelling.corpora has no {arguments.corpus!r}; expected {known}")
        folder = Path(settings.out) / "labelling" / arguments.corpus
        work(CorpusStage(arguments.corpus, settings, corpora[arguments.corpus], folder))
    except PredplanError as error:
        sys.stderr.write(f"stage {stage}@{arguments.corpus} failed: {error}\n")
        sys.exit(2 if isinstance(error, InputError) else 1)


def run_suite_stage(work: Callable[[SuiteStage], None]) -> None:
    """Entry point of a stage: `python -m stages.planning.STAGE PARAMS SUITE`; exit codes as the command line's."""
    parser = argparse.ArgumentParser(description=sys.modules[work.__module__].__doc__)
    parser.add_argument("params", type=Path, help="params.yaml, relative to the folder the stages run in")
    parser.add_argument("suite", help="name of a suite under planning.suites")
    arguments = parser.parse_args()
    stage = Path(sys.argv[0]).stem
    try:
        settings = load_settings(arguments.params)
        suites: Mapping[str, SuiteSettings] = settings.planning.suites
        known = ", ".join(suites)
        if arguments.suite not in suites:
            raise InputError(f"{arguments.params}: planning.suites has no {arguments.suite!r}; expected {known}")
        steps_of = suites[arguments.suite].steps_of
        if steps_of not in suites:
            place = f"planning.suites.{arguments.suite}.steps_of"
            raise InputError(f"{arguments.params}: {place} is {steps_of!r}; expected one of {known}")
        work(SuiteStage(arguments.suite, settings, suites[arguments.suite]))
    except PredplanError as error:
        sys.stderr.write(f"stage {stage}@{arguments.suite} failed: {error}\n")
        sys.exit(2 if isinstance(error, InputError) else 1)


def run_task_stage(work: Callable[[TaskStage], None]) -> None:
    """Entry point of a stage: `python -m stages.control.STAGE PARAMS TASK`; exit codes as the command line's."""
    parser = argparse.ArgumentParser(description=sys.modules[work.__module__].__doc__)
    parser.add_argument("params", type=Path, help="params.yaml, relative to the folder the stages run in")
    parser.add_argument("task", help="name of a task under control.tasks")
    arguments = parser.parse_args()
    stage = Path(sys.argv[0]).stem
    try:
        settings = load_settings(arguments.params)
        tasks: Mapping[str, TaskSettings] = settings.control.tasks
        if arguments.task not in tasks:
            known = ", ".join(tasks)
            raise InputError(f"{arguments.params}: control.tasks has no {arguments.task!r}; expected {known}")
        work(TaskStage(arguments.task, settings, tasks[arguments.task]))
    except PredplanError as error:
        sys.stderr.write(f"stage {stage}@{arguments.task} failed: {error}\n")
        sys.exit(2 if isinstance(error, InputError) else 1)
