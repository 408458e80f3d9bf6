"""Settings that cannot be are named, with what was found; no number among them is without bounds."""

from __future__ import annotations

import re
from dataclasses import fields
from typing import Any

import pytest

from predplan.control.advantages import AdvantageSettings
from predplan.control.correction import CorrectionSettings
from predplan.control.descent import DescentSettings
from predplan.control.environments import EnvironmentSettings
from predplan.control.exploration import ExplorationSettings
from predplan.control.features import FeatureSettings
from predplan.control.innovation import InnovationSettings
from predplan.control.joint import AlternatingSettings, JointSettings, VRPGSettings
from predplan.control.kernel_psr import KernelSettings
from predplan.control.methods import METHODS, FilterSettings, Method
from predplan.control.networks import NetworkSettings
from predplan.control.ppo import PPOSettings
from predplan.control.predictors import PredictorSettings
from predplan.control.recurrent_predictor import RecurrentSettings
from predplan.control.refinement import RefinementSettings
from predplan.control.running import Order
from predplan.control.training import Schedule
from predplan.control.trpo import TRPOSettings
from predplan.errors import InputError

NAN, INF = float("nan"), float("inf")
COUNT = (0, -1, 1.5, NAN, True)
COUNT_OR_NONE = (-1, 0.5, NAN)
POSITIVE = (0.0, -1.0, NAN, INF, "1")
LIMIT = (0.0, -1.0, NAN)  # infinity is no limit
SHARE = (0.0, 1.0, -0.1, NAN)
WEIGHT = (-0.1, NAN, INF)

BAD: dict[type, dict[str, tuple[Any, ...]]] = {
    AdvantageSettings: dict.fromkeys(("discount", "trace"), (-0.1, 1.1, NAN)),
    AlternatingSettings: {"most_divergence": (-0.1, NAN), "floor": (0.0, 1.1, NAN)},
    CorrectionSettings: {
        "frequencies": COUNT,
        "widths": ((), (1.0, 0.0), (NAN,), (INF,)),
        "lams": ((), (1.0, 0.0), (NAN,), (INF,)),
        "share": SHARE,
        "least_age": COUNT_OR_NONE,
    },
    DescentSettings: {"first": POSITIVE, "longest": POSITIVE, "memory": COUNT, "tries": COUNT},
    ExplorationSettings: {"trajectories": COUNT, "least_length": COUNT, "horizon": COUNT},
    FeatureSettings: {"frequencies": COUNT, "percentile": (0.0, 100.1, NAN), "dimension": COUNT},
    FilterSettings: {
        "dimension": COUNT_OR_NONE,
        "refit_every": COUNT_OR_NONE,
        "rows": COUNT,
        "gap_rows": COUNT,
        "gap_iterations": COUNT,
        "compared": COUNT,
        "most_divergence": (-0.1, NAN),
    },
    InnovationSettings: {
        **dict.fromkeys(("past", "future", "dimension"), COUNT),
        **dict.fromkeys(("refits", "starts"), COUNT_OR_NONE),
        "lam": WEIGHT,
        "beyond": POSITIVE,
    },
    JointSettings: {
        "policy": WEIGHT,
        "prediction": WEIGHT,
        "averaging": (0.0, 1.1, NAN),
        "rate": POSITIVE,
        "steps": COUNT,
        "largest_gradient": LIMIT,
    },
    KernelSettings: {
        **dict.fromkeys(("past", "future", "dimension", "frequencies"), COUNT),
        "percentile": (0.0, 100.1, NAN),
        "lam": POSITIVE,
        "beyond": POSITIVE,
    },
    Method: {"window": (-1, 0, 0.5), "whitening_rows": COUNT, "floor": (0.0, 1.1, NAN)},
    NetworkSettings: {
        "hidden": ((64, 0), (64.0,)),
        "recurrent": COUNT_OR_NONE,
        "log_deviation": (NAN, INF),
        "prediction": WEIGHT,
    },
    PPOSettings: {
        **dict.fromkeys(("rate", "clip"), POSITIVE),
        **dict.fromkeys(("epochs", "minibatch"), COUNT),
        **dict.fromkeys(("most_divergence", "largest_gradient"), LIMIT),
    },
    PredictorSettings: {
        "orders": ((0,), (2, 1.5)),
        "lam": WEIGHT,
        "steps": ((0,), (2, 1.5)),
        "least_age": COUNT_OR_NONE,
    },
    RecurrentSettings: {
        **dict.fromkeys(("hidden", "epochs", "batch", "rows", "patience"), COUNT),
        "rate": POSITIVE,
        "clip": LIMIT,
        "share": SHARE,
    },
    RefinementSettings: {
        **dict.fromkeys(("rows", "patience"), COUNT),
        **dict.fromkeys(("epochs", "least_age"), COUNT_OR_NONE),
        "share": SHARE,
    },
    Schedule: dict.fromkeys(("steps", "copies", "length"), COUNT),
    TRPOSettings: {
        **dict.fromkeys(("bound", "damping", "rate"), POSITIVE),
        **dict.fromkeys(("solver_iterations", "tries", "epochs", "minibatch"), COUNT),
        "shorter": SHARE,
        "largest_gradient": LIMIT,
    },
}


