import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from predplan.planning.kernels import (
    BSpline,
    Derivative,
    Gaussian,
    Kernel,
    Laplacian,
    Product,
    Scaled,
    Sum,
    Waypoints,
    condition,
    diagonal,
    joint_interaction,
    normalise,
    with_derivative,
)
from predplan.planning.tension import Tension

SMOOTH: dict[str, Kernel] = {
    "gaussian": Gaussian(0.3),
    "gaussian wide": Gaussian(0.9),
    "b-spline 5": BSpline(0.3, degree=5),
    "velocities": Derivative(Gaussian(0.4)),
    "with derivative": with_derivative(Gaussian(0.4), 0.4),
    "sum": Sum((Gaussian(0.2), Scaled(Gaussian(0.7), 2.0))),
    "product": Product(Gaussian(0.3), Gaussian(0.5)),
    "conditioned": condition(Gaussian(0.3)),
    "at rest": condition(Gaussian(0.3), end_velocities=True),
    "normalised": normalise(condition(Gaussian(0.3))),
}
KERNELS: dict[str, Kernel] = SMOOTH | {
    "tension": Tension(0.12),
    "laplacian": Laplacian(0.3),
    "b-spline 3": BSpline(0.2),
    "waypoints, velocity": Waypoints(20, "velocity"),
    "waypoints, acceleration": Waypoints(20, "acceleration"),
    "conditioned laplacian": condition(Laplacian(0.9)),
    "conditioned waypoints": condition(Waypoints(20, "velocity")),
}
times = st.lists(st.floats(0.0, 1.0), min_size=1, max_size=12).map(np.array)


@pytest.mark.parametrize("name", KERNELS)
@settings(max_examples=30, deadline=None)
@given(s=times, t=times)
def test_gram_matrices_are_symmetric_and_positive_semi_definite(name: str, s: np.ndarray, t: np.ndarray) -> None:
    kernel = KERNELS[name]
    np.testing.assert_allclose(kernel.gram(s, t), kernel.gram(t, s).T, atol=1e-9)
    gram = kernel.gram(s, s)
    assert np.linalg.eigvalsh(gram).min() >= -1e-9 * max(1.0, np.abs(gram).max())


@pytest.mark.parametrize("name", SMOOTH)
def test_derivatives_by_finite_differences(name: str) -> None:
    kernel = SMOOTH[name]
    s, t, h = np.linspace(0.05, 0.95, 7), np.linspace(0.1, 0.9, 5), 1e-5
    for s_order, t_order in [(0, 0), (1, 0), (0, 1)]:
        by_s = (kernel.gram(s + h, t, s_order, t_order) - kernel.gram(s - h, t, s_order, t_order)) / (2 * h)
        by_t = (kernel.gram(s, t + h, s_order, t_order) - kernel.gram(s, t - h, s_order, t_order)) / (2 * h)
        scale = max(1.0, np.abs(by_s).max())
        np.testing.assert_allclose(kernel.gram(s, t, s_order + 1, t_order) / scale, by_s / scale, atol=1e-6)
        np.testing.assert_allclose(kernel.gram(s, t, s_order, t_order + 1) / scale, by_t / scale, atol=1e-6)


def test_the_laplacian_has_derivatives_away_from_the_support() -> None:
    s, t, h = np.array([0.3]), np.array([0.6]), 1e-6
    for orders in [(1, 0), (0, 1)]:
        step_s, step_t = h * orders[0], h * orders[1]
        kernel = Laplacian(0.2)
        difference = (kernel.gram(s + step_s, t + step_t) - kernel.gram(s - step_s, t - step_t)) / (2 * h)
        np.testing.assert_allclose(kernel.gram(s, t, *orders), difference, rtol=1e-6)


def test_waypoints_have_the_velocity_metrics_inverse_at_their_own_times() -> None:
    kernel = Waypoints(9, "velocity")
    at = np.arange(1, 10) / 10
    brownian_bridge = np.minimum.outer(at, at) - np.multiply.outer(at, at)
    np.testing.assert_allclose(kernel.gram(at, at), 10 * brownian_bridge, atol=1e-12)
    np.testing.assert_allclose(kernel.gram(at, at), kernel.inverse_metric, atol=1e-12)


@pytest.mark.parametrize("name", ["gaussian", "laplacian", "b-spline 3", "velocities", "waypoints, velocity"])
def test_conditioned_kernels_vanish_at_both_ends(name: str) -> None:
    kernel = condition(KERNELS[name])
    inner = np.linspace(0.0, 1.0, 21)
    assert (
        np.abs(kernel.gram(np.array([0.0, 1.0]), inner)).max() < 1e-12 * np.abs(KERNELS[name].gram(inner, inner)).max()
    )


def test_conditioning_on_end_velocities() -> None:
    kernel = condition(Gaussian(0.3), end_velocities=True)
    inner = np.linspace(0.0, 1.0, 21)
    ends = np.array([0.0, 1.0])
    assert np.abs(kernel.gram(ends, inner)).max() < 1e-10
    assert np.abs(kernel.gram(ends, inner, 1)).max() < 1e-9
    with pytest.raises(ValueError, match="no derivative"):
        condition(Laplacian(0.3), end_velocities=True)


@pytest.mark.parametrize("name", KERNELS)
def test_normalised_kernels_have_a_largest_variance_of_one(name: str) -> None:
    assert diagonal(normalise(KERNELS[name]), np.linspace(0, 1, 513)).max() == pytest.approx(1.0)


def test_joint_interaction_has_full_rank_and_trace_of_the_joints() -> None:
    jacobian = np.random.default_rng(0).standard_normal((3, 7))
    metric = joint_interaction([jacobian], 0.1)
    assert np.linalg.eigvalsh(metric).min() > 0.0
    assert np.trace(metric) == pytest.approx(7.0)
