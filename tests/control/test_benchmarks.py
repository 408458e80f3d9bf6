import pytest

from predplan.control.benchmarks import rates
from predplan.control.environments import EnvironmentSettings
from predplan.control.training import Schedule
from predplan.errors import InputError


@pytest.mark.parametrize("threads", [1, 2])
def test_sampling_is_slower_than_stepping_and_training_than_sampling(threads: int) -> None:
    found = rates(EnvironmentSettings("hopper", threads=threads), "rpsp", Schedule(1024, 8, 32), turns=3, length=20)
    assert found.raw.cpu > found.sampling.cpu > found.training.cpu > 0.0
    assert min(found.raw.wall, found.sampling.wall, found.training.wall) > 0.0


def test_tasks_of_gymnasiums_own_loop_are_named() -> None:
    with pytest.raises(InputError, match="task: found 'Reacher-v5', expected one that"):
        rates(EnvironmentSettings("Reacher-v5"), "rpsp", Schedule(100, 2, 10))
