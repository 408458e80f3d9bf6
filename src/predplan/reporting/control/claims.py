"""What chapter 5 claims, and what the tests here say of it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from predplan.control.comparing import BETTER, EQUAL, OWN, TOO_FEW, WORSE, is_baseline
from predplan.control.curves import Condition
from predplan.reporting.control.labels import AT, label_of, predictor_label, titled
from predplan.reporting.control.results import ControlResults

FILTER = "innovation"
"""What the names of predictors by a predictive state begin with."""
MUCH = 0.3
"""σ from which the thesis finds no advantage any more."""


def _exact(condition: Condition) -> bool:
    return condition[1] == 0.0 and condition[2] == 0.0


def _noisy(condition: Condition) -> bool:
    return 0.0 < condition[1] < MUCH and condition[2] == 0.0


def _very_noisy(condition: Condition) -> bool:
    return condition[1] >= MUCH and condition[2] == 0.0


def _lossy(condition: Condition) -> bool:
    return condition[2] > 0.0


def _anywhere(condition: Condition) -> bool:
    return True


def _window(method: str) -> bool:
    return is_baseline(method) and method.startswith("fm")


def _one_of(*names: str) -> Callable[[str], bool]:
    return lambda method: method in names


@dataclass(frozen=True)
class Claim:
    """That a method's mean return over training, held against others', is as `expected`."""

    text: str
    method: str
    others: Callable[[str], bool]
    where: Callable[[Condition], bool]
    expected: str = BETTER


CLAIMS = (
    Claim("§5.9: a predictive state learns more than finite memories and GRUs.", OWN, is_baseline, _exact),
    Claim("Figure 5.9: under mild noise it clearly beats finite memories.", OWN, _window, _noisy),
    Claim("Figure 5.9: under much noise (σ = 0.3) the advantage vanishes.", OWN, _window, _very_noisy, EQUAL),
    Claim("Not in the thesis: where observations are lost, it beats all baselines.", OWN, is_baseline, _lossy),
    Claim("Figure 5.8: it beats a filter that stays as first learned.", OWN, _one_of("rpsp-frozen"), _anywhere),
    Claim("Figure 5.8: it beats a random filter.", OWN, _one_of("rpsp-random"), _anywhere),
    Claim("Figure 5.8: it beats a filter without prediction loss.", OWN, _one_of("rpsp-reactive"), _anywhere),
    Claim("Figure 5.7: it beats a GRU with a prediction loss.", OWN, _one_of("gru-predictive"), _anywhere),
    Claim("Figure 5.6: an observation beside the state helps.", "rpsp-obs", _one_of(OWN), _anywhere),
    Claim(
        "§5.9: joint and alternating updates do alike.", "rpsp-vrpg", _one_of("rpsp-alt"), _anywhere, EQUAL
    ),
)  # fmt: skip
FOUND = ((BETTER, "better"), (EQUAL, "no difference"), (WORSE, "worse"), (TOO_FEW, "too few runs to tell"))


def verdicts(results: ControlResults) -> tuple[tuple[str, str], ...]:
    """For each claim that was put to a test, what the tests say."""
    told = []
    for claim in CLAIMS:
        found = [
            row["verdict"]
            for condition in results.conditions
            if claim.where(condition)
            for other in results.methods
            if claim.others(other) and other != claim.method
            if (row := results.compared(condition, claim.method, other)) is not None
        ]
        if found:
            told.append((claim.text, _judged(claim, found)))
    return tuple(told)


def against_the_best(results: ControlResults) -> str:
    """One paragraph: in how many conditions the predictive state is better or worse than the best baseline."""
    found: dict[str, list[str]] = {}
    for condition in results.conditions:
        best = results.best_baseline(condition)
        test = results.compared(condition, OWN, best) if best else None
        if test is not None:
            found.setdefault(test["verdict"], []).append(f"{titled(condition)} ({label_of(str(best))})")
    count = sum(len(one) for one in found.values())
    if not count:
        return f"{label_of(OWN)} was not held against a baseline by a test."
    parts = [
        f"{words} in {len(found[verdict])}: {'; '.join(found[verdict])}" for verdict, words in FOUND if verdict in found
    ]
    return (
        f"{label_of(OWN)} against the best baseline of each task and condition, {count} in all, by mean return over "
        f"training. {'. '.join(part[0].upper() + part[1:] for part in parts)}."
    )


def foretold(results: ControlResults) -> str | None:
    """In how many conditions the predictive state foretells better than others; None where it was not compared.

    That is its last form (refined, corrected); errors are means over seeds, one step ahead.
    """
    first = [{name: ahead[1][0] for name, ahead in own.items() if 1 in ahead} for own in results.errors.values()]
    rivals: dict[str, list[bool]] = {}
    form = ""
    for errors in first:
        forms = [name for name in errors if name.startswith(FILTER) and AT not in name]
        orders = [name for name in errors if name.startswith("order ")]
        if not forms:
            continue
        form = forms[-1]
        for rival, names in (
            ("the last observation", ["last"]),
            ("autoregression of order 2", ["order 2"]),
            ("every order that was tried", orders),
            ("the GRU", ["gru"]),
            ("the thesis’s kernel filter", ["kernel"]),
        ):
            # Orders that need longer pasts have fewer rows, and are held against the error on these.
            won = [errors.get(f"{form}{AT}{name}", errors[form]) < errors[name] for name in names if name in errors]
            if won:
                rivals.setdefault(rival, []).append(all(won))
    if not rivals:
        return None
    parts = [f"than {rival} in {sum(found)} of {len(found)}" for rival, found in rivals.items()]
    return (
        f"One step ahead the {predictor_label(form)}, foretells better {', '.join(parts)} conditions. Errors are means "
        "over seeds; no test is behind this."
    )


def _judged(claim: Claim, found: Sequence[str]) -> str:
    decided = [verdict for verdict in found if verdict != TOO_FEW]
    counted = [(found.count(verdict), words) for verdict, words in FOUND if verdict in found]
    counts = [words if len(found) == 1 else f"{count} {words}" for count, words in counted]
    tests = "1 test" if len(found) == 1 else f"{len(found)} tests"
    agree = sum(verdict == claim.expected for verdict in decided)
    if not decided:
        summary = "Not decided"
    elif agree == len(decided):
        summary = "Holds here"
    elif agree:
        summary = f"Holds in {agree} of {len(decided)}"
    else:
        summary = "Not found here"
    return f"{summary}. {tests}: {', '.join(counts)}."
