"""Time parametrisation: limits kept between all samples, times known in closed form, and the path itself unchanged."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from predplan.planning import timing
from predplan.planning.paths import Path, polyline, quintic
from predplan.planning.robots import FloatArray, planar_arm
from predplan.planning.timing import Timing, parametrise, trajectory
from tests.planning.paths import random_path

ARM = planar_arm([0.5, 0.4, 0.3])
SEEDS = st.integers(0, 2**32 - 1)


def rest_to_rest(start: FloatArray, goal: FloatArray) -> Path:
    """The straight line as one quintic piece of constant speed."""
    values = np.stack([start, goal])
    return quintic(np.array([0.0, 1.0]), values, np.stack([goal - start] * 2), np.zeros_like(values))


@settings(max_examples=25, deadline=None)
@given(SEEDS)
def test_limits_hold_between_all_samples(seed: int) -> None:
    generator = np.random.default_rng(seed)
    path = random_path(ARM, generator, pieces=int(generator.integers(1, 9)))
    velocity, acceleration = generator.uniform(0.5, 3, 3), generator.uniform(1, 20, 3)
    timed = parametrise(path, velocity, acceleration)
    t = np.sort(np.concatenate([np.linspace(0, timed.duration, 5001), timed.times, timed.times[1:] - 1e-12]))
    assert np.max(np.abs(trajectory(path, timed, t, 1)) / velocity) <= 1.0 + 1e-9
    assert np.max(np.abs(trajectory(path, timed, t, 2)) / acceleration) <= 1.0 + 1e-9
    ends = trajectory(path, timed, np.array([0.0, timed.duration]))
    np.testing.assert_allclose(ends, path(np.array([0.0, 1.0])), atol=1e-12)
    np.testing.assert_allclose(trajectory(path, timed, np.array([0.0, timed.duration]), 1), 0.0, atol=1e-6)


@settings(max_examples=15, deadline=None)
@given(SEEDS)
def test_velocities_and_accelerations_are_derivatives_by_time(seed: int) -> None:
    generator = np.random.default_rng(seed)
    path = random_path(ARM, generator)
    timed = parametrise(path, np.full(3, 2.0), np.full(3, 10.0))
    inside = timed.times[:-1] + np.diff(timed.times) * generator.uniform(0.1, 0.9, len(timed.times) - 1)
    h = 1e-6 * timed.duration
    for order in (0, 1):
        later, earlier = (trajectory(path, timed, inside + side * h, order) for side in (1, -1))
        slope = (later - earlier) / (2 * h)
        expected = trajectory(path, timed, inside, order + 1)
        np.testing.assert_allclose(slope, expected, atol=2e-3 * np.abs(expected).max())


@settings(max_examples=15, deadline=None)
@given(SEEDS)
def test_the_timed_trajectory_runs_along_the_path_forwards(seed: int) -> None:
    path = random_path(ARM, np.random.default_rng(seed))
    timed = parametrise(path, np.full(3, 2.0), np.full(3, 10.0))
    s, speed, _ = timed.at(np.linspace(-0.1, timed.duration + 0.1, 1001))
    assert np.all(np.diff(s) >= -1e-12)
    assert (s[0], s[-1]) == (0.0, pytest.approx(1.0, abs=1e-12))
    assert np.all(speed >= -1e-9)


@pytest.mark.parametrize(
    ("distance", "expected"),
    [
        (0.2, 2 * np.sqrt(0.2 / 10.0)),  # never reaches its velocity
        (3.0, 3.0 / 2.0 + 2.0 / 10.0),  # accelerates, cruises, brakes
    ],
)
def test_straight_motions_take_the_least_time_there_is(distance: float, expected: float) -> None:
    path = rest_to_rest(np.zeros(3), np.array([distance, -distance / 2, 0.0]))
    assert parametrise(path, np.full(3, 2.0), np.full(3, 10.0)).duration == pytest.approx(expected, rel=0.02)


@pytest.mark.parametrize("seed", range(4))
def test_on_fine_grids_the_published_library_takes_as_long(seed: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """TOPPRA keeps the limits at its grid's points alone."""
    pytest.importorskip("toppra")
    from toppra import algorithm, constraint
    from toppra.interpolator import AbstractGeometricPath

    path = random_path(ARM, np.random.default_rng(seed), pieces=6, share=0.3)
    velocity, acceleration = np.array([2.0, 1.5, 2.5]), np.array([10.0, 7.0, 15.0])

    class Geometric(AbstractGeometricPath):  # type: ignore[misc]
        path_interval = np.array([0.0, 1.0])
        dof = 3

        def __call__(self, s: FloatArray, order: int = 0) -> FloatArray:
            return path(np.atleast_1d(s), order) if np.ndim(s) else path(np.atleast_1d(s), order)[0]

    limits = [
        constraint.JointVelocityConstraint(np.stack([-velocity, velocity], axis=1)),
        constraint.JointAccelerationConstraint(
            np.stack([-acceleration, acceleration], axis=1),
            discretization_scheme=constraint.DiscretizationType.Interpolation,
        ),
    ]
    grid = np.linspace(0, 1, 601)
    theirs = algorithm.TOPPRA(limits, Geometric(), gridpoints=grid, solver_wrapper="seidel")
    speed = theirs.compute_parameterization(0.0, 0.0)[1]
    duration = np.sum(2 * np.diff(grid) / (speed[1:] + speed[:-1]))
    monkeypatch.setattr(timing, "GRID", 1024)
    assert parametrise(path, velocity, acceleration).duration == pytest.approx(duration, rel=0.01)


