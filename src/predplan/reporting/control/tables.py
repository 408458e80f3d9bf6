"""Tables of the report on control."""

from __future__ import annotations

from collections.abc import Sequence

from predplan.control.comparing import LEVEL, OWN, Ratio, holm, is_baseline, pooled_ratio
from predplan.control.curves import Condition, condition_of
from predplan.control.tables import Row
from predplan.reporting.control.labels import AT, MAIN, label_of, observed, predictor_label, task_title, titled
from predplan.reporting.control.results import ControlResults
from predplan.reporting.document import Cell, Table

WITHOUT = "-"


def mean_table(results: ControlResults) -> Table:
    """The table that the thesis refers to and lacks: mean return over training, and the test against the best."""
    methods = [name for name in results.methods if name in MAIN or (is_baseline(name) and _often(results, name))]
    rows: list[tuple[str | Cell, ...]] = []
    before = ""
    for condition in results.conditions:
        if condition[0] != before:
            before = condition[0]
            rows.append((task_title(before),))
        rows.append((observed(condition), *_means(results, condition, methods), _against_best(results, condition)))
    rows += _shares(results, methods)
    return Table(
        ("Observed", *(label_of(name) for name in methods), f"{label_of(OWN)} against the best baseline"),
        tuple(rows),
        "Mean return over training. Area under return against steps, exploration included, over steps: means over "
        f"runs and their standard errors. {_runs(results)} σ is in units of each position’s spread while exploring. "
        "The highest mean of each row stands out. The best baseline is that with the highest mean, chosen afterwards, "
        "which is in its favour. Tests: Welch’s t, two-sided, with Holm’s correction for all baselines of the row.",
    )


def pooled_table(results: ControlResults) -> Table | None:
    """Ratios of our method's returns to each main baseline's, conditions taken together; None where none can be."""
    baselines = [name for name in results.methods if name in MAIN and is_baseline(name)]
    worse = [c for c in results.conditions if c[1:] != (0.0, 0.0)]
    exact = [c for c in results.conditions if c not in worse]
    tasks = list(dict.fromkeys(c[0] for c in worse))
    groups = [(f"{task_title(task)}, noise or losses", [c for c in worse if c[0] == task]) for task in tasks]
    groups += [("All tasks, noise or losses", worse), ("All tasks, exact positions", exact)]
    rows: list[tuple[str | Cell, ...]] = []
    for name, conditions in groups:
        found = [_ratio(results, conditions, other) for other in baselines]
        if not any(found):
            continue
        corrected = holm([one.p if one else None for one in found])
        cells = [_ratio_cell(one, p) for one, p in zip(found, corrected, strict=True)]
        rows.append((name, str(len(conditions)), *cells))
    if not rows:
        return None
    return Table(
        ("Observed", "Conditions", *(f"{label_of(OWN)} to {label_of(name)}" for name in baselines)),
        tuple(rows),
        f"Conditions together. Mean return over training of {label_of(OWN)} over that of each baseline: geometric "
        "means over conditions, with 95 % intervals. ▲ above, ▼ below 1 by Welch’s t-test on logarithms, summed over "
        "conditions, with Holm’s correction for the row, p < .05. Conditions were put together after they had been "
        "looked at one by one, where few runs tell little.",
    )


def variants_table(results: ControlResults, methods: Sequence[str], caption: str) -> Table:
    """Mean return over training of some methods, a row a method, a column a condition in which two of them ran."""
    conditions = [
        condition
        for condition in results.conditions
        if sum(results.summary(condition, name) is not None for name in methods) > 1
    ]
    rows: list[tuple[str | Cell, ...]] = []
    for name in methods:
        cells: list[str | Cell] = [label_of(name)]
        for condition in conditions:
            [cell] = _means(results, condition, [name])
            test = results.compared(condition, name, OWN) if name != OWN else None
            sign = {"better": " ▲", "worse": " ▼"}.get(test["verdict"], "") if test else ""
            cells.append(cell if isinstance(cell, str) else Cell(cell.value + sign, cell.spread))
        rows.append(tuple(cells))
    return Table(
        ("Method", *(titled(condition) for condition in conditions)),
        tuple(rows),
        f"{caption}. Mean return over training and its standard error over runs. ▲ better, ▼ worse than "
        f"{label_of(OWN)} by Welch’s t-test with Holm’s correction, p < .05; without a sign there is no difference to "
        "be told, or too few runs.",
    )


