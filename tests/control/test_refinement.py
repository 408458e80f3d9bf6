from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
import torch

from predplan.control.coordinates import Coordinates
from predplan.control.descent import DescentSettings, descend
from predplan.control.filtering import filter_trajectories
from predplan.control.innovation import InnovationSettings, fit_innovation
from predplan.control.linear_filter import LinearFilter, gains, radius
from predplan.control.refinement import RefinementSettings, fit_refined, hold_out, refine
from predplan.control.trajectories import Trajectories
from predplan.errors import InputError
from tests.control.systems import exact_filter, example, kalman_predictions, simulate

INNOVATION = InnovationSettings(past=4, future=4, dimension=3)
SETTINGS = RefinementSettings(epochs=30)


def excess(model: LinearFilter, drop: float) -> float:
    """Mean square difference of its predictions and exact ones, over that of exact ones and what was observed."""
    held_out = simulate(example(), 100, 50, np.random.default_rng(1000), drop)
    exact = kalman_predictions(example(), held_out)
    learned = filter_trajectories(model, held_out).prediction
    return float(np.mean((learned - exact) ** 2) / np.nanmean((held_out.observation - exact) ** 2))


@pytest.mark.parametrize("drop", [0.0, 0.3])
def test_refinement_comes_nearer_to_the_kalman_filter(drop: float) -> None:
    """A past of 4 rows is too short for regression: what is left of its error falls by half or more."""
    data = simulate(example(), 200, 50, np.random.default_rng(0), drop)
    started = excess(fit_innovation(data, INNOVATION), drop)
    found = fit_refined(data, INNOVATION, SETTINGS, np.random.default_rng(1))
    refined = excess(found.model, drop)
    assert refined < 0.5 * started
    assert refined < 0.01
    assert found.curve[found.best].validation < 1.0
    assert radius(found.model) < 1.0


def moved_from_exact(share: float) -> LinearFilter:
    model = exact_filter(example())
    return replace(model, A=model.A * (1 - share), K=model.K * (1 + 5 * share), initial_covariance=0.1 * np.eye(3))


def test_long_trajectories_are_refined_in_pieces() -> None:
    data = simulate(example(), 30, 90, np.random.default_rng(2))
    start = moved_from_exact(0.1)
    for rows in (20, 1000):
        found = refine(start, data, replace(SETTINGS, rows=rows), np.random.default_rng(3))
        assert excess(found.model, 0.0) < 0.1 * excess(start, 0.0), rows


def test_never_worse_on_what_is_held_out() -> None:
    """Six trajectories are too few to learn from: what is returned is the epoch that is best, were it the start."""
    few = simulate(example(), 6, 15, np.random.default_rng(4))
    _, held_out = hold_out(few, 0.5, np.random.default_rng(5))
    for model in (exact_filter(example()), moved_from_exact(0.05)):
        found = refine(model, few, replace(SETTINGS, share=0.5), np.random.default_rng(5))
        assert found.curve[found.best].validation == min(epoch.validation for epoch in found.curve) <= 1.0
        assert [epoch.epoch for epoch in found.curve] == list(range(len(found.curve)))
        assert len(found.curve) - 1 - found.best <= SETTINGS.patience
        error = [
            float(np.mean((filter_trajectories(one, held_out).prediction - held_out.observation) ** 2))
            for one in (found.model, model)
        ]
        assert error[0] < 1.02 * error[1]


def test_training_never_rises_and_same_seed_gives_same_bytes() -> None:
    data = simulate(example(), 40, 20, np.random.default_rng(6), 0.2)
    first = fit_refined(data, INNOVATION, SETTINGS, np.random.default_rng(7))
    second = fit_refined(data, INNOVATION, SETTINGS, np.random.default_rng(7))
    for one, other in zip(first.model.arrays(), second.model.arrays(), strict=True):
        assert one.tobytes() == other.tobytes()
    training = [epoch.training for epoch in first.curve]
    assert all(later <= earlier for earlier, later in pairwise(training))


