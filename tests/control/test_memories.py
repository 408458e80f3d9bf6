from dataclasses import replace

import numpy as np
import pytest

from predplan.control.filtering import filter_trajectories
from predplan.control.linear_filter import LinearFilter
from predplan.control.memories import (
    Memory,
    Predictive,
    Window,
    predictive_features,
    under,
    window_features,
)
from predplan.control.trajectories import Trajectories
from tests.control.learners import uneven
from tests.control.systems import exact_filter, example, simulate

CENTRE = np.array([0.3, -0.2])
LENGTHS = [1, 9, 4, 12, 2, 7]


def unsure_filter() -> LinearFilter:
    """Of the example system; its state is unknown at the start."""
    return replace(exact_filter(example()), initial_covariance=np.eye(3))


def lossy() -> Trajectories:
    """Of several lengths, a third of the observations missing, one at a start."""
    data = uneven(simulate(example(), 6, 12, np.random.default_rng(0), 0.35), LENGTHS)
    observation = data.observation.copy()
    observation[data.first[1]] = np.nan
    return data.with_observation(observation)


def stepped(memory: Memory, data: Trajectories) -> np.ndarray:
    """Features after each row, the memory stepped side by side over all trajectories."""
    found = np.full((len(data.observation), memory.size), np.nan)
    first, lengths = data.first[:-1], data.lengths
    memory.begin(np.arange(len(lengths)), data.observation[first])
    for step in range(int(lengths.max())):
        rows = first + np.minimum(step, lengths - 1)
        if step:
            memory.observe(data.action[rows], data.observation[rows])
        there = lengths > step
        found[rows[there]] = memory.features()[there]
    return found


@pytest.mark.parametrize("length", [1, 2, 5])
def test_window_features_are_those_of_a_window_that_is_stepped(length: int) -> None:
    data = lossy()
    expected = stepped(Window(6, length, CENTRE, 1), data)
    np.testing.assert_array_equal(window_features(data, length, CENTRE), expected)


@pytest.mark.parametrize("length", [0, 2])
def test_predictive_features_are_those_of_a_filter_that_is_stepped(length: int) -> None:
    data, model = lossy(), unsure_filter()
    memory = Predictive(6, model, 1, Window(6, length, CENTRE, 1) if length else None)
    found = predictive_features(filter_trajectories(model, data), data, length, CENTRE)
    np.testing.assert_allclose(found, stepped(memory, data), rtol=0, atol=1e-12)


def test_a_window_tells_what_was_seen_and_done() -> None:
    window = Window(1, 2, CENTRE, 1)
    window.begin(np.array([0]), np.full((1, 2), np.nan))
    np.testing.assert_array_equal(window.features(), [[0.3, -0.2, 0.0, 0.0] * 2])
    window.observe(np.array([[0.5]]), np.array([[1.0, 2.0]]))
    np.testing.assert_array_equal(window.features(), [[0.3, -0.2, 0.0, 0.0, 1.0, 2.0, 1.0, 0.5]])
    window.observe(np.array([[-1.0]]), np.array([[np.nan, 3.0]]))  # half lost is lost
    np.testing.assert_array_equal(window.features(), [[1.0, 2.0, 1.0, 0.5, 1.0, 2.0, 0.0, -1.0]])
    assert np.isnan(window.predict(np.zeros((1, 1)))).all()


@pytest.mark.parametrize("kind", ["window", "predictive", "both"])
def test_beginning_some_leaves_the_others(kind: str) -> None:
    memory = made(kind)
    advance(memory, 4)
    before = memory.features()
    memory.begin(np.array([1]), np.zeros((1, 2)))
    after = memory.features()
    np.testing.assert_array_equal(after[[0, 2]], before[[0, 2]])
    assert not np.array_equal(after[1], before[1])


@pytest.mark.parametrize("kind", ["window", "predictive", "both"])
def test_what_is_put_away_goes_on_the_same(kind: str) -> None:
    memory, other = made(kind), made(kind)
    advance(memory, 5)
    other.restore({name: one.copy() for name, one in memory.arrays().items()})
    for one in (memory, other):
        advance(one, 3)
    np.testing.assert_array_equal(memory.features(), other.features())
    action = np.ones((3, 1))
    np.testing.assert_array_equal(memory.predict(action), other.predict(action))


def test_features_do_not_change_afterwards() -> None:
    for kind in ("window", "predictive", "both"):
        memory = made(kind)
        advance(memory, 2)
        kept = memory.features()
        copy = kept.copy()
        advance(memory, 2)
        np.testing.assert_array_equal(kept, copy)


def test_skipped_steps_of_ended_episodes_still_count() -> None:
    memory = Predictive(2, unsure_filter(), 1)
    memory.begin(np.arange(2), np.zeros((2, 2)))
    memory.observe(np.array([[np.nan], [0.0]]), np.zeros((2, 2)))
    assert np.isfinite(memory.features()).all()
    np.testing.assert_array_equal(memory.state.skipped, [1, 0])
    memory.begin(np.array([0]), np.zeros((1, 2)))
    np.testing.assert_array_equal(memory.state.skipped, [1, 0])


def test_arrays_under_a_name_are_its_own() -> None:
    one, two = np.zeros(1), np.ones(1)
    assert under({"a.b": one, "ab.c": two, "a.c.d": two}, "a") == {"b": one, "c.d": two}


def made(kind: str) -> Memory:
    window = Window(3, 2, CENTRE, 1) if kind != "predictive" else None
    memory: Memory = Predictive(3, unsure_filter(), 1, window)
    if kind == "window":
        assert window is not None
        memory = window
    memory.begin(np.arange(3), np.ones((3, 2)))
    return memory


def advance(memory: Memory, steps: int) -> None:
    generator = np.random.default_rng(1)
    for _ in range(steps):
        memory.observe(generator.standard_normal((3, 1)), generator.standard_normal((3, 2)))
