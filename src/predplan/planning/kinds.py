"""The kinds of problem suites."""

from __future__ import annotations

from typing import Literal, get_args

SuiteKind = Literal["maze", "planar", "kitchen-simple", "kitchen-cluttered", "kitchen-constrained"]
KINDS: tuple[SuiteKind, ...] = get_args(SuiteKind)
IN_THE_PLANE: tuple[SuiteKind, ...] = ("maze", "planar")
