"""How the report on control calls tasks, conditions and methods, and which of these stand together."""

from __future__ import annotations

import re
from collections.abc import Sequence

from predplan.control.comparing import OWN
from predplan.control.curves import Condition

TITLES = {
    "cartpole": "CartPole",
    "swimmer": "Swimmer",
    "hopper": "Hopper",
    "walker2d": "Walker2d",
}
LABELS = {
    "rpsp": "RPSP",
    "rpsp-obs": "RPSP + observation",
    "rpsp-frozen": "RPSP, filter fixed",
    "rpsp-random": "RPSP, random filter",
    "rpsp-reactive": "RPSP, no prediction loss",
    "rpsp-unrefined": "RPSP, not refined",
    "rpsp-vrpg": "RPSP, joint (VRPG)",
    "rpsp-alt": "RPSP, alternating",
    "rpsp-trpo": "RPSP, TRPO",
    "fm1": "last observation",
    "fm2": "2 observations",
    "fm5": "5 observations",
    "fm10": "10 observations",
    "fm2-trpo": "2 observations, TRPO",
    "gru": "GRU",
    "gru-16": "GRU, 16 units",
    "gru-64": "GRU, 64 units",
    "gru-128": "GRU, 128 units",
    "gru-trpo": "GRU, TRPO",
    "gru-predictive": "GRU, prediction loss",
}
AT = " at "
"""Between the name of a predictor and that of the order on whose rows it is compared."""
PREDICTORS = {
    "last": "last observation",
    "gru": "GRU",
    "kernel": "kernel filter, as in the thesis",
    "innovation": "predictive state",
    "innovation refined": "predictive state, refined",
    "innovation corrected": "predictive state, refined and corrected",
}
MAIN = ("rpsp", "fm2", "fm10", "gru")
PARTS = ("rpsp", "rpsp-frozen", "rpsp-random", "rpsp-reactive", "rpsp-unrefined")
FORMS = ("rpsp", "rpsp-obs", "rpsp-vrpg", "rpsp-alt", "rpsp-trpo", "fm2-trpo", "gru-trpo")


def label_of(method: str) -> str:
    """What a method is called; its own name if it has no other."""
    return LABELS.get(method, method)


def predictor_label(name: str) -> str:
    """What a predictor is called; `... at order 20` is one on the fewer rows that order 20 has."""
    own, at, order = name.partition(AT)
    if own.startswith("order "):
        return f"autoregression, {own}"
    return PREDICTORS.get(own, label_of(own)) + (f", on the rows of {order}" if at else "")


def task_title(task: str) -> str:
    """What a task is called."""
    return TITLES.get(task, task)


def observed(condition: Condition) -> str:
    """How a condition's task is observed."""
    _, noise, drop = condition
    parts = [f"noise σ = {noise:g}"] if noise else []
    parts += [f"{100 * drop:g} % lost"] if drop else []
    return ", ".join(parts) or "exact positions"


def titled(condition: Condition) -> str:
    """A condition in a few words."""
    return f"{task_title(condition[0])}, {observed(condition)}"


def groups(methods: Sequence[str]) -> list[tuple[str, str, list[str]]]:
    """Methods that are drawn together: name, what is compared, methods; the last group has what is in no other."""
    windows = [name for name in methods if re.fullmatch(r"fm\d+", name)]
    sizes = [name for name in methods if re.fullmatch(r"gru(-\d+)?", name)]
    found = [
        ("learning", "A predictive state against finite memories and a GRU (Figure 5.5)", _of(MAIN, methods)),
        ("parts", "What the parts of RPSP are worth (Figure 5.8)", _of(PARTS, methods)),
        ("forms", "Forms of RPSP, and other updates (Figure 5.6)", _of(FORMS, methods)),
        ("latent", "Predictive and latent states (Figure 5.7)", _of(("rpsp", "gru", "gru-predictive"), methods)),
        ("sizes", "Sizes of a GRU (Figure 5.10)", sizes),
        ("windows", "Lengths of a finite memory (Figure 5.11)", windows),
    ]
    drawn = [group for group in found if group[0] == "learning" or (len(group[2]) > 1 and not set(group[2]) <= {*MAIN})]
    rest = [name for name in methods if not any(name in group[2] for group in drawn)]
    if rest:
        drawn.append(("others", "Other methods", [*_of((OWN,), methods), *rest]))
    return [group for group in drawn if group[2]]


def _of(names: Sequence[str], methods: Sequence[str]) -> list[str]:
    return [name for name in names if name in methods]
