import json
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from safetensors.numpy import load_file

from predplan.artifacts.tensors import read_tensors, write_tensors
from predplan.control import policy_files
from predplan.control.advantages import whitened
from predplan.control.environments import Environments, EnvironmentSettings
from predplan.control.learned import Learned
from predplan.control.methods import METHODS
from predplan.control.policies import Policy, PolicyActor
from predplan.control.policy_files import load_policy, save_policy
from predplan.control.running import Order, run
from predplan.control.training import Schedule
from predplan.errors import InputError

LOSSY = EnvironmentSettings("cartpole", noise=0.2, drop=0.2, threads=1, scale=(0.1, 0.2))
KINDS = ["rpsp", "rpsp-obs", "fm5", "gru"]
LEARNED: dict[str, Learned] = {}


def learned(method: str) -> Learned:
    """By a short run."""
    if method not in LEARNED:
        LEARNED[method] = run(Order(LOSSY, method, Schedule(8 * 32 * 4, 8, 32), 0)).learned
    return LEARNED[method]


def observations(steps: int = 12) -> np.ndarray:
    """Some lost."""
    found = 0.05 * np.random.default_rng(0).standard_normal((steps, 2))
    found[[3, 4, 8]] = np.nan
    return found


def acted(policy: Policy, seen: np.ndarray) -> np.ndarray:
    policy.reset()
    return np.array([policy.act(one) for one in seen])


@pytest.mark.parametrize("method", KINDS)
def test_a_policy_is_the_mean_of_what_its_network_makes_of_the_memory(method: str) -> None:
    one = learned(method)
    memory, network, core = one.memory(1), one.network, one.network.initial(1)
    policy, action = Policy(one), np.zeros(1)
    for t, seen in enumerate(observations()):
        if t == 0:
            memory.begin(np.array([0]), seen[None])
        else:
            memory.observe(action[None], seen[None])
        action = policy.act(seen)
        with torch.no_grad():
            known, core = network.step(whitened(memory.features(), one.whitening), core)
            mean = network.actor(known).numpy()[0]
        np.testing.assert_allclose(action, np.clip(mean, -1.0, 1.0), rtol=1e-6, atol=1e-7)


@pytest.mark.parametrize("method", KINDS)
def test_reset_forgets_and_actions_are_the_callers(method: str) -> None:
    policy, seen = Policy(learned(method)), observations()
    first = acted(policy, seen)
    assert np.isfinite(first).all()
    assert np.abs(first).max() <= 1.0
    np.testing.assert_array_equal(acted(policy, seen), first)
    policy.reset()
    for t, one in enumerate(seen):
        action = policy.act(one)
        np.testing.assert_array_equal(action, first[t])
        action[:] = 99.0


@pytest.mark.parametrize("method", KINDS)
def test_a_policy_without_any_observation_acts_all_the_same(method: str) -> None:
    assert np.isfinite(acted(Policy(learned(method)), np.full((30, 2), np.nan))).all()
    assert np.isfinite(acted(Policy(learned(method)), np.full((30, 2), np.inf))).all()
    assert np.isfinite(acted(Policy(learned(method)), np.full((30, 2), 1e300))).all()


@pytest.mark.parametrize("seen", [np.zeros(3), np.zeros((1, 2)), np.float64(0.0), np.zeros(0)])
def test_observations_of_another_size_are_named(seen: np.ndarray) -> None:
    policy = Policy(learned("rpsp"))
    with pytest.raises(InputError, match=r"observation: found shape .*, expected \(2,\)"):
        policy.act(seen)


@pytest.mark.parametrize("method", KINDS)
def test_copies_side_by_side_act_as_one_policy_would(method: str) -> None:
    """Episodes that begin at other times, and copies that wait."""
    one = learned(method)
    actor, policies = PolicyActor(one, 3), [Policy(one) for _ in range(3)]
    generator = np.random.default_rng(1)
    rows, expected = np.arange(3), np.zeros((3, 1))
    for t in range(12):
        begins = rows if t == 0 else np.array([[1], [0, 2], []][t % 3], np.int64)
        goes_on = np.setdiff1d(rows, begins)[:: -1 if t % 2 else 1].copy()
        seen = 0.05 * generator.standard_normal((3, 2))
        seen[generator.random(3) < 0.2] = np.nan
        if len(goes_on):
            predicted = actor.predict(goes_on, expected[goes_on])
            assert np.isfinite(predicted).all() == method.startswith("rpsp")
            actor.observe(goes_on, expected[goes_on], seen[goes_on])
        if len(begins):
            actor.reset(begins, seen[begins])
        for row in rows:
            if row in begins:
                policies[row].reset()
            expected[row] = policies[row].act(seen[row])
        np.testing.assert_allclose(actor.act(rows), expected, rtol=1e-5, atol=1e-6)
        np.testing.assert_array_equal(actor.act(rows[::-1]), actor.act(rows)[::-1])
    size = {"rpsp": 4, "rpsp-obs": 4, "fm5": 0, "gru": 32}[method]
    assert actor.state.shape == (3, size)


@pytest.mark.parametrize("method", KINDS)
def test_a_policy_that_was_put_in_a_folder_acts_the_same(method: str, tmp_path: Path) -> None:
    one = learned(method)
    save_policy(tmp_path / "run", one)
    policy = Policy.load(tmp_path / "run")
    np.testing.assert_array_equal(acted(policy, observations()), acted(Policy(one), observations()))
    back = policy.learned
    assert (back.task, back.name, back.method) == (LOSSY, method, METHODS[method])
    save_policy(tmp_path / "again", back)
    for path in (tmp_path / "run").iterdir():
        assert (tmp_path / "again" / path.name).read_bytes() == path.read_bytes()
    with Environments(back.task, 1, np.random.default_rng(0)) as environments:
        policy.reset()
        action = policy.act(environments.reset().observation[0])
        assert environments.step(action[None]).reward.shape == (1,)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("policies") / "run"
    save_policy(path, learned("rpsp"))
    return path


