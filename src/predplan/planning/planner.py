"""The planner: many starts, functional gradient descent from each, and a proof before anything is returned.

A cascade under one time budget. First the straight line and draws from the kernel's own Gaussian process, which are
smooth and cheap; then paths of RRT-Connect projected into a narrower kernel's space (§6.2.3). A path that is certified
is made smoother while that stays certified. What cannot be certified is never returned: the plan says what was tried.
"""

import time
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Literal, NamedTuple, get_args

import numpy as np

from predplan.errors import InputError
from predplan.planning.certificates import FREE, UNDECIDED, Certificate, Verdict, prove, stated
from predplan.planning.collisions import nearest_names, valid
from predplan.planning.kernels import Gaussian, Kernel, condition, normalise
from predplan.planning.optimiser import MAXIMUM_BODY, Descent, Space, cheapest, descend, line_values, space_of
from predplan.planning.paths import Path, acceleration_cost, length, quintic, velocity_cost
from predplan.planning.robots import FloatArray, Robot
from predplan.planning.sampling import connect, resampled, shortcut
from predplan.planning.scenes import Scene, make_scene
from predplan.planning.timing import Timing, parametrise, trajectory

Method = Literal["cascade", "kernel", "sampled"]
METHODS: tuple[Method, ...] = get_args(Method)
"""kernel: starts are the line and draws from the kernel's process; sampled: RRT-Connect's; cascade: both in turn."""


@dataclass(frozen=True)
class PlannerSettings:
    """What the planner does; the defaults were chosen on seventy problems of MotionBenchMaker (reports/planning.md)."""

    samples: int = 20  # inner times at which a descent looks at the arm
    knots: int = 24  # pieces of the path that is certified and returned
    width: float = 0.3  # of the Gaussian kernel of the line's and the prior's starts, t in [0, 1]
    middle_width: float = 0.16  # of the kernel that a path too tight for the wide one is seen through
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
    rounds: int = 2  # of shortening a certified path
    contractions: int = 3  # halvings of the interval in which the smallest free multiple of f is sought


@dataclass(frozen=True)
class Attempt:
    """One start of the cascade and what became of it."""

    start: str  # line, prior or sampled
    outcome: str  # "certified", or why not
    iterations: int
    time_s: float  # since planning began


@dataclass(frozen=True)
class Plan:
    """What a planner returns: a certified trajectory, or the reason why there is none."""

    robot: Robot
    scene: Scene
    success: bool
    reason: str  # empty on success
    method: str
    time_s: float  # until the certified path was there, its smoothing included
    attempts: tuple[Attempt, ...]
    certificate: Certificate | None
    path: Path | None

    @property
    def certified(self) -> bool:
        """Whether the whole path was proved free of collision and within joint limits."""
        return self.certificate is not None and self.certificate.free

    @property
    def joints(self) -> tuple[str, ...]:
        """Names of the trajectory's columns."""
        return self.robot.joints

    @cached_property
    def timing(self) -> Timing:
        """When to be where, within the velocity and acceleration limits; computed when first asked for."""
        return parametrise(self._path, self.robot.velocity_limit, self.robot.acceleration_limit)

    @property
    def duration_s(self) -> float:
        """Seconds from start to goal."""
        return self.timing.duration

    def trajectory(self, t: FloatArray, order: int = 0) -> FloatArray:
        """Configurations (order 1, 2: velocities, accelerations) at times t [n] s -> [n, joints] rad (/s, /s²)."""
        return trajectory(self._path, self.timing, np.atleast_1d(np.asarray(t, dtype=np.float64)), order)

    @cached_property
    def costs(self) -> Mapping[str, float]:
        """Length (rad), ½ mean ‖q̇‖² and ½ mean ‖q̈‖² over the path's own parameter in [0, 1]."""
        return {
            "length_rad": length(self._path),
            "velocity_cost": velocity_cost(self._path),
            "acceleration_cost": acceleration_cost(self._path),
        }

    @cached_property
    def limits(self) -> Mapping[str, float]:
        """Largest share of each kind of limit that the timed trajectory uses."""
        t = np.linspace(0.0, self.duration_s, 1001)
        q, chain = self.trajectory(t), self.robot.chain
        middle, half = (chain.upper + chain.lower) / 2, (chain.upper - chain.lower) / 2
        return {
            "position": float(np.max(np.abs(q - middle) / half)),
            "velocity": float(np.max(np.abs(self.trajectory(t, 1)) / self.robot.velocity_limit)),
            "acceleration": float(np.max(np.abs(self.trajectory(t, 2)) / self.robot.acceleration_limit)),
        }

    @property
    def _path(self) -> Path:
        if self.path is None:
            raise ValueError(f"there is no trajectory: {self.reason}")
        return self.path


