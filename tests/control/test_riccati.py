from dataclasses import replace

import numpy as np
import pytest
import torch

from predplan.control.linear_filter import gains
from predplan.control.riccati import differentiable_gains
from tests.control.systems import exact_filter, example, simulate

NAMES = ("A", "K", "C", "S", "initial_covariance")


@pytest.mark.parametrize("drop", [0.0, 0.3])
def test_gains_are_the_compiled_filters(drop: float) -> None:
    model = replace(exact_filter(example()), initial_covariance=np.diag([0.5, 1.0, 2.0]))
    data = simulate(example(), 5, 30, np.random.default_rng(0), drop)
    A, K, C, S, P = (torch.from_numpy(getattr(model, name)) for name in NAMES)
    K_t, S_t = differentiable_gains(A, K, C, S, P, data.seen.reshape(5, 30))
    np.testing.assert_allclose(K_t.numpy().reshape(150, 3, 2), gains(model, data), atol=1e-9)
    np.testing.assert_allclose(S_t[:, 0], np.tile(model.C @ model.initial_covariance @ model.C.T + model.S, (5, 1, 1)))


def test_gradients_are_those_of_finite_differences() -> None:
    generator = np.random.default_rng(1)
    model = replace(exact_filter(example()), initial_covariance=np.diag([0.5, 1.0, 2.0]))
    values = [torch.from_numpy(np.array(getattr(model, name))).requires_grad_() for name in NAMES]
    seen = generator.random((3, 7)) < 0.6
    by_gain, by_total = (torch.from_numpy(generator.standard_normal((3, 7, k, 2))) for k in (3, 2))

    def loss() -> torch.Tensor:
        # Covariances are symmetric: so must be the steps away from them.
        A, K, C, S, P = values
        K_t, S_t = differentiable_gains(A, K, C, 0.5 * (S + S.T), 0.5 * (P + P.T), seen)
        return (by_gain * torch.sin(K_t)).sum() + (by_total * torch.cos(S_t)).sum()

    torch.autograd.backward(loss())
    for name, one in zip(NAMES, values, strict=True):
        assert one.grad is not None
        gradient = one.grad.numpy().copy()
        with torch.no_grad():
            for index in np.ndindex(*gradient.shape):
                kept = one[index].item()
                ends = []
                for step in (1e-6, -1e-6):
                    one[index] = kept + step
                    ends.append(loss().item())
                one[index] = kept
                assert (ends[0] - ends[1]) / 2e-6 == pytest.approx(gradient[index], rel=1e-5, abs=1e-6), name
