"""Filters learned anew from a policy's steps: a state's width is what was asked for."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from predplan.control.environments import EnvironmentSettings
from predplan.control.filtering import filter_trajectories
from predplan.control.innovation import InnovationSettings
from predplan.control.methods import METHODS, FilterSettings
from predplan.control.refitting import learn_filter, widened
from predplan.control.training import Schedule, Training
from tests.control.systems import exact_filter, example, simulate


def test_a_wider_state_foretells_the_same() -> None:
    model, data = exact_filter(example()), simulate(example(), 20, 15, np.random.default_rng(0), 0.3)
    narrow, wide = (filter_trajectories(one, data) for one in (model, widened(model, model.state_size + 4)))
    np.testing.assert_allclose(wide.prediction, narrow.prediction, atol=1e-12)
    np.testing.assert_allclose(wide.after[:, : model.state_size], narrow.after, atol=1e-12)
    assert not wide.after[:, model.state_size :].any()
    assert widened(model, model.state_size) is model


def test_a_basis_of_fewer_numbers_is_widened() -> None:
    data = simulate(example(), 100, 30, np.random.default_rng(1))
    settings = InnovationSettings(past=5, future=2, dimension=11)  # two futures of two numbers give four
    model, known = learn_filter(data, settings, None, 5)
    again, _ = learn_filter(data, settings, known, 5)
    assert (model.state_size, again.state_size) == (11, 11)
    assert not model.A[4:].any()


@pytest.mark.parametrize("method", ["rpsp", "rpsp-obs", "rpsp-vrpg", "rpsp-alt", "rpsp-random"])
def test_policies_are_learned_on_states_wider_than_what_is_foretold(method: str) -> None:
    wide = replace(METHODS[method], filter=replace(METHODS[method].filter or FilterSettings(), dimension=14))
    task = EnvironmentSettings("cartpole", noise=0.1, threads=1)
    training = Training(task, wide, Schedule(1500, 8, 32), 0)
    with training.environments:
        rows = [training.advance() for _ in range(5)]
    assert training.learner.model is not None
    assert training.learner.model.state_size == 14
    assert all(np.isfinite(one.policy_kl) and one.skipped == 0 for one in rows)
