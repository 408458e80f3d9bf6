from dataclasses import replace

import numpy as np
import pytest
import torch

from predplan.control.differentiable import LEARNED, DifferentiableFilter
from predplan.control.filtering import filter_trajectories
from predplan.control.linear_filter import LinearFilter, gains
from predplan.control.trajectories import Trajectories
from tests.control.systems import exact_filter, example, simulate

ROWS, COPIES = 25, 6


def rich_model(limit: float = 1e6) -> LinearFilter:
    """All parameters at work, units of their own."""
    return replace(
        exact_filter(example()), limit=limit, initial_covariance=np.eye(3), initial_mean=np.array([1.0, 0.0, 0.5]),
        c=np.array([0.1, 0.0, -0.2]), d=np.array([0.05, 0.1]), shift=np.array([0.3, -2.0]), scale=np.array([2.0, 0.1]),
    )  # fmt: skip


def rich_data(drop: float, seed: int = 0) -> Trajectories:
    data = simulate(example(), COPIES, ROWS, np.random.default_rng(seed), drop)
    return data.with_observation(data.observation * rich_model().scale + rich_model().shift)


def side_by_side(values: np.ndarray) -> torch.Tensor:
    """[n T, ...] of trajectories of one length -> [T, n, ...]."""
    return torch.from_numpy(np.ascontiguousarray(np.moveaxis(values.reshape(COPIES, ROWS, *values.shape[1:]), 0, 1)))


def inputs(model: LinearFilter, data: Trajectories) -> list[torch.Tensor]:
    start = torch.from_numpy(model.initial(COPIES).mean)
    parts = (data.action, data.observation, gains(model, data), data.age == 0)
    return [start, *(side_by_side(one) for one in parts)]


@pytest.mark.parametrize("drop", [0.0, 0.3, 0.9])
@pytest.mark.parametrize("limit", [1e6, 1.5])
def test_equals_the_compiled_filter(drop: float, limit: float) -> None:
    model, data = rich_model(limit), rich_data(drop)
    filtered = filter_trajectories(model, data)
    found = DifferentiableFilter(model)(*inputs(model, data))
    for one, expected in zip(found, (filtered.state, filtered.after, filtered.prediction), strict=True):
        np.testing.assert_allclose(one.detach().numpy(), side_by_side(expected).numpy(), atol=1e-11)


def test_a_reset_starts_anew_and_a_start_goes_on() -> None:
    """Trajectories one after the other in one long row, cut in two anywhere."""
    model, data = rich_model(), rich_data(0.2)
    expected = filter_trajectories(model, data)
    module, gain = DifferentiableFilter(model), gains(model, data)

    def part(begin: int, end: int, start: np.ndarray) -> np.ndarray:
        rows = slice(begin, end)
        given = (data.action[rows], data.observation[rows], gain[rows], (data.age == 0)[rows])
        tensors = (torch.from_numpy(np.ascontiguousarray(one))[:, None] for one in given)
        return np.asarray(module(torch.from_numpy(start)[None], *tensors)[1][:, 0].detach().numpy())

    first = part(0, 40, np.full(3, np.nan))
    np.testing.assert_allclose(first, expected.after[:40], atol=1e-12)
    np.testing.assert_allclose(part(40, len(gain), first[-1]), expected.after[40:], atol=1e-12)


@pytest.mark.parametrize("limit", [1e6, 1.5])
def test_gradients_are_those_of_finite_differences(limit: float) -> None:
    model, data = rich_model(limit), rich_data(0.3)
    start, action, observation, gain, reset = inputs(model, data)
    reset[10, ::2] = True
    reset[0, 1] = False
    module, weights = DifferentiableFilter(model), np.random.default_rng(1)
    outer = [torch.from_numpy(weights.standard_normal((ROWS, COPIES, k))) for k in (3, 3, 2)]
    seen = torch.isfinite(observation).all(dim=2)[..., None, None]
    steady: torch.Tensor = module.get_parameter("K").detach().clone()

    def loss() -> torch.Tensor:
        moved = gain + seen * (module.get_parameter("K").detach() - steady)
        found = module(start, action, observation, moved, reset)
        return torch.stack([(weight * torch.sin(one)).sum() for weight, one in zip(outer, found, strict=True)]).sum()

    start.requires_grad_(True)
    torch.autograd.backward(loss())
    for name in (*LEARNED, "start"):
        values = start if name == "start" else module.get_parameter(name)
        assert values.grad is not None
        gradient = values.grad.numpy().copy()
        with torch.no_grad():
            for index in np.ndindex(*gradient.shape):
                kept = values[index].item()
                ends = []
                for step in (1e-6, -1e-6):
                    values[index] = kept + step
                    ends.append(loss().item())
                values[index] = kept
                assert (ends[0] - ends[1]) / 2e-6 == pytest.approx(gradient[index], rel=2e-5, abs=2e-6), name


def test_parameters_come_back() -> None:
    model = rich_model()
    module = DifferentiableFilter(model)
    same = module.to_model(model)
    for name in (*LEARNED, "S", "initial_covariance", "shift", "scale"):
        np.testing.assert_array_equal(getattr(same, name), getattr(model, name))
    with torch.no_grad():
        module.get_parameter("A").mul_(0.5)
    np.testing.assert_array_equal(module.to_model(model).A, 0.5 * model.A)
    np.testing.assert_array_equal(same.A, model.A)
