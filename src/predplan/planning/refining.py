"""A certified path made faster: drawn tight, proved anew, and eased where the proof finds a collision between times."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from predplan.planning.bases import path_of
from predplan.planning.certificates import FREE, Verdict
from predplan.planning.paths import Path
from predplan.planning.robots import FloatArray, Robot
from predplan.planning.scenes import Scene
from predplan.planning.tightening import Element, Loop, Tightening, loop_of, tighten


@dataclass(frozen=True)
class RefinerSettings:
    """How certified paths are drawn tight; chosen like the planner's."""

    samples: int = 32  # inner times at which contacts are looked for
    width: float = 0.12  # over which corners are rounded, t in [0, 1]: about what a joint takes to turn around
    iterations: int = 8  # of the first drawing
    tries: int = 6  # for a slow path: proofs, each after the first with more room where the last one failed; else one
    eased_iterations: int = 4  # of those, and of a path that is not slow
    margin: float = 0.01  # m: clearance at the times looked at
    ease: float = 0.004  # m: added to that, times the number of the try, about where a proof failed
    span: float = 2.5  # steps of time that are about there
    step_cap: float = 0.2  # rad
    enough: float = 0.05  # rad
    reach: float = 0.03  # m
    self_reach: float = 0.015
    blends: int = 3  # halvings of the way back to the old path, where no drawing is free
    near: float = 1.1  # times as long as the line would take: a path that takes no more is left as it is
    slow: float = 1.15  # times as long: a path that takes more is worth more tries, and other starts


class Refined(NamedTuple):
    """A path that is certified and how fast it is thought to be."""

    path: Path
    verdict: Verdict
    haste: float  # see haste()


class Refiner:
    """Draws paths of one robot tight; made once."""

    def __init__(self, robot: Robot, knots: int, settings: RefinerSettings) -> None:
        self.robot, self.settings = robot, settings
        self._loop: Loop = loop_of(settings.samples, knots, settings.width)
        self._how = Tightening(
            settings.iterations, settings.step_cap, settings.enough, settings.reach, settings.self_reach
        )

    def refine(
        self,
        scene: Scene,
        path: Path,
        verdict: Verdict,
        prove: Callable[[Path], Verdict],
        in_time: Callable[[], bool],
    ) -> Refined:
        """The path, or a faster one that is certified too, found while there is time."""
        old = Refined(path, verdict, haste(self.robot, path))
        line = self._line_haste(path.coefficients[0, 0], path.coefficients[-1, -1])
        if old.haste <= self.settings.near * line:
            return old
        slow = old.haste > self.settings.slow * line
        new = self._tightened(scene, path, slow, prove, in_time)
        return new if new is not None and new.haste < old.haste else old

    def is_slow(self, seconds: float, start: FloatArray, goal: FloatArray) -> bool:
        """Whether a path of this haste is worth other starts."""
        return seconds > self.settings.slow * self._line_haste(start, goal)

    def _line_haste(self, start: FloatArray, goal: FloatArray) -> float:
        """haste() of the straight line."""
        return float(np.max(np.abs(goal - start) / self.robot.velocity_limit))

    def _tightened(
        self, scene: Scene, path: Path, slow: bool, prove: Callable[[Path], Verdict], in_time: Callable[[], bool]
    ) -> Refined | None:
        settings, loop, chain = self.settings, self._loop, self.robot.chain
        eased = self._how._replace(iterations=settings.eased_iterations)
        how = self._how if slow else eased
        start, goal = path.coefficients[0, 0], path.coefficients[-1, -1]
        values = path(loop.times) - start - np.multiply.outer(loop.times, goal - start)
        element = Element(values, loop.inverse @ values)
        margin = np.full(settings.samples, settings.margin)
        for trial in range(settings.tries if slow else 1):
            if not in_time():
                return None
            element, _ = tighten(
                chain, scene.obstacles, loop, how, start, goal, self.robot.velocity_limit, margin, element
            )
            tight = path_of(loop.to_knots, element.coefficients, start, goal)
            verdict = prove(tight)
            if verdict.kind == FREE:
                return Refined(tight, verdict, haste(self.robot, tight))
            about = np.abs(loop.times - verdict.s) * (settings.samples + 1) < settings.span
            margin[about] += max(verdict.depth, 0.0) + settings.ease * (trial + 1)
            how = eased
        return self._between(path, tight, prove, in_time) if slow else None

    def _between(
        self, free: Path, tight: Path, prove: Callable[[Path], Verdict], in_time: Callable[[], bool]
    ) -> Refined | None:
        """As far from a free path towards another one, of the same knots, as is proved free by bisection."""
        low, high, found = 0.0, 1.0, None
        for _ in range(self.settings.blends):
            if not in_time():
                break
            middle = (low + high) / 2
            blend = Path(free.breaks, (1.0 - middle) * free.coefficients + middle * tight.coefficients)
            verdict = prove(blend)
            if verdict.kind == FREE:
                low, found = middle, Refined(blend, verdict, haste(self.robot, blend))
            else:
                high = middle
        return found


def haste(robot: Robot, path: Path) -> float:
    """Seconds the path takes at the speed that velocity limits and its curvature allow everywhere, without starting
    and stopping: ∫ max_d max(|q'_d| / v_d, √(|q''_d| / a_d)) ds, summed over the knots."""
    c, step = path.coefficients, np.diff(path.breaks)[:, None]
    degree = path.degree
    by_velocity = np.abs(c[:, 1] - c[:, 0]) * (degree / step / robot.velocity_limit)
    bend = np.abs(c[:, 2] - 2.0 * c[:, 1] + c[:, 0]) * (degree * (degree - 1) / step**2 / robot.acceleration_limit)
    return float(np.maximum(by_velocity, np.sqrt(bend)).max(axis=1) @ step[:, 0])
