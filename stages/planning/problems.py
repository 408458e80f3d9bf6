"""Draw a suite's problems: those that steps are chosen on, and those that methods are compared on."""

from __future__ import annotations

import numpy as np

from predplan.planning.kinds import KINDS, SuiteKind
from predplan.planning.problems import Problem, maze_problems, planar_problems
from predplan.planning.tables import TEST, TUNING, write_problems
from stages.common import SuiteStage, run_stage


def main(stage: SuiteStage) -> None:
    suite, seed = stage.suite, stage.settings.planning.seed
    # The kind, not the name, seeds the numbers: two suites of a kind have the same problems.
    streams = np.random.SeedSequence([seed, KINDS.index(suite.kind)]).spawn(2)
    tuning, test = (np.random.default_rng(stream) for stream in streams)
    parts = dict(zip((TUNING, TEST), draw(suite.kind, (suite.tuning, suite.problems), (tuning, test)), strict=True))
    write_problems(stage.folder(), parts, stage.provenance(settings=suite))


def draw(kind: SuiteKind, counts: tuple[int, ...], generators: tuple[np.random.Generator, ...]) -> list[list[Problem]]:
    """As many problems of a kind as each count says, each list from its own generator."""
    both = list(zip(counts, generators, strict=True))
    if kind == "maze":
        return [maze_problems(count, generator) for count, generator in both]
    if kind == "planar":
        return [planar_problems(count, generator) for count, generator in both]
    # MuJoCo is needed for the kitchen only.
    from predplan.planning.kitchen_files import read_kitchen
    from predplan.planning.kitchens import kitchen_cluttered, kitchen_constrained, kitchen_simple

    kitchen = read_kitchen()
    make = {
        "kitchen-simple": kitchen_simple,
        "kitchen-cluttered": kitchen_cluttered,
        "kitchen-constrained": kitchen_constrained,
    }[kind]
    return [make(kitchen, count, generator) for count, generator in both]


if __name__ == "__main__":
    run_stage(SuiteStage, main)
