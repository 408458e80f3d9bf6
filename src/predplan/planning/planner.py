"""The planner: many starts, functional gradient descent from each, and a proof before anything is returned.

A cascade under one time budget. First the straight line and draws from the kernel's own Gaussian process, which are
smooth and cheap; then paths of RRT-Connect projected into a narrower kernel's space (§6.2.3). A path that is certified
is drawn tight, so that its motion takes less time (refining.py). What cannot be certified is never returned: the plan
says what was tried.
"""

import time
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Literal, NamedTuple, get_args

import numpy as np

from predplan.errors import InputError
from predplan.planning.bases import Basis, basis_of, path_of
from predplan.planning.certificates import FREE, UNDECIDED, Verdict, prove, stated
from predplan.planning.collisions import valid
from predplan.planning.configurations import configuration
from predplan.planning.kernels import Gaussian, condition, normalise
from predplan.planning.optimiser import MAXIMUM_BODY, Descent, cheapest, descend, line_values
from predplan.planning.paths import Path
from predplan.planning.plans import Attempt, Plan, told
from predplan.planning.refining import Refined, Refiner, RefinerSettings
from predplan.planning.robots import FloatArray, Robot
from predplan.planning.sampling import connect, resampled, shortcut
from predplan.planning.scenes import Scene, make_scene

Method = Literal["cascade", "kernel", "sampled"]
METHODS: tuple[Method, ...] = get_args(Method)
"""kernel: starts are the line and draws from the kernel's process; sampled: RRT-Connect's; cascade: both in turn."""


@dataclass(frozen=True)
class PlannerSettings:
    """What the planner does; the defaults were chosen on seventy problems of MotionBenchMaker (reports/planning.md)."""

    samples: int = 20  # inner times at which a descent looks at the arm
    knots: int = 24  # pieces of the path that is certified and returned
    width: float = 0.3  # of the Gaussian kernel of the line's and the prior's starts, t in [0, 1]
    narrow_width: float = 0.07  # of the kernel that sampled paths are projected into
    ridge: float = 1e-4  # of that projection
    prior_starts: int = 1  # draws before the first sampled path, and between sampled paths
    draws: int = 8  # of which the cheapest is a start
    stride: int = 3  # every how many-th sample it is judged by
    prior_scale: float = 1.0  # rad: standard deviation of the prior where it is largest
    iterations: int = 22  # of a descent from the line or a draw
    sampled_iterations: int = 15  # of a descent from a sampled path
    sections: int = 6  # one gradient each an iteration
    inverse_step: float = 2.0
    beta: float = 0.0
    epsilon: float = 0.05  # m: clearance at which obstacles begin to cost
    self_epsilon: float = 0.02
    step_cap: float = 0.15  # rad
    margin: float = 0.001  # m: clearance a descent aims at, beyond what is certified
    reach: float = 1.5  # rad: longest motion RRT-Connect adds
    resolution: float = 0.08  # rad: between configurations it looks at
    search_iterations: int = 2000
    shortcuts: int = 40
    proof: int = 2000  # configurations looked at before a proof is given up
    others: int = 2  # further starts that are tried once a path is certified that is slow
    refining: RefinerSettings = field(default_factory=RefinerSettings)


UNTRIED = Verdict(UNDECIDED, np.nan, -1, -1, np.nan, 0)
"""Of an attempt that did not come to a proof."""


class Start(NamedTuple):
    """Where a descent begins."""

    name: str  # line, prior or sampled
    basis: Basis | None  # None where no path was found
    coefficients: FloatArray  # [F, D]


class Clock(NamedTuple):
    """How long planning may go on."""

    began: float  # s, by time.perf_counter
    budget: float  # s

    def elapsed(self) -> float:
        """Seconds since planning began."""
        return time.perf_counter() - self.began

    def in_time(self) -> bool:
        """Whether some of the budget is left."""
        return self.elapsed() <= self.budget


class Tried(NamedTuple):
    """Where an attempt ended: the path if it was certified."""

    path: Path | None
    verdict: Verdict
    outcome: str
    iterations: int


