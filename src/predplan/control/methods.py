"""Ways to learn a policy: what it remembers, and how it is updated. Each is named as in chapter 5 and the report."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TypeAlias

from predplan.control.bounds import check_number, check_whole
from predplan.control.innovation import InnovationSettings
from predplan.control.joint import AlternatingSettings, JointSettings, VRPGSettings
from predplan.control.networks import NetworkSettings
from predplan.control.ppo import PPOSettings
from predplan.control.trpo import TRPOSettings
from predplan.errors import InputError

UpdateSettings: TypeAlias = PPOSettings | TRPOSettings | VRPGSettings | AlternatingSettings


@dataclass(frozen=True)
class FilterSettings:
    """How a predictive memory is learned from a policy's own steps."""

    innovation: InnovationSettings = field(default_factory=lambda: InnovationSettings(starts=10, refits=0))
    random: bool = False  # weights are drawn, not learned
    dimension: int = 0  # p; 0: twice the observations, positions and velocities
    refit_every: int = 2  # updates; 0: never after the first batch
    rows: int = 20_000  # latest ones that a refit is from
    gap_rows: int = 8_000  # the same where observations are lost, which costs more
    gap_iterations: int = 5  # of expectation maximisation a refit, from the moments known
    compared: int = 4_000  # rows on which the policies with old and new filter are compared
    most_divergence: float = 0.03  # KL by which a refit may move the policy

    def __post_init__(self) -> None:
        check_whole(self, "dimension", "refit_every", least=0)
        check_whole(self, "rows", "gap_rows", "gap_iterations", "compared")
        check_number(self, "most_divergence", least=0, finite=False)


@dataclass(frozen=True)
class Method:
    """A policy and its update."""

    update: UpdateSettings = field(default_factory=PPOSettings)
    network: NetworkSettings = field(default_factory=NetworkSettings)
    window: int = 1  # last observations that it is told
    filter: FilterSettings | None = None  # None: no predictive state
    whitening_rows: int = 20_000  # by so many rows features are whitened, the latest counting fully
    floor: float = 1e-5  # share of variance below which directions are not blown up

    def __post_init__(self) -> None:
        check_whole(self, "window", least=0)
        if self.window == 0 and self.filter is None:
            raise InputError("window: found 0, expected at least 1 where there is no predictive state")
        check_whole(self, "whitening_rows")
        check_number(self, "floor", above=0, most=1)
        if isinstance(self.update, VRPGSettings | AlternatingSettings):
            told = (self.filter is not None, self.window, self.network.recurrent)
            if told != (True, 0, 0):
                found = f"filter {'set' if told[0] else 'None'}, window {told[1]}, recurrent {told[2]}"
                raise InputError(f"update: gradients go through a policy that is told of a filter alone; found {found}")


METHODS = {
    "rpsp": Method(window=0, filter=FilterSettings()),
    "rpsp-obs": Method(window=1, filter=FilterSettings()),
    "rpsp-trpo": Method(window=0, filter=FilterSettings(), update=TRPOSettings()),
    "rpsp-alt": Method(window=0, filter=FilterSettings(refit_every=0), update=AlternatingSettings()),
    "rpsp-vrpg": Method(window=0, filter=FilterSettings(refit_every=0), update=VRPGSettings()),
    "rpsp-reactive": Method(
        window=0,
        filter=FilterSettings(refit_every=0),
        update=VRPGSettings(JointSettings(prediction=0.0)),
    ),
    "rpsp-frozen": Method(window=0, filter=FilterSettings(refit_every=0)),
    "rpsp-random": Method(window=0, filter=FilterSettings(refit_every=0, random=True)),
    "fm1": Method(window=1),
    "fm2": Method(window=2),
    "fm5": Method(window=5),
    "fm10": Method(window=10),
    "fm2-trpo": Method(window=2, update=TRPOSettings()),
    "gru": Method(network=NetworkSettings(recurrent=32)),
    "gru-16": Method(network=NetworkSettings(recurrent=16)),
    "gru-64": Method(network=NetworkSettings(recurrent=64)),
    "gru-128": Method(network=NetworkSettings(recurrent=128)),
    "gru-predictive": Method(network=NetworkSettings(recurrent=32, prediction=0.1)),
    "gru-trpo": Method(network=NetworkSettings(recurrent=32), update=TRPOSettings()),
}
"""By name."""


def find_method(name: str) -> Method:
    """Raises InputError where there is no such method."""
    if name not in METHODS:
        raise InputError(f"method: found {name!r}, expected one of {', '.join(METHODS)}")
    return METHODS[name]