def test_covariances_have_the_size_of_innovations_and_gains_stay() -> None:
    data = simulate(example(), 200, 40, np.random.default_rng(8))
    exact = replace(exact_filter(example()), initial_covariance=0.1 * np.eye(3))
    wrong = replace(exact, S=7.0 * exact.S, initial_covariance=7.0 * exact.initial_covariance)
    found = refine(wrong, data, replace(SETTINGS, epochs=0), np.random.default_rng(9)).model
    np.testing.assert_allclose(found.S, exact.S, rtol=0.05)
    np.testing.assert_allclose(gains(found, data), gains(exact, data), atol=1e-9)


def test_a_filter_that_would_not_forget_is_not_returned() -> None:
    """Its trajectories are too short to tell; every step that would lead there is rejected and counted."""
    short = simulate(example(), 60, 6, np.random.default_rng(10))
    start = replace(moved_from_exact(0.0), K=exact_filter(example()).K * 0.05)
    found = refine(start, short, replace(SETTINGS, epochs=60), np.random.default_rng(11))
    assert radius(found.model) < 1.0
    assert found.rejected == sum(epoch.rejected for epoch in found.curve)


def test_numbers_that_are_not_finite_end_nothing() -> None:
    data = simulate(example(), 20, 20, np.random.default_rng(12))
    huge = data.with_observation(np.where(np.arange(len(data.observation))[:, None] == 37, 1e200, data.observation))
    found = refine(exact_filter(example()), huge, SETTINGS, np.random.default_rng(13))
    assert all(np.isfinite(one).all() for one in found.model.arrays())


def test_coordinates_start_at_the_filter_and_have_its_derivatives() -> None:
    model = replace(moved_from_exact(0.02), c=np.full(3, 0.1))
    coordinates = Coordinates(model)
    origin = torch.zeros(coordinates.size, dtype=torch.float64)
    for name, values in coordinates.parameters(origin).items():
        np.testing.assert_allclose(values.numpy(), getattr(model, name), atol=1e-12)
    point = 0.01 * torch.from_numpy(np.random.default_rng(14).standard_normal(coordinates.size))
    found = coordinates.parameters(point)
    # A change of C alone leaves q' = (A - K C) q + K o as it was.
    only = torch.zeros_like(point)
    place = sum(getattr(model, name).size for name in ("A", "B", "c", "K"))
    only[place : place + model.C.size] = 0.3
    moved = coordinates.model(only)
    np.testing.assert_allclose(moved.A - moved.K @ moved.C, model.A - model.K @ model.C, atol=1e-12)
    assert np.abs(moved.C - model.C).max() > 0.01
    assert np.linalg.eigvalsh(found["S"].numpy()).min() > 0.0


def test_descent_finds_the_least_of_a_narrow_valley_and_respects_its_edge() -> None:
    def banana(point: torch.Tensor) -> tuple[float, torch.Tensor] | None:
        if float(point[0]) > 0.9:
            return None
        point = point.clone().requires_grad_()
        value = 100.0 * (point[1] - point[0] ** 2) ** 2 + (1.0 - point[0]) ** 2
        return float(value.detach()), torch.autograd.grad(value, point)[0]

    steps = list(zip(range(200), descend(banana, torch.tensor([-1.2, 1.0]).double(), DescentSettings()), strict=False))
    last = steps[-1][1]
    assert 0.85 < float(last.point[0]) <= 0.9
    assert sum(step.undefined for _, step in steps) > 0
    values = [step.value for _, step in steps]
    assert values == sorted(values, reverse=True)


def test_what_cannot_be_refined_is_said() -> None:
    data = simulate(example(), 3, 10, np.random.default_rng(15))
    alone = data.take(np.array([0]))
    with pytest.raises(InputError, match="trajectories: found 1, expected at least 2"):
        refine(exact_filter(example()), alone, SETTINGS, np.random.default_rng(16))


def test_what_is_held_out_is_the_rest() -> None:
    data = simulate(example(), 10, 7, np.random.default_rng(17))
    training, held_out = hold_out(data, 0.2, np.random.default_rng(18))
    assert len(training.lengths) == 8
    assert len(held_out.lengths) == 2

    def rows(part: Trajectories) -> set[float]:
        return set(part.observation[:, 0].tolist())

    assert rows(training) | rows(held_out) == rows(data)
    assert not rows(training) & rows(held_out)