class Planner:
    """Plans for one robot; made once, used for many scenes."""

    def __init__(self, robot: Robot, settings: PlannerSettings | None = None) -> None:
        self.robot = robot
        self.settings = settings = settings or PlannerSettings()
        joints = len(robot.joints)
        wide = normalise(condition(Gaussian(settings.width)))
        narrow = normalise(condition(Gaussian(settings.narrow_width)))
        self._wide = basis_of(wide, joints, settings.samples, settings.knots, settings.ridge)
        self._narrow = basis_of(narrow, joints, settings.samples, settings.knots, settings.ridge)
        self._descent = Descent(
            reduce=MAXIMUM_BODY,
            sections=settings.sections,
            inverse_step=settings.inverse_step,
            beta=settings.beta,
            epsilon=settings.epsilon,
            self_epsilon=settings.self_epsilon,
            step_cap=settings.step_cap,
            iterations=settings.iterations,
            margin=settings.margin,
        )
        self._refiner = Refiner(robot, settings.knots, settings.refining)
        self._load()

    def _load(self) -> None:
        """Load compiled code, or compile and keep it, before a budget counts: all of it once in an empty scene."""
        chain, scene, generator = self.robot.chain, make_scene([]), np.random.default_rng(0)
        middle = (chain.lower + chain.upper) / 2
        valid(chain, scene.obstacles, middle, 0.0)
        coefficients = self._draw(scene, line_values(self._wide.space, middle, middle), generator)
        path = path_of(self._wide.to_knots, coefficients, middle, middle)
        self._attempt(scene, self._wide, coefficients, middle, middle)
        self._refiner.refine(scene, path, self._prove(scene, path), partial(self._prove, scene), lambda: True)
        points = self._search(scene, middle, middle, generator)
        resampled(points, self._narrow.space.times)

    def plan(
        self,
        scene: Scene,
        start: FloatArray,
        goal: FloatArray,
        budget: float = 1.0,
        method: Method = "cascade",
        seed: int = 0,
    ) -> Plan:
        """A certified trajectory from start to goal [D] (rad, m) within `budget` seconds, or the reason why not.

        Half the budget goes to the largest of the scene's larger ones in which start and goal are free.
        Raises InputError if start or goal is not a valid configuration, or the budget is not positive.
        """
        began = time.perf_counter()
        if method not in METHODS:
            raise InputError(f"method is {method!r}; expected one of {', '.join(METHODS)}")
        if not 0.0 < budget < np.inf:
            raise InputError(f"budget is {budget} s; expected more than 0, and an end")
        start = configuration(self.robot, scene, "start", start)
        goal = configuration(self.robot, scene, "goal", goal)
        chain = self.robot.chain
        larger = [
            held
            for held in scene.larger
            if valid(chain, held.obstacles, start, 0.0) and valid(chain, held.obstacles, goal, 0.0)
        ][:1]
        attempts: list[Attempt] = []
        for world, share in [*((held, 0.5) for held in larger), (scene, 1.0)]:
            clock = Clock(began, share * budget)
            starts = self._starts(world, start, goal, method, np.random.default_rng(seed))
            refined = self._fastest(world, starts, start, goal, attempts, clock)
            if refined is not None:
                certificate = stated(self.robot, world, refined.verdict, 0.0)
                took, tried = clock.elapsed(), tuple(attempts)
                return Plan(self.robot, scene, True, "", method, took, tried, certificate, refined.path)
        reason = f"no certified trajectory within {budget:g} s: {told(attempts)}"
        return Plan(self.robot, scene, False, reason, method, time.perf_counter() - began, tuple(attempts), None, None)

    def _fastest(
        self,
        scene: Scene,
        starts: Iterator[Start],
        start: FloatArray,
        goal: FloatArray,
        attempts: list[Attempt],
        clock: Clock,
    ) -> Refined | None:
        """The first certified path, made faster; if it is slow, the fastest of a few more. Its attempt is the last."""
        certified: list[tuple[Refined, Attempt]] = []
        others = 0
        while clock.in_time():
            if certified:
                best = min(refined.haste for refined, _ in certified)
                if others == self.settings.others or not self._refiner.is_slow(best, start, goal):
                    break
                others += 1
            name, basis, coefficients = next(starts)
            if basis is None:
                attempts.append(Attempt(name, "no path was found", 0, clock.elapsed()))
                continue
            tried = self._attempt(scene, basis, coefficients, start, goal)
            attempt = Attempt(name, tried.outcome, tried.iterations, clock.elapsed())
            if tried.path is None:
                attempts.append(attempt)
                continue
            prove_here = partial(self._prove, scene)
            refined = self._refiner.refine(scene, tried.path, tried.verdict, prove_here, clock.in_time)
            certified.append((refined, attempt))
        if not certified:
            return None
        *slower, (fastest, last) = sorted(certified, key=lambda pair: -pair[0].haste)
        attempts += [replace(attempt, outcome="certified, but slower") for _, attempt in slower]
        attempts.append(last)
        return fastest

    def _starts(
        self, scene: Scene, start: FloatArray, goal: FloatArray, method: Method, generator: np.random.Generator
    ) -> Iterator[Start]:
        settings, joints = self.settings, len(start)
        samples = settings.samples
        wide, narrow = self._wide, self._narrow
        if method != "sampled":
            yield Start("line", wide, np.zeros((samples, joints)))
        while True:
            for _ in range(0 if method == "sampled" else settings.prior_starts):
                yield Start("prior", wide, self._draw(scene, line_values(wide.space, start, goal), generator))
            if method == "kernel":
                continue
            points = self._search(scene, start, goal, generator)
            if len(points) == 0:
                yield Start("sampled", None, np.zeros((0, joints)))
                continue
            line = line_values(narrow.space, start, goal)
            yield Start("sampled", narrow, narrow.ridge @ (resampled(points, narrow.space.times) - line))

    def _search(self, scene: Scene, start: FloatArray, goal: FloatArray, generator: np.random.Generator) -> FloatArray:
        """A shortened path of RRT-Connect, points [n, D]; no rows if none was found."""
        settings, chain = self.settings, self.robot.chain
        points = connect(
            chain,
            scene.obstacles,
            start,
            goal,
            generator,
            settings.reach,
            settings.resolution,
            0.0,
            settings.search_iterations,
        )
        return shortcut(chain, scene.obstacles, points, generator, settings.shortcuts, settings.resolution, 0.0)

    def _draw(self, scene: Scene, line: FloatArray, generator: np.random.Generator) -> FloatArray:
        """The cheapest of several draws from the wide kernel's Gaussian process, as coefficients [F, D]."""
        space, root = self._wide.space, self._wide.root
        draws = self.settings.draws
        scales = self.settings.prior_scale * generator.uniform(0.3, 1.0, (draws, 1, 1))
        coefficients = root @ (scales * generator.standard_normal((draws, root.shape[1], line.shape[1])))
        values = line + space.gram @ coefficients
        chosen = cheapest(self.robot.chain, scene.obstacles, self._descent, values, self.settings.stride)
        return np.ascontiguousarray(coefficients[chosen])

    def _attempt(
        self, scene: Scene, basis: Basis, coefficients: FloatArray, start: FloatArray, goal: FloatArray
    ) -> Tried:
        """Descend until clear, prove; where the proof finds a collision between the samples, ask for more margin."""
        chain, space = self.robot.chain, basis.space
        line = line_values(space, start, goal)
        lower, upper = np.broadcast_to(chain.lower, line.shape).copy(), np.broadcast_to(chain.upper, line.shape).copy()
        none = np.empty((0, *line.shape))
        limit = self.settings.iterations if basis is self._wide else self.settings.sampled_iterations
        descent, iterations = self._descent._replace(iterations=limit), 0
        for _ in range(3):
            ended = descend(chain, scene.obstacles, space, descent, line, coefficients, lower, upper, none)
            iterations += ended.iterations
            coefficients = ended.coefficients
            if ended.clearance < 0.0:
                return Tried(None, UNTRIED, "the descent ended in collision", iterations)
            path = path_of(basis.to_knots, coefficients, start, goal)
            verdict = self._prove(scene, path)
            if verdict.kind == FREE:
                return Tried(path, verdict, "certified", iterations)
            descent = descent._replace(margin=2.0 * descent.margin + 0.002, iterations=10)
        return Tried(None, verdict, "the proof failed", iterations)

    def _prove(self, scene: Scene, path: Path) -> Verdict:
        verdict: Verdict = prove(
            self.robot.chain, scene.obstacles, path.breaks, path.coefficients, 0.0, self.settings.proof
        )
        return verdict
