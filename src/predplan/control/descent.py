"""Descent by limited-memory BFGS (Nocedal 1980), with steps that can be rejected.

A step is shortened until the function is defined there and falls enough. Where it is not defined, because a number is
not finite or a condition does not hold, is counted.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

from torch import Tensor

from predplan.control.bounds import check_number, check_whole

ENOUGH, SHORTER, CURVED = 1e-4, 0.4, 1e-10
"""Share of the fall that the slope foretells; a shortened step's length; curvature that counts, relative."""

Evaluate = Callable[[Tensor], tuple[float, Tensor] | None]
"""Value and gradient at a point; None where the function is not defined."""


@dataclass(frozen=True)
class DescentSettings:
    """How to descend."""

    first: float = 0.01  # length of the first step
    longest: float = 1.0  # length of any step
    memory: int = 20  # steps whose curvature is remembered
    tries: int = 12  # lengths of a step that are tried

    def __post_init__(self) -> None:
        check_number(self, "first", "longest", above=0)
        check_whole(self, "memory", "tries")


@dataclass(frozen=True)
class Step:
    """Where a step led."""

    point: Tensor
    value: float
    slope: float  # norm of the gradient
    undefined: int  # points tried at which the function was not defined


def descend(evaluate: Evaluate, point: Tensor, settings: DescentSettings) -> Iterator[Step]:
    """Steps down from a point, each when it is asked for, until none is found. Nothing, if undefined at the start.

    The function may change between steps: it is evaluated anew where the last one led.
    """
    pairs: list[tuple[Tensor, Tensor]] = []
    while (found := evaluate(point)) is not None:
        value, gradient = found
        taken, undefined = None, 0
        for remembered in (pairs, []):
            direction = _direction(gradient, remembered, settings.first)
            taken, more = _search(evaluate, point, value, gradient, direction, settings)
            undefined += more
            if taken or not pairs:
                break
        if taken is None:
            return
        moved, lower, after = taken
        step, change = moved - point, after - gradient
        if step @ change > CURVED * step.norm() * change.norm():
            pairs = [*pairs, (step, change)][-settings.memory :]
        point = moved
        yield Step(point, lower, float(after.norm()), undefined)


def _direction(gradient: Tensor, pairs: list[tuple[Tensor, Tensor]], first: float) -> Tensor:
    """Minus the gradient times what the pairs (step, change of gradient) say of the inverse curvature."""
    if not pairs:
        return -gradient * (first / max(float(gradient.norm()), 1e-300))
    direction, shares = -gradient.clone(), []
    for step, change in reversed(pairs):
        share = (step @ direction) / (step @ change)
        direction -= share * change
        shares.append(share)
    step, change = pairs[-1]
    direction *= (step @ change) / (change @ change)
    for (step, change), share in zip(pairs, reversed(shares), strict=True):
        direction += step * (share - (change @ direction) / (step @ change))
    return direction


def _search(
    evaluate: Evaluate, point: Tensor, value: float, gradient: Tensor, direction: Tensor, settings: DescentSettings
) -> tuple[tuple[Tensor, float, Tensor] | None, int]:
    """The first point along the direction that is low enough, and at how many the function was not defined."""
    undefined, slope = 0, float(gradient @ direction)
    length = min(1.0, settings.longest / max(float(direction.norm()), 1e-300))
    if not slope < 0.0:
        return None, 0
    for _ in range(settings.tries):
        moved = point + length * direction
        found = evaluate(moved)
        if found is None:
            undefined += 1
        elif found[0] <= value + ENOUGH * length * slope:
            return (moved, *found), undefined
        length *= SHORTER
    return None, undefined
