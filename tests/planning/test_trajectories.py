from dataclasses import replace

import numpy as np
import pytest

from predplan.planning.kernels import Gaussian, Kernel, Waypoints, condition, joint_interaction, normalise
from predplan.planning.trajectories import (
    Trajectory,
    compress,
    inner_product,
    natural_gradient,
    norm,
    straight,
    support_gram,
)

COUPLED = joint_interaction([np.random.default_rng(3).standard_normal((3, 4))], 0.2)


def grown(kernel: Kernel, points: int, seed: int = 0, orders: bool = False) -> Trajectory:
    generator = np.random.default_rng(seed)
    element = straight(kernel, COUPLED, generator.uniform(-1, 1, 4), generator.uniform(-1, 1, 4))
    order = generator.integers(0, 2, points) if orders else np.zeros(points, np.int64)
    return element.grown(generator.uniform(0, 1, points), order, generator.standard_normal((points, 4)))


@pytest.mark.parametrize("kernel", [condition(Gaussian(0.3)), condition(Waypoints(30, "acceleration"))])
def test_ends_hold_exactly_after_any_number_of_steps(kernel: Kernel) -> None:
    trajectory = grown(normalise(kernel), 200)
    np.testing.assert_allclose(trajectory(np.array([0.0])), trajectory.start[None], atol=1e-10)
    np.testing.assert_allclose(trajectory(np.array([1.0])), trajectory.goal[None], atol=1e-10)


def test_evaluation_is_an_inner_product_with_the_kernel() -> None:
    """The reproducing property: ⟨f, K(., t) e_d⟩ = f_d(t), and with ∂K(., t) the velocity."""
    trajectory = grown(condition(Gaussian(0.4)), 6, orders=True)
    line = straight(trajectory.kernel, trajectory.joint, trajectory.start, trajectory.goal)
    t = np.array([0.37])
    for order in (0, 1):
        value = trajectory(t, order) - line(t, order)
        for d in range(4):
            representer = line.grown(t, np.array([order]), np.eye(4)[None, d])
            assert inner_product(trajectory, representer) == pytest.approx(value[0, d], rel=1e-9)


def test_derivatives_by_finite_differences() -> None:
    trajectory = grown(condition(Gaussian(0.4)), 6, orders=True)
    t, h = np.linspace(0.1, 0.9, 9), 1e-5
    for order in (0, 1):
        difference = (trajectory(t + h, order) - trajectory(t - h, order)) / (2 * h)
        np.testing.assert_allclose(trajectory(t, order + 1), difference, atol=1e-4)


def test_the_natural_gradient_is_the_gradient_in_the_spaces_norm() -> None:
    """A small step along K g changes a linear cost by ‖K g‖², the most of all steps of its norm."""
    kernel, times = normalise(condition(Gaussian(0.3))), np.array([0.2, 0.5, 0.8])
    gradients = np.random.default_rng(1).standard_normal((3, 4))
    line = straight(kernel, COUPLED, np.zeros(4), np.zeros(4))
    gradient = line.grown(times, np.zeros(3, np.int64), gradients)
    values = natural_gradient(kernel, COUPLED, times, gradients)
    np.testing.assert_allclose(gradient(times), values, atol=1e-12)
    assert np.sum(gradients * values) == pytest.approx(inner_product(gradient, gradient))


def test_compression_keeps_its_bound_and_needs_fewer_points() -> None:
    trajectory = grown(normalise(condition(Gaussian(0.5))), 120)
    compressed = compress(trajectory, 1e-3)
    t = np.linspace(0.0, 1.0, 501)
    deviation = np.abs(trajectory(t) - compressed.trajectory(t)).max()
    assert deviation <= compressed.deviation <= 1e-3
    assert len(compressed.trajectory.times) < 30
    difference = trajectory.grown(
        compressed.trajectory.times, compressed.trajectory.orders, -compressed.trajectory.coefficients
    )
    assert compressed.distance == pytest.approx(norm(difference), rel=1e-3, abs=1e-7)


def test_the_norm_is_the_gram_matrixs() -> None:
    trajectory = replace(grown(condition(Gaussian(0.4)), 5), joint=np.eye(4))
    expected = np.trace(trajectory.coefficients.T @ support_gram(trajectory) @ trajectory.coefficients)
    assert norm(trajectory) ** 2 == pytest.approx(expected)
