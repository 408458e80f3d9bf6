"""The planner: certified trajectories or a reason, whatever it is asked, with the same answer to the same seed."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from predplan.errors import InputError
from predplan.planning import Planner, PlannerSettings, Scene, certify, make_scene, read_robot
from predplan.planning.collisions import valid
from predplan.planning.planner import METHODS, Method
from predplan.planning.plans import Plan
from predplan.planning.robots import FloatArray, planar_arm, point_robot
from predplan.planning.scenes import Box, Sphere
from tests.planning.models import URDF, write

ARM = planar_arm([0.5, 0.4, 0.3], radius=0.03)
EMPTY = make_scene([])
POST = make_scene([Sphere([0.9, 0.35, 0.0], 0.1, "post")], "post")
CAGE = make_scene(
    [Box([0.6, 0.25, 0.0], [0.5, 0.02, 0.1], name="left"), Box([0.6, -0.25, 0.0], [0.5, 0.02, 0.1], name="right")],
    "cage",
)
START, GOAL = np.array([-0.1, 0.2, 0.0]), np.array([1.3, 0.2, 0.1])


@pytest.fixture(scope="module")
def planner() -> Planner:
    return Planner(ARM)


def check(plan: Plan, scene: Scene, start: FloatArray, goal: FloatArray) -> None:
    """Everything that a plan promises, looked at afresh."""
    assert (plan.success, plan.certified, plan.reason) == (True, True, "")
    assert plan.path is not None
    assert certify(plan.robot, scene, plan.path).free
    t = np.linspace(0, plan.duration_s, 4001)
    q, velocity, acceleration = (plan.trajectory(t, order) for order in range(3))
    np.testing.assert_allclose(q[[0, -1]], [start, goal], atol=1e-10)
    assert all(valid(plan.robot.chain, scene.obstacles, row, 0.0) for row in q)
    assert np.all(q >= plan.robot.chain.lower - 1e-9)
    assert np.all(q <= plan.robot.chain.upper + 1e-9)
    assert np.max(np.abs(velocity) / plan.robot.velocity_limit) <= 1.0
    assert np.max(np.abs(acceleration) / plan.robot.acceleration_limit) <= 1.0
    np.testing.assert_allclose(velocity[[0, -1]], 0.0, atol=1e-6)
    assert plan.limits["velocity"] <= 1.0
    assert plan.limits["acceleration"] <= 1.0
    assert plan.costs["length_rad"] >= np.linalg.norm(goal - start) - 1e-9


@pytest.mark.parametrize("method", METHODS)
def test_every_method_goes_around(planner: Planner, method: Method) -> None:
    plan = planner.plan(POST, START, GOAL, budget=10.0, method=method)
    check(plan, POST, START, GOAL)
    assert plan.method == method
    assert {attempt.start for attempt in plan.attempts} <= {
        "cascade": {"line", "prior", "sampled"},
        "kernel": {"line", "prior"},
        "sampled": {"sampled"},
    }[method]
    assert [attempt.outcome for attempt in plan.attempts].index("certified") == len(plan.attempts) - 1
    assert plan.attempts[-1].time_s <= plan.time_s


def test_one_planner_serves_many_scenes(planner: Planner) -> None:
    generator = np.random.default_rng(0)
    solved = 0
    for _ in range(20):
        shapes = [Sphere([*generator.uniform(-1.2, 1.2, 2), 0.0], generator.uniform(0.03, 0.12)) for _ in range(5)]
        scene = make_scene(shapes)
        start, goal = generator.uniform(-1.5, 1.5, (2, 3))
        if not (valid(ARM.chain, scene.obstacles, start, 0.0) and valid(ARM.chain, scene.obstacles, goal, 0.0)):
            continue
        plan = planner.plan(scene, start, goal, budget=2.0)
        if plan.success:
            check(plan, scene, start, goal)
            solved += 1
    assert solved >= 8


@pytest.mark.parametrize("method", METHODS)
def test_the_same_seed_gives_the_same_path(planner: Planner, method: Method) -> None:
    first, again = (planner.plan(POST, START, GOAL, 10.0, method, seed=5) for _ in range(2))
    other = Planner(ARM).plan(POST, START, GOAL, 10.0, method, seed=5)
    assert first.path is not None
    for plan in (again, other):
        assert plan.path is not None
        np.testing.assert_array_equal(plan.path.coefficients, first.path.coefficients)
        assert [(a.start, a.outcome, a.iterations) for a in plan.attempts] == [
            (a.start, a.outcome, a.iterations) for a in first.attempts
        ]


def test_an_empty_scene_is_fine_and_the_straight_line_is_kept(planner: Planner) -> None:
    plan = planner.plan(EMPTY, START, GOAL)
    check(plan, EMPTY, START, GOAL)
    assert plan.costs["length_rad"] == pytest.approx(np.linalg.norm(GOAL - START), rel=1e-6)
    assert plan.costs["acceleration_cost"] == pytest.approx(0.0, abs=1e-6)


def test_where_it_is_already_it_stays(planner: Planner) -> None:
    plan = planner.plan(POST, START, START)
    assert (plan.certified, plan.duration_s) == (True, 0.0)
    np.testing.assert_allclose(plan.trajectory(np.array([0.0, 1.0])), [START, START])


@pytest.mark.parametrize("method", METHODS)
def test_no_way_is_a_reason_and_no_trajectory(planner: Planner, method: Method) -> None:
    """The goal lies behind walls that no configuration of the arm passes."""
    start, goal = np.array([0.0, 0.0, 0.0]), np.array([np.pi / 2, 0.0, 0.0])
    plan = planner.plan(CAGE, start, goal, budget=0.3, method=method)
    assert (plan.success, plan.certified, plan.certificate, plan.path) == (False, False, None, None)
    assert plan.reason.startswith("no certified trajectory within 0.3 s")
    assert 0.3 <= plan.time_s < 2.0
    assert plan.attempts
    for use in (lambda: plan.trajectory(np.zeros(1)), lambda: plan.duration_s, lambda: plan.costs, lambda: plan.limits):
        with pytest.raises(ValueError, match="no certified trajectory"):
            use()


BAD: dict[str, tuple[Scene, object, object, dict[str, object], str]] = {
    "start in collision": (
        make_scene([Sphere([1.2, 0.0, 0.0], 0.05, "ball")]),
        np.zeros(3),
        GOAL,
        {},
        r"start is in collision: link3 and ball, 0\.0\d+ m deep",
    ),
    "goal in collision": (
        make_scene([Box([0.0, 1.2, 0.0], [0.1, 0.1, 0.1], name="shelf")]),
        START,
        np.array([np.pi / 2, 0.0, 0.0]),
        {},
        "goal is in collision: link3 and shelf",
    ),
    "folded": (EMPTY, START, np.array([0.0, 3.1, 3.1]), {}, "goal is in collision: link1 and link3"),
    "outside limits": (EMPTY, START, np.array([0.0, 3.5, -3.3]), {}, r"goal .* joint2 is 3\.5000, .*; joint3 is -3\.3"),
    "not finite": (EMPTY, np.array([0.0, np.nan, np.inf]), GOAL, {}, "start is not finite at joint2, joint3"),
    "too few joints": (EMPTY, np.zeros(2), GOAL, {}, r"start has shape \(2,\); .* joint1, joint2, joint3"),
    "no budget": (EMPTY, START, GOAL, {"budget": 0.0}, "budget is 0"),
    "negative budget": (EMPTY, START, GOAL, {"budget": -1.0}, "budget is -1"),
    "budget not a number": (EMPTY, START, GOAL, {"budget": float("nan")}, "budget is nan"),
    "unknown method": (EMPTY, START, GOAL, {"method": "magic"}, "'magic'; expected one of cascade, kernel, sampled"),
}


@pytest.mark.parametrize("fault", BAD)
def test_bad_input_is_named(planner: Planner, fault: str) -> None:
    scene, start, goal, options, message = BAD[fault]
    with pytest.raises(InputError, match=message):
        planner.plan(scene, start, goal, **options)  # type: ignore[arg-type]


def test_integers_and_lists_are_configurations(planner: Planner) -> None:
    plan = planner.plan(EMPTY, [0, 0, 0], [1, 0, 0])  # type: ignore[arg-type]
    assert plan.certified


def test_a_narrow_gap_is_passed_by_a_point() -> None:
    robot = point_robot(0.02)
    gap = [Box([0.5, 0.15, 0.0], [0.03, 0.25, 1.0]), Box([0.5, 0.75, 0.0], [0.03, 0.3, 1.0])]
    scene, start, goal = make_scene(gap), np.array([0.1, 0.9]), np.array([0.9, 0.9])
    check(Planner(robot).plan(scene, start, goal, budget=5.0), scene, start, goal)


def test_slower_robots_take_longer(planner: Planner) -> None:
    slow = replace(ARM, velocity_limit=ARM.velocity_limit / 2, acceleration_limit=ARM.acceleration_limit / 4)
    quick = planner.plan(POST, START, GOAL, budget=10.0)
    plan = Planner(slow).plan(POST, START, GOAL, budget=10.0)
    check(plan, POST, START, GOAL)
    assert plan.duration_s == pytest.approx(2 * quick.duration_s, rel=1e-6)


def test_settings_are_kept_to() -> None:
    """Without draws from the prior, a cascade goes from the line to samples."""
    planner = Planner(ARM, PlannerSettings(prior_starts=0, iterations=1))
    plan = planner.plan(CAGE, np.zeros(3), np.array([np.pi / 2, 0.0, 0.0]), budget=0.3)
    assert {attempt.start for attempt in plan.attempts} == {"line", "sampled"}


def test_prismatic_and_unbounded_joints_in_space(tmp_path: Path) -> None:
    robot = read_robot(write(tmp_path, "bent.urdf", URDF))
    planner = Planner(robot)
    scene = make_scene([Sphere([0.25, 0.0, 0.75], 0.05), Box([-0.4, 0.0, 0.6], [0.05, 0.3, 0.3])])
    generator = np.random.default_rng(0)
    found = 0
    for _ in range(10):
        ends = robot.chain.lower + generator.uniform(0.1, 0.9, (2, 3)) * (robot.chain.upper - robot.chain.lower)
        if all(valid(robot.chain, scene.obstacles, end, 0.0) for end in ends):
            plan = planner.plan(scene, ends[0], ends[1], budget=2.0)
            if plan.success:
                check(plan, scene, ends[0], ends[1])
                found += 1
    assert found >= 3
