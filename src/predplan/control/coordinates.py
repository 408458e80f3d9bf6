"""Coordinates of linear filters around a given one, in which a step of one size means the same everywhere.

What is learned multiplies numbers of variance 1: states, actions, and innovations divided by their own spread; and
what is foretold is in units of it too. In the parameters themselves the loss is a narrow valley where observations
are nearly exact: K is in the hundreds there, and innovations in the thousandths. A change of C, D or d leaves the next
state as it is: with S^{1/2} the symmetric root,

    K = K₀ + k S₀^{-1/2},  C = C₀ + S₀^{1/2} c,  A = A₀ + a + K (C - C₀),

and so for D and d with B and c. Covariances stay such: S = S₀^{1/2} (I + s) (I + s)' S₀^{1/2}, and P_0 likewise.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import torch
from torch import Tensor

from predplan.control.differentiable import LEARNED
from predplan.control.linear_filter import LinearFilter
from predplan.control.tasks import FloatArray

ALL = (*LEARNED, "S", "initial_covariance")
LEAST = 1e-9
"""Share of a covariance's largest variance that counts as one."""


class Coordinates:
    """Of filters around `model`, which is at 0."""

    def __init__(self, model: LinearFilter) -> None:
        self._model = model
        self._at = {name: torch.from_numpy(np.array(getattr(model, name), np.float64)) for name in ALL}
        spread, self._start = _root(model.S), torch.from_numpy(_root(model.initial_covariance))
        self._spread, self._narrow = torch.from_numpy(spread), torch.from_numpy(np.linalg.inv(spread))
        self.size = sum(values.numel() for values in self._at.values())

    def parameters(self, point: Tensor) -> dict[str, Tensor]:
        """All of the filter's parameters at a point [size], as functions of it."""
        parts = torch.split(point, [values.numel() for values in self._at.values()])
        by = {name: part.reshape(self._at[name].shape) for name, part in zip(ALL, parts, strict=True)}
        at = self._at
        K = at["K"] + by["K"] @ self._narrow
        C, D, d = (self._spread @ by[name] for name in ("C", "D", "d"))
        return {
            "A": at["A"] + by["A"] + K @ C,
            "B": at["B"] + by["B"] + K @ D,
            "c": at["c"] + by["c"] + K @ d,
            "K": K,
            "C": at["C"] + C,
            "D": at["D"] + D,
            "d": at["d"] + d,
            "initial_mean": at["initial_mean"] + by["initial_mean"],
            "S": _square(self._spread, by["S"]),
            "initial_covariance": _square(self._start, by["initial_covariance"]),
        }

    def model(self, point: Tensor) -> LinearFilter:
        """The filter at a point [size]."""
        with torch.no_grad():
            found: dict[str, Any] = {name: one.numpy().copy() for name, one in self.parameters(point).items()}
        return replace(self._model, **found)


def _root(covariance: FloatArray) -> FloatArray:
    """The symmetric root, with some of every direction."""
    values, vectors = np.linalg.eigh(covariance)
    root: FloatArray = (vectors * np.sqrt(np.maximum(values, LEAST * max(values[-1], LEAST)))) @ vectors.T
    return root


def _square(root: Tensor, change: Tensor) -> Tensor:
    half = root @ (torch.eye(len(root), dtype=root.dtype) + change)
    return half @ half.T
