from dataclasses import replace

import numpy as np
import pytest

from predplan.control.environments import EnvironmentSettings
from predplan.control.filtering import filter_trajectories
from predplan.control.memories import predictive_features
from predplan.control.pool import Pool
from predplan.control.sampling import Batch, Sampler
from predplan.control.trajectories import Trajectories
from predplan.control.whitening import no_whitening
from tests.control.learners import CARTPOLE, SWIMMER, learned_filter, sampler, seeing_network

COPIES = 3
LOSSY = replace(CARTPOLE, noise=0.1, drop=0.2)
Row = tuple[np.ndarray, np.ndarray, float, bool, bool]


def batches(made: Sampler, lengths: list[int]) -> list[Batch]:
    network = seeing_network(made.memory.size, made.environments.action_size)
    generator, white = np.random.default_rng(2), no_whitening(made.memory.size)
    return [made.collect(network, white, length, generator)[0] for length in lengths]


def told(every: list[Batch]) -> list[list[list[Row]]]:
    """Episodes of each copy, row by row, as they happened."""
    actions = every[0].action.shape[2]
    copies: list[list[list[Row]]] = [[] for _ in range(COPIES)]
    for batch in every:
        for t in range(len(batch.reward)):
            for copy, episodes in enumerate(copies):
                if batch.begins[t, copy]:
                    episodes.append([(batch.observation[t, copy], np.zeros(actions), 0.0, False, False)])
                ends = bool(batch.terminated[t, copy]), bool(batch.truncated[t, copy])
                episodes[-1].append((batch.after[t, copy], batch.action[t, copy], batch.reward[t, copy], *ends))
    return copies


def assert_equal(found: Trajectories, episodes: list[list[Row]]) -> None:
    np.testing.assert_array_equal(found.lengths, [len(one) for one in episodes])
    columns = [np.array(column) for column in zip(*[row for one in episodes for row in one], strict=True)]
    names = ("observation", "action", "reward", "terminated", "truncated")
    for name, column in zip(names, columns, strict=True):
        np.testing.assert_array_equal(getattr(found, name), column)


@pytest.mark.parametrize("settings", [CARTPOLE, LOSSY, SWIMMER])
def test_all_steps_are_there_as_they_were_made(settings: EnvironmentSettings) -> None:
    pool, every = Pool(COPIES, 100_000), batches(sampler(settings, COPIES), [1, 7, 20, 30])
    for n, batch in enumerate(every, 1):
        pool.add(batch)
        copies = told(every[:n])
        assert_equal(pool.trajectories(), [one for episodes in copies for one in episodes])
        assert_equal(pool.running(), [episodes[-1] for episodes in copies])


@pytest.mark.parametrize("capacity", [1, 60, 120])
def test_whole_episodes_of_the_latest_rows_are_kept(capacity: int) -> None:
    """No more of them than make up the capacity and the batch just added."""
    pool, every = Pool(COPIES, capacity), batches(sampler(CARTPOLE, COPIES), [16] * 6)
    for n, batch in enumerate(every, 1):
        pool.add(batch)
        expected = []
        for copy, episodes in enumerate(told(every[:n])):
            needed = max(capacity // COPIES, 16 + int(batch.begins[:-1, copy].sum()) + 1)
            count = 1
            while count < len(episodes) and sum(len(one) for one in episodes[-count:]) < needed:
                count += 1
            expected += episodes[-count:]
        assert_equal(pool.trajectories(), expected)


@pytest.mark.parametrize("settings", [CARTPOLE, LOSSY, SWIMMER])
@pytest.mark.parametrize("capacity", [1, 100_000])
@pytest.mark.parametrize("window", [0, 2])
def test_rows_of_a_batch_are_those_after_which_it_acted(
    settings: EnvironmentSettings, capacity: int, window: int
) -> None:
    """What the memory told the policy is what filtering the pool's episodes tells at these rows."""
    model = learned_filter(settings)
    made = sampler(settings, COPIES, window, model=model)
    pool = Pool(COPIES, capacity)
    for batch in batches(made, [5, 1, 40, 9]):
        pool.add(batch)
        trajectories, rows = pool.of_batch(batch)
        centre = np.zeros(made.environments.observation_size)
        found = predictive_features(filter_trajectories(model, trajectories), trajectories, window, centre)
        np.testing.assert_allclose(found[rows], batch.features[:-1], rtol=1e-9, atol=1e-9)
        assert len(np.unique(rows)) == batch.steps
        # The action of a step is in the row after.
        np.testing.assert_array_equal(trajectories.action[rows + 1], batch.action)
        np.testing.assert_array_equal(trajectories.observation[rows + 1], batch.after)


def test_what_is_put_away_goes_on_the_same() -> None:
    every = batches(sampler(LOSSY, COPIES), [10, 10, 10])
    pool, other = Pool(COPIES, 60), Pool(COPIES, 60)
    other.restore(pool.arrays())
    for batch in every:
        for one in (pool, other):
            one.add(batch)
        copy = Pool(COPIES, 60)
        copy.restore({name: array.copy() for name, array in other.arrays().items()})
        other = copy
    for name, array in pool.arrays().items():
        np.testing.assert_array_equal(array, other.arrays()[name])
