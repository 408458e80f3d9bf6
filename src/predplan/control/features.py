"""Random Fourier features of the Gaussian kernel (Rahimi and Recht 2008), brought to few numbers by randomised PCA.

The bandwidth is a percentile of squared distances, not their median: CartPole learned three times as much with wide
kernels. These make features small; whitening the components, for a ridge to mean the same for all, made the filter's
updates less stable.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from predplan.control.bounds import check_number, check_whole
from predplan.control.tasks import FloatArray

COMPARED = 10_000
"""Pairs whose distances make the percentile."""
MORE_COMPONENTS, POWERS = 10, 2
"""Of the randomised PCA (Halko, Martinsson and Tropp 2011): columns beyond those wanted, and subspace iterations."""


@dataclass(frozen=True)
class FeatureSettings:
    """Of one feature map."""

    frequencies: int = 500  # each gives a sine and a cosine
    percentile: float = 95.0  # of squared distances, the squared bandwidth
    dimension: int = 20  # components that are kept

    def __post_init__(self) -> None:
        check_whole(self, "frequencies", "dimension")
        check_number(self, "percentile", above=0, most=100)


class Features(Protocol):
    """Any map of points [n, d] to features [n, p]."""

    def __call__(self, points: FloatArray) -> FloatArray:
        """[n, d] -> [n, p]."""


@dataclass(frozen=True)
class FeatureMap:
    """x -> projection' [cos(w x), sin(w x)] / √frequencies, x standardised."""

    shift: FloatArray  # [d]
    scale: FloatArray  # [d]
    frequencies: FloatArray  # [d, f]
    projection: FloatArray  # [2 f, p]

    @property
    def dimension(self) -> int:
        """p."""
        return int(self.projection.shape[1])

    def __call__(self, points: FloatArray) -> FloatArray:
        """Features [n, p] of points [n, d]."""
        features: FloatArray = fourier((points - self.shift) / self.scale, self.frequencies) @ self.projection
        return features


def fit_features(points: FloatArray, settings: FeatureSettings, generator: np.random.Generator) -> FeatureMap:
    """Draw the frequencies for points [n, d] and find the components."""
    scale = points.std(axis=0)
    shift, scale = points.mean(axis=0), np.where(scale > 1e-12, scale, 1.0)
    scaled = (points - shift) / scale
    width = squared_bandwidth(scaled, settings.percentile, generator)
    drawn = generator.standard_normal((points.shape[1], settings.frequencies)) / np.sqrt(width)
    projection = components(fourier(scaled, drawn), settings.dimension, generator)
    return FeatureMap(shift, scale, drawn, projection)


def fourier(points: FloatArray, frequencies: FloatArray) -> FloatArray:
    """[n, d], [d, f] -> [n, 2 f]; the inner product of two rows tends to exp(-|x - y|² / 2σ²), w ~ N(0, 1 / σ²)."""
    phase = points @ frequencies
    waves: FloatArray = np.concatenate([np.cos(phase), np.sin(phase)], axis=1) / np.sqrt(frequencies.shape[1])
    return waves


def squared_bandwidth(points: FloatArray, percentile: float, generator: np.random.Generator) -> float:
    """That percentile of squared distances of random pairs of different points [n, d]; 1 if all points are one."""
    first, second = generator.integers(0, len(points), (2, COMPARED))
    distances = np.sum((points[first] - points[second]) ** 2, axis=1)
    distances = distances[distances > 0.0]
    return float(np.percentile(distances, percentile)) if len(distances) else 1.0


def components(features: FloatArray, dimension: int, generator: np.random.Generator) -> FloatArray:
    """Leading right singular vectors [d, p] of features [n, d], uncentred; p is at most `dimension` and the rank."""
    n, d = features.shape
    sketch = min(dimension + MORE_COMPONENTS, n, d)
    basis = np.linalg.qr(features.T @ (features @ generator.standard_normal((d, sketch))))[0]
    for _ in range(POWERS):
        basis = np.linalg.qr(features.T @ (features @ basis))[0]
    _, values, right = np.linalg.svd(features @ basis, full_matrices=False)
    kept = min(dimension, int(np.sum(values > 1e-7 * values[0])))
    vectors = basis @ right[:kept].T
    # Signs are a singular vector's own; fixed, so that one library's choice is not in the result.
    found: FloatArray = vectors * np.sign(vectors[np.argmax(np.abs(vectors), axis=0), np.arange(kept)])
    return found
