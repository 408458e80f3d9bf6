"""Reproducing kernels of time, with their derivatives: what decides which trajectories are cheap (§4.4, §4.5).

Every kernel gives ∂ˢ∂ᵗ-derivatives of k(s, t) through one method, `gram`, so that a trajectory's velocity, a velocity
constraint and conditioning on end velocities are all Gram matrices. Where the thesis prints exp(+d²/2σ²) (Eqs. 4.2,
4.6, 4.7) and an antisymmetric "derivative kernel" (§4.4), the positive semi-definite forms are used.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from math import comb, inf
from typing import Any, Literal, Protocol

import numpy as np

from predplan.planning.robots import FloatArray

Metric = Literal["velocity", "acceleration"]


class Kernel(Protocol):
    """A positive semi-definite function of two times in [0, 1]."""

    @property
    def smoothness(self) -> float:
        """How many derivatives in each argument are in the space: orders above it have no representer."""

    def gram(self, s: FloatArray, t: FloatArray, s_order: int = 0, t_order: int = 0) -> FloatArray:
        """The matrix ∂^s_order ∂^t_order k(s_i, t_j). s [n], t [m] -> [n, m]."""


@dataclass(frozen=True)
class Gaussian:
    """k(s, t) = exp(-(s - t)² / 2σ²), Eq. 4.6 with its sign mended."""

    width: float

    @property
    def smoothness(self) -> float:
        """Infinitely many derivatives."""
        return inf

    def gram(self, s: FloatArray, t: FloatArray, s_order: int = 0, t_order: int = 0) -> FloatArray:
        """Derivatives by Hermite's polynomials: gⁿ(d) = (-1/σ)ⁿ Heₙ(d/σ) g(d)."""
        scaled = np.subtract.outer(s, t) / self.width
        order = s_order + t_order
        hermite = np.polynomial.hermite_e.hermeval(scaled, [0.0] * order + [1.0])
        return np.asarray((-1.0) ** s_order / self.width**order * hermite * np.exp(-0.5 * scaled**2), np.float64)


@dataclass(frozen=True)
class Laplacian:
    """k(s, t) = exp(-|s - t| / σ): continuous trajectories with corners."""

    width: float

    @property
    def smoothness(self) -> float:
        """No derivative is in the space."""
        return 0

    def gram(self, s: FloatArray, t: FloatArray, s_order: int = 0, t_order: int = 0) -> FloatArray:
        """Derivatives away from s = t, where they exist; 0 at s = t."""
        difference = np.subtract.outer(s, t) / self.width
        order = s_order + t_order
        value = np.exp(-np.abs(difference)) / self.width**order
        sign = np.sign(difference)
        return (-1.0) ** s_order * value * (sign if order % 2 else np.ones_like(sign)) * (sign != 0 if order else 1.0)


@dataclass(frozen=True)
class BSpline:
    """k(s, t) = B_degree((s - t) / spacing), the central B-spline of odd degree, whose transform is never negative."""

    spacing: float
    degree: int = 3

    @property
    def smoothness(self) -> float:
        """A representer of order n needs 2n continuous derivatives of the spline."""
        return (self.degree - 1) // 2

    @cached_property
    def _spline(self) -> Any:
        from scipy.interpolate import BSpline as Spline  # half a second that the other kernels need not wait

        half = (self.degree + 1) / 2
        return Spline.basis_element(np.linspace(-half, half, self.degree + 2), extrapolate=False)

    def gram(self, s: FloatArray, t: FloatArray, s_order: int = 0, t_order: int = 0) -> FloatArray:
        """Zero from (degree + 1) / 2 spacings on."""
        order = s_order + t_order
        scaled = np.subtract.outer(s, t) / self.spacing
        value: FloatArray = np.nan_to_num(self._spline(scaled, nu=order) if order else self._spline(scaled))
        return (-1.0) ** t_order / self.spacing**order * value


