"""Trajectories as elements of a vector-valued reproducing kernel Hilbert space (§4.2)."""

from dataclasses import dataclass, replace

import numpy as np

from predplan.planning.kernels import Kernel, diagonal
from predplan.planning.robots import FloatArray, IntArray


@dataclass(frozen=True)
class Trajectory:
    """ξ(t) = line(t) + f(t), f(t) = Σᵢ ∂^orderᵢ k(t, tᵢ) B aᵢ, t in [0, 1].

    The line joins start and goal; only f is in the space, with ⟨f, g⟩ = Σᵢⱼ aᵢᵀ k(tᵢ, tⱼ) B bⱼ. (The thesis, Eq. 4.12,
    shrinks the line too, which is not in a Gaussian space.)
    """

    kernel: Kernel
    joint: FloatArray  # B [D, D], positive definite: the identity where joints are independent
    start: FloatArray  # [D] rad or m
    goal: FloatArray  # [D]
    times: FloatArray  # [N] the support
    orders: IntArray  # [N] 0: k(., t); 1: the representer of the velocity at t
    coefficients: FloatArray  # a [N, D]

    def __call__(self, t: FloatArray, order: int = 0) -> FloatArray:
        """Configurations, or derivatives by the normalised time, at t [n] -> [n, D]."""
        span = self.goal - self.start
        if order == 0:
            line = self.start + np.multiply.outer(t, span)
        else:
            line = np.broadcast_to(span if order == 1 else np.zeros_like(span), (len(t), len(span)))
        return line + self.section(t, order) @ self.coefficients @ self.joint

    def section(self, t: FloatArray, order: int = 0) -> FloatArray:
        """Gram matrix [n, N] between evaluations at t and the support."""
        gram = np.zeros((len(t), len(self.times)))
        for support_order in np.unique(self.orders):
            chosen = self.orders == support_order
            gram[:, chosen] = self.kernel.gram(t, self.times[chosen], order, int(support_order))
        return gram

    def grown(self, times: FloatArray, orders: IntArray, coefficients: FloatArray) -> "Trajectory":
        """The trajectory with further support points added: one functional gradient step."""
        return replace(
            self,
            times=np.concatenate([self.times, times]),
            orders=np.concatenate([self.orders, orders]),
            coefficients=np.concatenate([self.coefficients, coefficients]),
        )


def straight(kernel: Kernel, joint: FloatArray, start: FloatArray, goal: FloatArray) -> Trajectory:
    """The element f = 0: the straight line from start to goal."""
    none = np.zeros(0)
    return Trajectory(kernel, joint, start, goal, none, none.astype(np.int64), np.zeros((0, len(start))))


def support_gram(trajectory: Trajectory) -> FloatArray:
    """Gram matrix [N, N] of the support's representers."""
    return functional_gram(trajectory.kernel, trajectory.times, trajectory.orders, trajectory.times, trajectory.orders)


def functional_gram(
    kernel: Kernel, times: FloatArray, orders: IntArray, other_times: FloatArray, other_orders: IntArray
) -> FloatArray:
    """Gram matrix [n, m] between derivatives of the given orders at the given times."""
    gram = np.zeros((len(times), len(other_times)))
    for order in np.unique(orders):
        for other in np.unique(other_orders):
            rows, columns = orders == order, other_orders == other
            block = kernel.gram(times[rows], other_times[columns], int(order), int(other))
            gram[np.ix_(rows, columns)] = block
    return gram


def inner_product(left: Trajectory, right: Trajectory) -> float:
    """⟨f, g⟩ of two trajectories' parts in the space (Eq. 4.23); both have the same kernel and joint matrix."""
    gram = functional_gram(left.kernel, left.times, left.orders, right.times, right.orders)
    return float(np.sum(left.coefficients * (gram @ right.coefficients @ left.joint)))


def norm(trajectory: Trajectory) -> float:
    """‖f‖ (Eq. 4.23)."""
    return float(np.sqrt(max(inner_product(trajectory, trajectory), 0.0)))


def natural_gradient(kernel: Kernel, joint: FloatArray, times: FloatArray, gradients: FloatArray) -> FloatArray:
    """Values [n, D] at the times of the functional gradient whose Euclidean gradients there are given [n, D].

    K g: the thesis's K⁻¹ (Eq. 4.24) is for coefficients, not for trajectory values.
    """
    return kernel.gram(times, times) @ gradients @ joint


@dataclass(frozen=True)
class Compressed:
    """A trajectory on fewer support points and how far it may be from the one it stands for."""

    trajectory: Trajectory
    distance: float  # ‖f - f'‖ in the space
    deviation: float  # bound of |f_d(t) - f'_d(t)| over all t and joints, rad or m


def compress(trajectory: Trajectory, tolerance: float) -> Compressed:
    """The fewest support points, chosen greedily, that keep every joint within `tolerance` (rad or m) at all times.

    Points are taken in the order of a pivoted Cholesky factorisation weighted by the residual; f is projected
    orthogonally onto their span. The bound is the reproducing property: |g_d(t)| ≤ ‖g‖ √(k(t, t) B_dd).
    """
    gram = support_gram(trajectory)
    height = _largest_representer(trajectory)
    chosen: list[int] = []
    best = replace(
        trajectory, times=np.zeros(0), orders=np.zeros(0, np.int64), coefficients=np.zeros((0, len(trajectory.start)))
    )
    residual = trajectory.coefficients
    distance = norm(trajectory)
    while distance * height > tolerance and len(chosen) < len(gram):
        gains = np.sum((gram @ residual @ trajectory.joint) ** 2, axis=1) / np.maximum(np.diag(gram), 1e-300)
        gains[chosen] = -1.0
        chosen.append(int(np.argmax(gains)))
        inner = gram[np.ix_(chosen, chosen)]
        ridge = 1e-13 * np.trace(inner) / len(inner)
        coefficients = np.linalg.solve(inner + ridge * np.eye(len(inner)), gram[chosen] @ trajectory.coefficients)
        best = replace(
            trajectory,
            times=trajectory.times[chosen],
            orders=trajectory.orders[chosen],
            coefficients=coefficients,
        )
        residual = trajectory.coefficients.copy()
        residual[chosen] -= coefficients
        distance = float(np.sqrt(max(np.sum(residual * (gram @ residual @ trajectory.joint)), 0.0)))
    return Compressed(best, distance, distance * height)


def _largest_representer(trajectory: Trajectory) -> float:
    times = np.linspace(0.0, 1.0, 513)
    return float(np.sqrt(max(diagonal(trajectory.kernel, times).max(), 0.0) * np.diag(trajectory.joint).max()))
