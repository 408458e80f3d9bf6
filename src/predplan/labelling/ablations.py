"""Each knob of the anchor HMM turned by itself, so that every default is backed by a number."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

from predplan.errors import InputError
from predplan.labelling.training import TrainingSettings

VARIATIONS: dict[str, tuple[Any, ...]] = {
    "moments.context_count": (5, 20, 100),
    "moments.vectors": (0, 50),
    "anchors.purity": (0.7, 0.9),
    "anchors.labelled_count": (1, 4),
    "anchors.raw_count": (20, 500),
    "posteriors.loss": ("ls", "kl"),
    "posteriors.projection": (0, 20, 100, 200),
    "posteriors.smoothing": (5.0, 50.0, 500.0),
    "folds": (2, 5),
    "lexicon.inverse_penalty": (0.3, 1.0, 3.0),
    "lexicon.shrinkage": (0.1, 1.0),
    "lexicon.lam": (0.0, 0.5, 1.0),
    "lexicon.least_count": (1, 2),
}

FOR_LEAST_SQUARES = ("posteriors.projection",)


@dataclass(frozen=True)
class Variation:
    """Settings that differ from the default in one component."""

    component: str
    setting: str
    default: bool
    settings: TrainingSettings


def variations(default: TrainingSettings, components: Sequence[str]) -> Iterator[Variation]:
    """All variations of some components, the default's own value of each among them; InputError for an unknown one."""
    for component in components:
        if component not in VARIATIONS:
            raise InputError(f"ablations: found {component!r}, expected some of {', '.join(VARIATIONS)}")
        values = VARIATIONS[component]
        base = _set(default, "posteriors.loss", "ls") if component in FOR_LEAST_SQUARES else default
        own = _get(default, component)
        for value in values if own in values else (*values, own):
            yield Variation(component, str(value), value == own, _set(base, component, value))


def _get(settings: Any, path: str) -> Any:
    for name in path.split("."):
        settings = getattr(settings, name)
    return settings


def _set(settings: Any, path: str, value: Any) -> Any:
    name, _, rest = path.partition(".")
    return replace(settings, **{name: _set(getattr(settings, name), rest, value) if rest else value})