@dataclass(frozen=True)
class Waypoints:
    """The waypoint parametrisation as a kernel: k(s, t) = w(s)ᵀ A⁻¹ w(t), w linear interpolation (§4.5.1).

    `count` inner waypoints at equal steps between two fixed ends; A penalises the sum of squared first (velocity) or
    second differences (acceleration). At the waypoints' own times this is CHOMP's A⁻¹.
    """

    count: int
    metric: Metric

    @property
    def smoothness(self) -> float:
        """Finitely many dimensions: the (one-sided) derivative is a bounded functional."""
        return 1

    @cached_property
    def inverse_metric(self) -> FloatArray:
        """A⁻¹ [count, count]."""
        first = np.diff(np.eye(self.count + 2), axis=0)
        differences = first if self.metric == "velocity" else np.diff(first, axis=0)
        inner = differences[:, 1:-1]
        return np.asarray(np.linalg.inv(inner.T @ inner), np.float64)

    def interpolation(self, t: FloatArray, order: int = 0) -> FloatArray:
        """Weights [n, count] of the waypoints in the trajectory at t [n], or in its derivatives."""
        segments = self.count + 1
        position = np.clip(t, 0.0, 1.0) * segments
        left = np.minimum(position.astype(np.int64), self.count)
        weights = np.zeros((len(t), self.count + 2))
        rows = np.arange(len(t))
        if order == 0:
            weights[rows, left] = 1.0 - (position - left)
            weights[rows, left + 1] = position - left
        elif order == 1:
            weights[rows, left] = -segments
            weights[rows, left + 1] = segments
        return weights[:, 1:-1]

    def gram(self, s: FloatArray, t: FloatArray, s_order: int = 0, t_order: int = 0) -> FloatArray:
        """Derivatives of the piecewise linear interpolant; from the second on they are zero."""
        return self.interpolation(s, s_order) @ self.inverse_metric @ self.interpolation(t, t_order).T


@dataclass(frozen=True)
class Derivative:
    """∂ₛ∂ₜk(s, t): the kernel of the velocities of another kernel's trajectories."""

    kernel: Kernel

    @property
    def smoothness(self) -> float:
        """One less than the kernel it derives from."""
        return self.kernel.smoothness - 1

    def gram(self, s: FloatArray, t: FloatArray, s_order: int = 0, t_order: int = 0) -> FloatArray:
        """One derivative more in each argument."""
        return self.kernel.gram(s, t, s_order + 1, t_order + 1)


@dataclass(frozen=True)
class Scaled:
    """factor · k, factor not negative."""

    kernel: Kernel
    factor: float

    @property
    def smoothness(self) -> float:
        """That of the kernel."""
        return self.kernel.smoothness

    def gram(self, s: FloatArray, t: FloatArray, s_order: int = 0, t_order: int = 0) -> FloatArray:
        """Derivatives scale alike."""
        return self.factor * self.kernel.gram(s, t, s_order, t_order)


@dataclass(frozen=True)
class Sum:
    """k₁ + k₂ + ..."""

    kernels: tuple[Kernel, ...]

    @property
    def smoothness(self) -> float:
        """That of the roughest."""
        return min(kernel.smoothness for kernel in self.kernels)

    def gram(self, s: FloatArray, t: FloatArray, s_order: int = 0, t_order: int = 0) -> FloatArray:
        """Derivatives add."""
        return np.asarray(np.sum([kernel.gram(s, t, s_order, t_order) for kernel in self.kernels], axis=0))


@dataclass(frozen=True)
class Product:
    """k₁ · k₂."""

    left: Kernel
    right: Kernel

    @property
    def smoothness(self) -> float:
        """That of the rougher."""
        return min(self.left.smoothness, self.right.smoothness)

    def gram(self, s: FloatArray, t: FloatArray, s_order: int = 0, t_order: int = 0) -> FloatArray:
        """Leibniz's rule in each argument."""
        total = np.zeros((len(s), len(t)))
        for i in range(s_order + 1):
            for j in range(t_order + 1):
                left = self.left.gram(s, t, i, j)
                total += comb(s_order, i) * comb(t_order, j) * left * self.right.gram(s, t, s_order - i, t_order - j)
        return total


