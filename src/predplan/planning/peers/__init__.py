"""The planners that are compared on MotionBenchMaker's problems, and what each of them is.

Packages of others are an optional extra (predplan[peers]) and are imported only when one of their planners is asked
for; a planner whose package is missing raises NotInstalledError.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from importlib import import_module
from importlib.util import find_spec

from predplan.errors import InputError, PredplanError
from predplan.planning.benchmarks import Prepare
from predplan.planning.robots import Robot


@dataclass(frozen=True)
class PeerSettings:
    """How long each planner may work on a problem, in seconds, and how often."""

    seeds: int = 1
    own_s: float = 1.0  # ours, and the floor of RRT-Connect with shortcuts
    kernel_s: float = 0.5  # ours from kernel starts alone
    ompl_s: float = 2.0  # OMPL's RRT-Connect; its simplification comes on top, and ends by itself
    optimising_s: float = 1.0  # OMPL's optimising planners, which use all of it
    drake_s: float = 5.0
    vamp_iterations: int = 1_000_000  # VAMP counts iterations, not seconds


class NotInstalledError(PredplanError):
    """A peer's package is missing."""


@dataclass(frozen=True)
class Peer:
    """A planner of the comparison: where it is made, and the package it needs."""

    name: str
    label: str
    module: str
    package: str = ""  # "" for our own code
    own: bool = False  # belongs to every run, not only to that with peers


PEERS = (
    Peer("cascade", "predplan", "own", own=True),
    Peer("kernel", "predplan, kernel starts alone", "own", own=True),
    Peer("thesis", "thesis: Gaussian σ=0.9, one maximum", "own"),
    Peer("chomp", "CHOMP: waypoints, acceleration, integral", "own"),
    Peer("rrt-connect", "RRT-Connect + shortcuts, compiled here", "own"),
    Peer("ompl-rrt-connect", "OMPL RRT-Connect + simplification", "ompl_planners", "ompl"),
    Peer("ompl-rrt-connect-motions", "OMPL RRT-Connect, whole motions checked by us", "ompl_planners", "ompl"),
    Peer("ompl-rrt-connect-shortcuts", "OMPL RRT-Connect, shortcuts alone", "ompl_planners", "ompl"),
    Peer("ompl-bitstar", "OMPL BIT*", "ompl_planners", "ompl"),
    Peer("drake", "Drake KinematicTrajectoryOptimization", "drake_optimisation", "pydrake"),
    Peer("vamp", "VAMP RRT-Connect + simplification", "vamp_planner", "vamp"),
)
REFERENCE = "ompl-rrt-connect"
"""RRT-Connect with simplification, to which lengths, accelerations and durations are compared."""


def peer(name: str) -> Peer:
    """The planner of a name; raises InputError that lists the known ones."""
    for each in PEERS:
        if each.name == name:
            return each
    raise InputError(f"planner {name!r} is not known; expected one of {', '.join(each.name for each in PEERS)}")


def installed(each: Peer) -> bool:
    """Whether the planner's package is there; nothing is imported."""
    return not each.package or find_spec(each.package) is not None


def make(name: str, robot: Robot, settings: PeerSettings) -> Prepare:
    """A planner made ready for a robot. Raises NotInstalledError where its package is missing."""
    each = peer(name)
    if not installed(each):
        raise NotInstalledError(f"{name}: the package {each.package} is not installed: pip install 'predplan[peers]'")
    made: Callable[[str, Robot, PeerSettings], Prepare] = import_module(f"{__name__}.{each.module}").make
    return made(name, robot, settings)


def own_planners() -> Sequence[str]:
    """Those that need no other package and belong to every run."""
    return [each.name for each in PEERS if each.own]