class Basis(NamedTuple):
    """A kernel's space at the planner's times, and what carries its elements to knots, draws and projections."""

    space: Space
    to_knots: tuple[FloatArray, FloatArray, FloatArray]  # [P + 1, F] for values, first and second derivatives
    root: FloatArray  # [F, r]: coefficients of a draw from the kernel's Gaussian process, root @ normal
    ridge: FloatArray  # [F, F]: coefficients of the ridge regression on values at the times


def basis_of(kernel: Kernel, joints: int, samples: int, knots: int, ridge: float) -> Basis:
    """The tables of a normalised, conditioned kernel."""
    space = space_of(kernel, np.eye(joints), samples)
    at = np.linspace(0.0, 1.0, knots + 1)
    values, vectors = np.linalg.eigh(space.gram)
    kept = values > 1e-9 * values[-1]
    return Basis(
        space,
        (kernel.gram(at, space.times), kernel.gram(at, space.times, 1), kernel.gram(at, space.times, 2)),
        np.ascontiguousarray(vectors[:, kept] / np.sqrt(values[kept])),
        np.asarray(np.linalg.inv(space.gram + ridge * np.eye(samples)), np.float64),
    )


KNOTS = 65
"""Times at which the lengths of two paths are compared."""
UNTRIED = Verdict(UNDECIDED, np.nan, -1, -1, np.nan, 0)
"""Of an attempt that did not come to a proof."""


