"""Bounds of settings: a value that cannot be is named, with what was found and what is allowed."""

from __future__ import annotations

import math
from numbers import Integral, Real

from predplan.errors import InputError


def check_whole(settings: object, *names: str, least: int = 1) -> None:
    """Raise InputError for the first of these fields that is no whole number of at least `least`."""
    for name in names:
        value = getattr(settings, name)
        if isinstance(value, bool) or not isinstance(value, Integral):
            raise InputError(f"{name}: found {value!r}, expected a whole number")
        if value < least:
            raise InputError(f"{name}: found {value}, expected at least {least}")


def check_number(
    settings: object,
    *names: str,
    above: float | None = None,
    least: float | None = None,
    below: float | None = None,
    most: float | None = None,
    finite: bool = True,
) -> None:
    """Raise InputError for the first of these fields that is no number within the bounds; NaN is in none.

    finite: infinity is in none either.
    """
    told = (("above", above), ("at least", least), ("below", below), ("at most", most))
    bounds = " and ".join(f"{words} {bound:g}" for words, bound in told if bound is not None)
    for name in names:
        value = getattr(settings, name)
        number = float(value) if isinstance(value, Real) else math.nan
        fits = (
            not math.isnan(number)
            and not (finite and math.isinf(number))
            and (above is None or number > above)
            and (least is None or number >= least)
            and (below is None or number < below)
            and (most is None or number <= most)
        )
        if not fits:
            raise InputError(f"{name}: found {value!r}, expected a number {bounds}".rstrip())