@pytest.mark.parametrize("name", ["policy.json", "network.safetensors", "filter.json", "filter.safetensors"])
def test_lost_cut_and_altered_files_are_named(name: str, folder: Path, tmp_path: Path) -> None:
    path = tmp_path / "run" / name
    data = (folder / name).read_bytes()
    shutil.copytree(folder, path.parent)
    path.unlink()
    with pytest.raises(InputError, match=name):
        load_policy(path.parent)
    for length in (0, 5, len(data) // 2, len(data) - 9):
        path.write_bytes(data[:length])
        with pytest.raises(InputError, match=str(tmp_path)):
            load_policy(path.parent)
    if name.endswith("safetensors"):
        path.write_bytes(data[:-1] + bytes([data[-1] ^ 1]))
        with pytest.raises(InputError, match=rf"{path}: damaged"):
            load_policy(path.parent)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"format": "else"}, "format: expected 'predplan policy'"),
        ({"version": 99}, "version: found 99, expected 1"),
        ({"method": "fm0"}, "method: found 'fm0'"),
        ({"method": None}, "method: found 'None'"),
        ({"task": None}, "task: found None"),
        ({"task": {"task": "cartpool"}}, "task: task: found 'cartpool'"),
        ({"task": {"task": "cartpole", "noise": -1}}, "task: noise: found -1"),
        ({"task": {"task": "cartpole", "speed": 1}}, "task: .*speed"),
        ({"task": {"task": "cartpole", "noise": "loud"}}, "task: "),
        ({"task": {"task": "cartpole", "scale": 3}}, "task: "),
        ({"observations": 0}, "observations: found 0, expected a number from 1 on"),
        ({"observations": 3}, "filter.safetensors: found a filter of 2 observations and 1 actions, expected 3 and 1"),
        ({"actions": "many"}, "actions: found 'many'"),
        ({"actions": 2}, "network.safetensors: not the weights of 'rpsp'"),
        ({"network_sha256": "0"}, "network.safetensors: damaged, or not of policy.json"),
        ({"method": "fm2"}, "network.safetensors: "),
        ({"method": "gru"}, "network.safetensors: not the weights of 'gru'"),
        ({"method": "rpsp-obs"}, "network.safetensors: "),
    ],
)
def test_sheets_that_do_not_fit_are_named(
    changes: dict[str, object], message: str, folder: Path, tmp_path: Path
) -> None:
    shutil.copytree(folder, tmp_path / "run")
    path = tmp_path / "run" / "policy.json"
    path.write_text(json.dumps({**json.loads(path.read_text()), **changes}))
    with pytest.raises(InputError, match=message):
        load_policy(path.parent)


@pytest.mark.parametrize("name", ["network.log_deviation", "network.actor.0.weight", "whitening.mean"])
@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_numbers_that_are_not_finite_are_named(name: str, value: float, folder: Path, tmp_path: Path) -> None:
    def spoil(arrays: dict[str, np.ndarray]) -> None:
        arrays[name].flat[0] = value

    with pytest.raises(InputError, match=f"network.safetensors: {name}: found a number that is not finite"):
        load_policy(tampered(folder, tmp_path, spoil))


def test_networks_that_do_not_fit_are_named(folder: Path, tmp_path: Path) -> None:
    """With a digest that fits, too."""

    def without(name: str) -> Path:
        return tampered(folder, tmp_path / name, lambda arrays: arrays.pop(name))

    for name in ("whitening.mean", "whitening.matrix", "network.critic.0.bias"):
        with pytest.raises(InputError, match=r"network.safetensors: "):
            load_policy(without(name))

    def narrow(arrays: dict[str, np.ndarray]) -> None:
        arrays["whitening.mean"] = arrays["whitening.mean"][:3]

    with pytest.raises(InputError, match=r"network.safetensors: "):
        load_policy(tampered(folder, tmp_path / "narrow", narrow))


def test_the_filter_of_another_policy_is_named(folder: Path, tmp_path: Path) -> None:
    swimmer = replace(LOSSY, task="swimmer", scale=None, horizon=20)
    save_policy(tmp_path / "other", run(Order(swimmer, "rpsp", Schedule(128, 4, 32), 0)).learned)
    shutil.copytree(folder, tmp_path / "run")
    for name in ("filter.json", "filter.safetensors"):
        shutil.copy(tmp_path / "other" / name, tmp_path / "run" / name)
    with pytest.raises(InputError, match="filter"):
        load_policy(tmp_path / "run")


def test_weights_are_plain_tensors(folder: Path) -> None:
    arrays = load_file(folder / "network.safetensors")
    assert {"network.log_deviation", "network.value_scale", "whitening.mean", "whitening.matrix"} <= arrays.keys()
    assert {path.suffix for path in folder.iterdir()} == {".json", ".safetensors"}


def tampered(folder: Path, where: Path, change: object) -> Path:
    """A copy of the folder with other arrays, and the digest that they have."""
    assert callable(change)
    path = where / "run"
    shutil.copytree(folder, path)
    weights = path / "network.safetensors"
    arrays, _ = read_tensors(weights, policy_files.KIND)
    change(arrays)
    write_tensors(weights, arrays, policy_files.KIND, {})
    sheet = json.loads((path / "policy.json").read_text())
    sheet["network_sha256"] = policy_files._digest(weights)
    (path / "policy.json").write_text(json.dumps(sheet))
    return path