class Tried(NamedTuple):
    """Where an attempt ended: the path if it was certified."""

    path: Path | None
    verdict: Verdict
    basis: Basis
    coefficients: FloatArray  # [F, D]
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
        middle = normalise(condition(Gaussian(settings.middle_width)))
        self._middle = basis_of(middle, joints, settings.samples, settings.knots, settings.ridge)
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

        self._load()

    def _load(self) -> None:
        """Load compiled code, or compile and keep it, before a budget counts: all of it once in an empty scene."""
        chain, scene, generator = self.robot.chain, make_scene([]), np.random.default_rng(0)
        middle = (chain.lower + chain.upper) / 2
        valid(chain, scene.obstacles, middle, 0.0)
        coefficients = self._draw(scene, line_values(self._wide.space, middle, middle), generator)
        self._attempt(scene, self._wide, coefficients, middle, middle)
        self._prove(scene, self._path(self._wide, coefficients, middle, middle))
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
        start = self._configuration(scene, "start", start)
        goal = self._configuration(scene, "goal", goal)
        chain = self.robot.chain
        larger = [
            held
            for held in scene.larger
            if valid(chain, held.obstacles, start, 0.0) and valid(chain, held.obstacles, goal, 0.0)
        ][:1]
        attempts: list[Attempt] = []
        for world, share in [*((held, 0.5) for held in larger), (scene, 1.0)]:
            for name, basis, coefficients in self._starts(world, start, goal, method, np.random.default_rng(seed)):
                elapsed = time.perf_counter() - began
                if elapsed > share * budget:
                    break
                if basis is None:
                    attempts.append(Attempt(name, "no path was found", 0, elapsed))
                    continue
                tried = self._attempt(world, basis, coefficients, start, goal)
                attempts.append(Attempt(name, tried.outcome, tried.iterations, time.perf_counter() - began))
                if tried.path is None:
                    continue
                if name != "line":
                    tried = self._smoother(world, tried, start, goal, np.random.default_rng(seed))
                certificate = stated(self.robot, world, tried.verdict, 0.0)
                took = time.perf_counter() - began
                return Plan(self.robot, scene, True, "", method, took, tuple(attempts), certificate, tried.path)
        reason = f"no certified trajectory within {budget:g} s: {_summary(attempts)}"
        return Plan(self.robot, scene, False, reason, method, time.perf_counter() - began, tuple(attempts), None, None)

    def _starts(
        self, scene: Scene, start: FloatArray, goal: FloatArray, method: Method, generator: np.random.Generator
    ) -> Iterator[tuple[str, Basis | None, FloatArray]]:
        settings, joints = self.settings, len(start)
        samples = settings.samples
        wide, narrow = self._wide, self._narrow
        if method != "sampled":
            yield "line", wide, np.zeros((samples, joints))
        while True:
            for _ in range(0 if method == "sampled" else settings.prior_starts):
                yield "prior", wide, self._draw(scene, line_values(wide.space, start, goal), generator)
            if method == "kernel":
                continue
            points = self._search(scene, start, goal, generator)
            if len(points) == 0:
                yield "sampled", None, np.zeros((0, joints))
                continue
            line = line_values(narrow.space, start, goal)
            yield "sampled", narrow, narrow.ridge @ (resampled(points, narrow.space.times) - line)

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
        return self._shortened(scene, points, generator)

    def _shortened(self, scene: Scene, points: FloatArray, generator: np.random.Generator) -> FloatArray:
        settings, chain = self.settings, self.robot.chain
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
                return Tried(None, UNTRIED, basis, coefficients, "the descent ended in collision", iterations)
            path = self._path(basis, coefficients, start, goal)
            verdict = self._prove(scene, path)
            if verdict.kind == FREE:
                return Tried(path, verdict, basis, coefficients, "certified", iterations)
            descent = descent._replace(margin=2.0 * descent.margin + 0.002, iterations=10)
        return Tried(None, verdict, basis, coefficients, "the proof failed", iterations)

    def _smoother(
        self, scene: Scene, tried: Tried, start: FloatArray, goal: FloatArray, generator: np.random.Generator
    ) -> Tried:
        """A certified path made shorter and smoother, while it stays free.

        Its knots are shortened as a polyline and seen through a wider kernel, then the path is drawn towards the line.
        """
        for _ in range(self.settings.rounds):
            assert tried.path is not None
            knots = np.concatenate([tried.path.coefficients[:, 0], goal[None]])
            points = self._shortened(scene, knots, generator)
            for basis in (self._wide, self._middle):
                values = resampled(points, basis.space.times) - line_values(basis.space, start, goal)
                other = self._attempt(scene, basis, basis.ridge @ values, start, goal)
                if other.path is not None:
                    if tried.basis is self._narrow or length(other.path, KNOTS) < length(tried.path, KNOTS):
                        tried = other
                    break
        whole, low, high = tried.coefficients, 0.0, 1.0
        for _ in range(self.settings.contractions):
            middle = (low + high) / 2
            path = self._path(tried.basis, middle * whole, start, goal)
            verdict = self._prove(scene, path)
            if verdict.kind == FREE:
                tried, high = tried._replace(path=path, verdict=verdict), middle
            else:
                low = middle
        return tried

    def _path(self, basis: Basis, coefficients: FloatArray, start: FloatArray, goal: FloatArray) -> Path:
        breaks = np.linspace(0.0, 1.0, self.settings.knots + 1)
        position, velocity, acceleration = (table @ coefficients for table in basis.to_knots)
        span = goal - start
        position += start + np.multiply.outer(breaks, span)
        position[0], position[-1] = start, goal
        return quintic(breaks, position, velocity + span, acceleration)

    def _prove(self, scene: Scene, path: Path) -> Verdict:
        verdict: Verdict = prove(
            self.robot.chain, scene.obstacles, path.breaks, path.coefficients, 0.0, self.settings.proof
        )
        return verdict

    def _configuration(self, scene: Scene, name: str, q: FloatArray) -> FloatArray:
        robot, chain = self.robot, self.robot.chain
        q = np.ascontiguousarray(q, dtype=np.float64)
        if q.shape != (len(robot.joints),):
            raise InputError(f"{name} has shape {q.shape}; expected one value for each of {', '.join(robot.joints)}")
        if not np.all(np.isfinite(q)):
            at = [joint for joint, value in zip(robot.joints, q, strict=True) if not np.isfinite(value)]
            raise InputError(f"{name} is not finite at {', '.join(at)}")
        outside = [
            f"{joint} is {value:.4f}, allowed {low:.4f} to {high:.4f}"
            for joint, value, low, high in zip(robot.joints, q, chain.lower, chain.upper, strict=True)
            if not low - 1e-9 <= value <= high + 1e-9
        ]
        if outside:
            raise InputError(f"{name} is outside the joint limits: {'; '.join(outside)}")
        if not valid(chain, scene.obstacles, q, 0.0):
            met = "; ".join(f"{a} and {b}, {depth:.4f} m deep" for a, b, depth in nearest_names(robot, scene, q))
            raise InputError(f"{name} is in collision: {met}")
        return q


def _summary(attempts: list[Attempt]) -> str:
    outcomes: dict[str, int] = {}
    for attempt in attempts:
        key = f"{attempt.start}: {attempt.outcome}"
        outcomes[key] = outcomes.get(key, 0) + 1
    return "; ".join(f"{count} x {outcome}" for outcome, count in outcomes.items()) or "no time to try anything"