def threshold_table(results: ControlResults) -> Table | None:
    """Steps until a task counts as solved; None where no run ever was."""
    conditions = [
        condition
        for condition in results.conditions
        if any(row["reached"] for name in results.methods if (row := results.summary(condition, name)))
    ]
    if not conditions:
        return None
    rows: list[tuple[str | Cell, ...]] = []
    for name in results.methods:
        cells: list[str | Cell] = [label_of(name)]
        for condition in conditions:
            row = results.summary(condition, name)
            if row is None:
                cells.append(WITHOUT)
                continue
            median = row["steps_to_threshold"]
            cells.append(Cell(_thousands(median) if median else "not by half", f"{row['reached']} of {row['seeds']}"))
        if any(cell != WITHOUT for cell in cells[1:]):
            rows.append(tuple(cells))
    return Table(
        ("Method", *(titled(condition) for condition in conditions)),
        tuple(rows),
        "Steps until a task is solved. Environment steps, exploration included, until the mean return of the last five "
        "batches passed the threshold (CartPole: 195 of 200). Medians over runs, those that never did counting as "
        "last, and how many passed.",
    )


def tests_table(results: ControlResults) -> Table:
    """Every test that was made."""
    rows: list[tuple[str, ...]] = []
    before: Condition | None = None
    for row in sorted(results.comparisons, key=lambda row: results.conditions.index(condition_of(row))):
        condition = condition_of(row)
        if condition != before:
            before = condition
            rows.append((titled(condition),))
        rows.append(
            (
                f"{label_of(row['method'])} / {label_of(row['other'])}",
                "mean" if row["measure"] == "mean_return" else row["measure"].replace("_", " "),
                f"{row['seeds']} / {row['other_seeds']}",
                f"{row['difference']:+.3g}" + ("" if row["t"] is None else f" ± {row['standard_error']:.2g}"),
                _p(row["welch_p"]),
                _p(row["holm_p"]),
                _p(row["permutation_p"]),
                row["verdict"],
            )
        )
    return Table(
        ("Method / other", "Return", "Runs", "Difference", "Welch p", "Holm p", "Permutation p", "Verdict"),
        tuple(rows),
        "Every test. Differences of mean return over training, with standard errors. Welch’s t-test takes runs as two "
        "samples; Holm’s correction is for all that the method is held against there; the permutation test takes runs "
        "of one seed as pairs, is exact, and cannot give less than 2 / 2ⁿ for n pairs. Verdicts are by Holm’s p < .05.",
    )


def prediction_table(results: ControlResults, ahead: int) -> Table:
    """Errors so many steps ahead: a row a condition, a column a predictor."""
    conditions = [c for c, own in results.errors.items() if any(ahead in errors for errors in own.values())]
    names = list(dict.fromkeys(name for c in conditions for name, own in results.errors[c].items() if ahead in own))
    rows: list[tuple[str | Cell, ...]] = []
    before = ""
    for condition in conditions:
        if condition[0] != before:
            before = condition[0]
            rows.append((task_title(before),))
        found = {name: own[ahead] for name, own in results.errors[condition].items() if ahead in own}
        least = min(mean for mean, _, _ in found.values())
        cells: list[str | Cell] = [observed(condition)]
        for name in names:
            if name not in found:
                cells.append(WITHOUT)
            else:
                mean, error, seeds = found[name]
                spread = f"± {error:.1g}" if seeds > 1 else ""
                cells.append(Cell(f"{mean:.3g}", spread, best=mean == least))
        rows.append(tuple(cells))
    counts = {own[ahead][2] for c in conditions for own in results.errors[c].values() if ahead in own}
    fewer = (
        " Orders that need longer pasts have fewer rows; the last columns are on these."
        if any(AT in n for n in names)
        else ""
    )
    steps = "One step" if ahead == 1 else f"{ahead} steps"
    return Table(
        ("Observed", *(predictor_label(name) for name in names)),
        tuple(rows),
        f"{steps} ahead. On exploration that nothing was learned from: mean square difference to what a perfect "
        "sensor would have seen, each coordinate over its variance (1 is the error of the mean), "
        f"{_seeds(min(counts), max(counts))}. The least of each row stands out.{fewer}",
    )


def cost_table(results: ControlResults) -> Table:
    """What a run costs, and whether it ended as it should."""
    skipped: dict[str, int] = {}
    for row in results.learning:
        skipped[row["method"]] = skipped.get(row["method"], 0) + row["skipped"]
    rows: list[tuple[str | Cell, ...]] = []
    for name in results.methods:
        own = [run for run in results.runs if run["method"] == name]
        seconds, steps = (sum(run[column] for run in own) for column in ("cpu_s", "steps"))
        rows.append(
            (
                label_of(name),
                f"{len(own)}",
                f"{sum(run['reason'].startswith('diverged') for run in own)}",
                f"{skipped.get(name, 0):,}",
                f"{seconds / len(own):,.0f}",
                f"{steps / seconds:,.0f}" if seconds else WITHOUT,
            )
        )
    return Table(
        ("Method", "Runs", "Diverged", "Steps skipped", "CPU s a run", "Steps a CPU s"),
        tuple(rows),
        "Cost and reliability. All tasks and conditions together. Steps skipped: of the filter or of gradients, since "
        "their numbers were not finite. Steps a CPU second: environment steps of the whole training loop, on a machine "
        "that did other work too.",
    )