def test_twice_the_velocity_and_four_times_the_acceleration_take_half_the_time() -> None:
    path = random_path(ARM, np.random.default_rng(4))
    slow, fast = (parametrise(path, np.full(3, 1.0 * k), np.full(3, 5.0 * k * k)).duration for k in (1, 2))
    assert slow == pytest.approx(2 * fast, rel=1e-3)


def test_a_path_with_corners_stops_at_each() -> None:
    points = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 1.0, 0.5], [0.0, 1.0, 0.0]])
    path = polyline(points)
    timed = parametrise(path, np.full(3, 2.0), np.full(3, 10.0))
    whole = [parametrise(polyline(pair), np.full(3, 2.0), np.full(3, 10.0)) for pair in (points[:2], points[1:3])]
    corners = np.searchsorted(timed.s, path.breaks - 1e-12)
    np.testing.assert_allclose(timed.speed[corners], 0.0, atol=1e-9)
    np.testing.assert_allclose(timed.times[corners[1]], whole[0].duration, rtol=1e-3)
    np.testing.assert_allclose(timed.times[corners[2]], whole[0].duration + whole[1].duration, rtol=1e-3)
    t = np.linspace(0, timed.duration, 5001)
    assert np.abs(trajectory(path, timed, t, 2)).max() <= 10.0 + 1e-6
    for point, at in zip(points, timed.times[corners], strict=True):
        np.testing.assert_allclose(trajectory(path, timed, np.array([at]))[0], point, atol=1e-9)


def test_standing_still_takes_no_time() -> None:
    path = polyline(np.array([[1.0, 2.0]]))
    timed = parametrise(path, np.ones(2), np.ones(2))
    assert timed.duration == 0.0
    np.testing.assert_array_equal(trajectory(path, timed, np.array([0.0, 1.0])), [[1.0, 2.0]] * 2)
    np.testing.assert_array_equal(trajectory(path, timed, np.array([0.0]), 1), [[0.0, 0.0]])


def test_a_timing_kept_as_numbers_is_the_same_timing() -> None:
    path = random_path(ARM, np.random.default_rng(5))
    timed = parametrise(path, np.full(3, 2.0), np.full(3, 10.0))
    again = Timing(*(np.array(part.tolist()) for part in (timed.times, timed.s, timed.speed)))
    t = np.linspace(0, timed.duration, 100)
    np.testing.assert_array_equal(trajectory(path, again, t), trajectory(path, timed, t))
