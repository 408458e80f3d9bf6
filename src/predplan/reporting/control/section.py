"""The report on control, put together."""

from __future__ import annotations

from collections.abc import Sequence

from predplan.reporting.control import claims, figures, tables
from predplan.reporting.control.departures import DEPARTURES, LIMITATIONS
from predplan.reporting.control.labels import MAIN, PARTS, groups, task_title
from predplan.reporting.control.results import ControlResults
from predplan.reporting.document import Block, Items, Section, Table, Text

WHAT = (
    "A policy that sees positions alone must remember. A recurrent predictive-state policy (RPSP) remembers what it "
    "expects to observe: its state is a prediction of the observations to come, learned from exploration by two-stage "
    "regression, updated by a filter at every step, and refitted on the policy’s own steps. Here are chapter 5’s "
    "experiments, made again with baselines that have the same update, the same whitening and the same steps: finite "
    "memories and GRUs."
)
HOW = (
    "A run is one seed; its exploration counts as steps. Methods are compared by mean return over training, not at the "
    "end, so that learning faster counts. Runs that diverged are counted in and named."
)
NOTHING = "No task was run: params.yaml names none under control.tasks."


def control_section(results: ControlResults, speeds: Sequence[Table] = ()) -> Section:
    """The whole report on control; speeds: what was measured apart from the runs."""
    differs = Section("What differs from the thesis, and why", (Items(DEPARTURES),))
    limits = Section("Limitations", (Items((*few_runs(results), *LIMITATIONS)),))
    if not results.runs:
        return Section("Control", (Text(WHAT), Text(NOTHING)), (*prediction_sections(results), differs, limits))
    blocks: list[Block] = [Text(WHAT), tables.mean_table(results), Text(claims.against_the_best(results)), Text(HOW)]
    blocks += [table for table in (tables.pooled_table(results), tables.threshold_table(results)) if table is not None]
    sections = (
        *verdict_sections(results),
        *curve_sections(results),
        *degradation_sections(results),
        *part_sections(results),
        *prediction_sections(results),
        Section("Cost and reliability", (tables.cost_table(results), *speeds)),
        differs,
        limits,
    )
    return Section("Control", tuple(blocks), sections)


def verdict_sections(results: ControlResults) -> tuple[Section, ...]:
    """The thesis's claims, and every test."""
    judged = claims.verdicts(results)
    if not judged:
        return ()
    every = Section("Every test", (tables.tests_table(results),), folded=True)
    return (Section("Which claims hold", (Items(judged),), (every,)),)


def curve_sections(results: ControlResults) -> tuple[Section, ...]:
    """Learning curves: the main methods on tasks observed exactly, then every other condition and group of methods."""
    exact = [c for c in results.conditions if c[1:] == (0.0, 0.0)]
    degraded = [c for c in results.conditions if c not in exact]
    found = groups(results.methods)
    sections = []
    for name, what, methods in found:
        drawn = [
            figures.learning_figure(results, conditions, methods, f"{name}{suffix}", f"{what}{words}")
            for conditions, suffix, words in (
                (exact, "", ""),
                *(
                    ([c for c in degraded if c[0] == task], f"-{task}", f": {task_title(task)} with noise or losses")
                    for task in _tasks(degraded)
                ),
            )
        ]
        shown = [figure for figure in drawn if figure is not None]
        if not shown:
            continue
        first, more = shown[:1], shown[1:]
        folded = Section("Noise and losses", tuple(more), folded=True)
        inner = (folded,) if more else ()
        sections.append(Section(_heading(name), tuple(first), inner, folded=name in ("sizes", "windows", "others")))
    return tuple(sections)


def degradation_sections(results: ControlResults) -> tuple[Section, ...]:
    """Noise and losses against mean return over training."""
    methods = [name for name in results.methods if name in MAIN]
    found = [figures.degradation_figure(results, methods, drop) for drop in (False, True)]
    drawn = tuple(figure for figure in found if figure is not None)
    return (Section("Observation noise and lost observations", drawn),) if drawn else ()


def part_sections(results: ControlResults) -> tuple[Section, ...]:
    """What parts of the method are worth, and forms of it."""
    parts = [name for name in results.methods if name in PARTS]
    others = [name for name in results.methods if name not in MAIN and name not in PARTS]
    found: list[Block] = []
    if len(parts) > 1:
        found.append(tables.variants_table(results, parts, "What parts of the method are worth"))
    if others:
        found.append(tables.variants_table(results, [*parts[:1], *others], "Other forms and updates"))
    return (Section("Ablations", tuple(found)),) if found else ()


def prediction_sections(results: ControlResults) -> tuple[Section, ...]:
    """Errors of prediction on held-out exploration."""
    ahead = sorted({k for own in results.errors.values() for errors in own.values() for k in errors})
    if not ahead:
        return ()
    figure = figures.prediction_figure(results)
    found = tuple(tables.prediction_table(results, k) for k in ahead)
    further = Section("Several steps ahead", (*((figure,) if figure else ()), *found[1:]), folded=True)
    told = claims.foretold(results)
    blocks = (*((Text(told),) if told else ()), *found[:1])
    return (Section("How well observations are foretold", blocks, (further,) if found[1:] else ()),)


def few_runs(results: ControlResults) -> tuple[tuple[str, str], ...]:
    """What so few runs can tell."""
    least = results.seeds()[0]
    if least < 2:
        return (
            ("One run.", "A single run of a method says nothing of how far its runs lie apart, and is in no test."),
        )
    from_pairs = f"the paired permutation test cannot give less than p = {2 / 2**least:.2g}"
    return (
        (
            "Few runs.",
            f"With {least} runs of a method only large differences are found, and {from_pairs}. “No difference” says "
            "that none was found, not that there is none.",
        ),
    )


def _tasks(conditions: list[tuple[str, float, float]]) -> list[str]:
    return list(dict.fromkeys(condition[0] for condition in conditions))


def _heading(name: str) -> str:
    return {
        "learning": "Learning curves",
        "parts": "Parts of the method",
        "forms": "Forms and updates",
        "latent": "Predictive and latent states",
        "sizes": "Sizes of a GRU",
        "windows": "Lengths of a finite memory",
        "others": "Other methods",
    }[name]