@dataclass(frozen=True)
class Conditioned:
    """The kernel of those functions that vanish at given functionals: K - K_e K_ee⁻¹ K_eᵀ.

    A functional is a derivative of an order at a time; (0, 0) and (1, 0) fix both ends. This replaces Eqs. 4.16-4.18,
    whose multipliers leave an endpoint error as printed: here the ends hold exactly whatever is added.
    """

    kernel: Kernel
    times: tuple[float, ...]
    orders: tuple[int, ...]

    @property
    def smoothness(self) -> float:
        """That of the kernel."""
        return self.kernel.smoothness

    @cached_property
    def _inverse(self) -> FloatArray:
        rows = [self._functionals(np.array([time]), order) for time, order in zip(self.times, self.orders, strict=True)]
        inverse: FloatArray = np.linalg.pinv(np.concatenate(rows), rcond=1e-12, hermitian=True)
        return inverse

    def _functionals(self, s: FloatArray, s_order: int) -> FloatArray:
        columns = [
            self.kernel.gram(s, np.array([time]), s_order, order)
            for time, order in zip(self.times, self.orders, strict=True)
        ]
        return np.concatenate(columns, axis=1)

    def gram(self, s: FloatArray, t: FloatArray, s_order: int = 0, t_order: int = 0) -> FloatArray:
        """The Schur complement of the conditions."""
        left, right = self._functionals(s, s_order), self._functionals(t, t_order)
        return self.kernel.gram(s, t, s_order, t_order) - left @ self._inverse @ right.T


def with_derivative(kernel: Kernel, width: float) -> Kernel:
    """k + σ² ∂∂'k, the thesis's "GRBF-der" (§4.7.4), which leaves the weight open: σ² gives both terms one unit."""
    return Sum((kernel, Scaled(Derivative(kernel), width**2)))


def condition(kernel: Kernel, end_velocities: bool = False) -> Kernel:
    """The kernel of the functions that vanish at t = 0 and 1, and, if wanted, start and stop at rest.

    Raises ValueError if the kernel's functions have no velocity to condition on.
    """
    if end_velocities and kernel.smoothness < 1:
        raise ValueError(f"{kernel} has no derivative in its space: it cannot be conditioned on end velocities")
    return (
        Conditioned(kernel, (0.0, 1.0, 0.0, 1.0), (0, 0, 1, 1))
        if end_velocities
        else Conditioned(kernel, (0.0, 1.0), (0, 0))
    )


def normalise(kernel: Kernel, samples: int = 513) -> Kernel:
    """Scale a kernel so that the maximum of k(t, t) over [0, 1] is 1: then one step size means the same for all."""
    return Scaled(kernel, 1.0 / diagonal(kernel, np.linspace(0.0, 1.0, samples)).max())


def diagonal(kernel: Kernel, t: FloatArray) -> FloatArray:
    """k(t, t) [n] for t [n]."""
    return np.diag(kernel.gram(t, t)).copy()


def joint_interaction(jacobians: Sequence[FloatArray], epsilon: float) -> FloatArray:
    """The matrix B of K(s, t) = k(s, t) B that couples joints through the workspace (Eq. 4.7): JᵀJ + εI, trace D.

    JᵀJ alone has rank 3, and with it a trajectory could not reach most configurations. jacobians: [3, D] each, m/rad.
    """
    metric = sum((J.T @ J for J in jacobians), start=np.zeros((jacobians[0].shape[1],) * 2))
    metric = metric * len(metric) / np.trace(metric) + epsilon * np.eye(len(metric))
    coupled: FloatArray = metric * len(metric) / np.trace(metric)
    return coupled
