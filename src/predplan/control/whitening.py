"""Inputs of mean 0 and covariance I, kept up to date without changing what is computed from them.

Positions a step apart differ by little, and what matters, velocity, is in the difference: whitening shows a policy
all directions at the same size. Statistics of a policy's own data change as it learns; the layer that reads the
inputs is then changed along, so that outputs stay as they were.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch

from predplan.control.tasks import FloatArray


@dataclass(frozen=True)
class Statistics:
    """Running mean and covariance of what was seen."""

    count: float
    mean: FloatArray  # [F]
    covariance: FloatArray  # [F, F]

    def updated(self, values: FloatArray, most: float) -> Statistics:
        """With rows [n, F] added; older ones count no more than `most` rows."""
        old, n = min(self.count, most), len(values)
        total = old + n
        mean, covariance = values.mean(axis=0), np.cov(values.T, bias=True).reshape(self.covariance.shape)
        shift = mean - self.mean
        joined = (old * self.covariance + n * covariance) / total + old * n / total**2 * np.outer(shift, shift)
        return Statistics(total, self.mean + n / total * shift, joined)


def no_statistics(size: int) -> Statistics:
    """Of nothing seen."""
    return Statistics(0.0, np.zeros(size), np.zeros((size, size)))


@dataclass(frozen=True)
class Whitening:
    """z = matrix (x - mean), clipped."""

    mean: FloatArray  # [F]
    matrix: FloatArray  # [F, F]

    @property
    def offset(self) -> FloatArray:
        """[F] of z = matrix x + offset."""
        return -self.matrix @ self.mean

    def __call__(self, values: FloatArray) -> FloatArray:
        """[n, F] -> [n, F]."""
        white: FloatArray = (values - self.mean) @ self.matrix.T
        return np.clip(white, -10.0, 10.0, out=white)


def no_whitening(size: int) -> Whitening:
    """z = x."""
    return Whitening(np.zeros(size), np.eye(size))


def whiten(statistics: Statistics, floor: float) -> Whitening:
    """Each number to variance 1, then all directions; those of less than a share `floor` of it are not blown up.

    The root of the correlations is symmetric: of all that whiten it changes standardised inputs least. A number that
    never changed keeps its unit.
    """
    variance = np.diag(statistics.covariance)
    scale = np.where(variance > 1e-16, np.sqrt(np.maximum(variance, 1e-16)), 1.0)
    correlation = statistics.covariance / np.outer(scale, scale) + np.diag(variance <= 1e-16)
    values, vectors = np.linalg.eigh(correlation)
    matrix = (vectors / np.sqrt(np.maximum(values, floor))) @ vectors.T / scale
    return Whitening(statistics.mean, matrix)


@torch.no_grad()
def carry_over(
    weight: torch.Tensor, bias: torch.Tensor, matrix: FloatArray, offset: FloatArray, new: Whitening
) -> None:
    """Change a layer's weight [H, G] and bias [H] so that it makes of new(x) what it made of matrix x + offset.

    The weight may change its width, from that of matrix [G, F] to F.
    """
    before = weight.double().numpy()
    through = np.linalg.solve(new.matrix.T, (before @ matrix).T).T
    bias += torch.from_numpy(before @ (matrix @ new.mean + offset)).to(bias.dtype)
    weight.data = torch.from_numpy(np.ascontiguousarray(through)).to(weight.dtype)