def _often(results: ControlResults, method: str) -> bool:
    """Whether a method ran in more than one condition."""
    return sum(results.summary(condition, method) is not None for condition in results.conditions) > 1


def _means(results: ControlResults, condition: Condition, methods: Sequence[str]) -> list[str | Cell]:
    found = [results.summary(condition, name) for name in methods]
    best = max((row["mean_return"] for row in found if row), default=None)
    several = sum(row is not None for row in found) > 1
    return [
        WITHOUT
        if row is None
        else Cell(
            _number(row["mean_return"]),
            _spread(row),
            best=several and row["mean_return"] == best,
        )
        for row in found
    ]


def _spread(row: Row) -> str:
    runs = "1 run" if row["standard_error"] is None else f"± {row['standard_error']:.2g}"
    return runs + (f", {row['diverged']} diverged" if row["diverged"] else "")


def _ratio(results: ControlResults, conditions: Sequence[Condition], other: str) -> Ratio | None:
    """Over the conditions; None where one lacks runs or has a return that is not above 0."""
    own, others = ([results.returns(condition, name) for condition in conditions] for name in (OWN, other))
    try:
        return pooled_ratio(list(zip(own, others, strict=True))) if conditions else None
    except ValueError:
        return None


def _ratio_cell(found: Ratio | None, p: float | None) -> str | Cell:
    if found is None or p is None:
        return WITHOUT
    sign = "" if p >= LEVEL else " ▲" if found.ratio > 1.0 else " ▼"
    return Cell(f"{found.ratio:.2f}{sign}", f"{found.low:.2f}–{found.high:.2f}")


def _against_best(results: ControlResults, condition: Condition) -> str | Cell:
    best = results.best_baseline(condition)
    if best is None or results.summary(condition, OWN) is None:
        return WITHOUT
    test = results.compared(condition, OWN, best)
    if test is None:
        return Cell("not tested", label_of(best))
    p = test["holm_p"]
    relation = "" if p is None else f", p {_p(p)}" if p < 0.001 else f", p = {_p(p)}"
    return Cell(test["verdict"], label_of(best) + relation)


def _shares(results: ControlResults, methods: Sequence[str]) -> list[tuple[str | Cell, ...]]:
    """Over tasks observed alike: the mean of each method's share of the best method's mean, as in §5.9."""
    rows: list[tuple[str | Cell, ...]] = []
    for seen in dict.fromkeys((condition[1], condition[2]) for condition in results.conditions):
        own = [condition for condition in results.conditions if condition[1:] == seen]
        best = {
            c: max((row["mean_return"] for name in methods if (row := results.summary(c, name))), default=0.0)
            for c in own
        }
        if len(own) < 2 or min(best.values()) <= 0.0:
            continue
        cells: list[str | Cell] = [f"{observed(own[0])}, {len(own)} tasks"]
        for name in methods:
            found = [results.summary(c, name) for c in own]
            shares = [row["mean_return"] / best[c] for row, c in zip(found, own, strict=True) if row]
            cells.append(f"{sum(shares) / len(shares):.2f}" if len(shares) == len(own) else WITHOUT)
        rows.append((*cells, WITHOUT))
    return [("Share of the best method’s mean, mean over tasks (§5.9)",), *rows] if rows else []


def _runs(results: ControlResults) -> str:
    low, high = results.seeds()
    if high == 1:
        return "One run of each."
    fixed = " Tests take the number of runs as fixed beforehand." if low < high else ""
    return f"{_range(low, high)} runs of each method and condition.{fixed}"


def _range(low: int, high: int) -> str:
    return f"{low}" if low == high else f"{low} to {high}"


def _seeds(low: int, high: int) -> str:
    return f"means over {_range(low, high)} seeds and standard errors" if high > 1 else "one seed"


def _number(value: float) -> str:
    return f"{value:.0f}" if abs(value) >= 1000 else f"{value:.3g}"


def _thousands(steps: float) -> str:
    return f"{steps / 1000:.3g}k"


def _p(p: float | None) -> str:
    if p is None:
        return WITHOUT
    return "< .001" if p < 0.001 else f"{p:.3f}".removeprefix("0")