@pytest.mark.parametrize(
    ("settings", "name", "value"),
    [(settings, name, value) for settings, bad in BAD.items() for name, values in bad.items() for value in values],
)
def test_what_cannot_be_is_named(settings: type, name: str, value: Any) -> None:
    with pytest.raises(InputError) as found:
        settings(**{name: value})
    assert str(found.value).startswith(f"{name}: found {value!r}, expected ")


@pytest.mark.parametrize("settings", BAD)
def test_every_number_has_bounds(settings: type) -> None:
    numbers = {one.name for one in fields(settings) if re.search(r"\b(int|float)\b", str(one.type))}
    assert BAD[settings].keys() == numbers
    assert settings() is not None


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("noise", -0.1),
        ("noise", NAN),
        ("drop", 1.0),
        ("drop", NAN),
        ("horizon", 0),
        ("horizon", 1.5),
        ("threads", 0),
        ("scale", (1.0, -1.0)),
        ("scale", (1.0, NAN)),
    ],
)
def test_what_no_task_can_be_observed_with_is_named(name: str, value: Any) -> None:
    with pytest.raises(InputError) as found:
        EnvironmentSettings("cartpole", **{name: value})
    assert str(found.value).startswith(f"{name}: found {value!r}, expected ")


def test_orders_are_checked_before_any_work() -> None:
    task = EnvironmentSettings("cartpole")
    with pytest.raises(InputError, match="method: found 'magic', expected one of rpsp"):
        Order(task, "magic", Schedule(), 0)
    with pytest.raises(InputError, match="seed: found -1, expected at least 0"):
        Order(task, "rpsp", Schedule(), -1)


def test_bounds_are_told() -> None:
    with pytest.raises(InputError, match=r"^floor: found 0\.0, expected a number above 0 and at most 1$"):
        Method(floor=0.0)
    with pytest.raises(InputError, match=r"^steps: found 2\.5, expected a whole number$"):
        Schedule(steps=2.5)  # type: ignore[arg-type]
    with pytest.raises(InputError, match="policy, prediction: found 0 and 0, expected one at least above 0"):
        JointSettings(policy=0.0, prediction=0.0)
    with pytest.raises(InputError, match="correction: it is of the refined filter"):
        PredictorSettings(refinement=None)


@pytest.mark.parametrize("update", [VRPGSettings(), AlternatingSettings()])
def test_gradients_need_a_filter_to_go_through(update: VRPGSettings | AlternatingSettings) -> None:
    for bad in (
        {"filter": None, "window": 1},
        {"filter": FilterSettings(), "window": 1},
        {"filter": FilterSettings(), "window": 0, "network": NetworkSettings(recurrent=8)},
    ):
        with pytest.raises(InputError, match="update: gradients go through a policy that is told of a filter alone"):
            Method(update=update, **bad)


def test_unlimited_is_a_limit() -> None:
    assert PPOSettings(largest_gradient=INF, most_divergence=INF).clip == 0.2
    assert all(method.floor > 0.0 for method in METHODS.values())
