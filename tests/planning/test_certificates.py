"""Certificates: nothing thin is missed, nothing depends on samples, and what is called free is free."""

from itertools import pairwise
from pathlib import Path as File

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from predplan.planning.certificates import certify, prove
from predplan.planning.collisions import valid
from predplan.planning.kinematics import poses
from predplan.planning.paths import Path, polyline, quintic
from predplan.planning.plan_files import clearance_of
from predplan.planning.robot_files import read_robot
from predplan.planning.robots import FloatArray, Robot, planar_arm, point_robot
from predplan.planning.scenes import Box, Scene, Sphere, make_scene
from tests.planning.models import URDF, write
from tests.planning.paths import raised, random_path, random_scene, split

ARM = planar_arm([0.5, 0.4, 0.3], radius=0.03)
EMPTY = make_scene([])
SEEDS = st.integers(0, 2**32 - 1)


@pytest.fixture(scope="module")
def bent(tmp_path_factory: pytest.TempPathFactory) -> Robot:
    """A prismatic, a bounded and an unbounded joint in space."""
    return read_robot(write(File(tmp_path_factory.mktemp("robot")), "bent.urdf", URDF))


def collisions(robot: Robot, scene: Scene, path: Path, samples: int = 2000) -> int:
    """How many samples of the path are not valid."""
    q = path(np.linspace(0, 1, samples))
    return sum(not valid(robot.chain, scene.obstacles, row, 0.0) for row in q)


def outside(robot: Robot, q: FloatArray) -> bool:
    return bool(np.any(q < robot.chain.lower) or np.any(q > robot.chain.upper))


@settings(max_examples=60, deadline=None)
@given(SEEDS)
def test_what_is_certified_is_never_found_in_collision(bent: Robot, seed: int) -> None:
    """And what is refused is in collision, or outside limits, at the very place that the verdict names."""
    generator = np.random.default_rng(seed)
    robot = (ARM, bent)[seed % 2]
    scene = random_scene(generator, int(generator.integers(0, 6)), 1.0)
    path = random_path(robot, generator, share=generator.uniform(0.05, 1.0))
    verdict = certify(robot, scene, path)
    if verdict.free:
        q = path(np.linspace(0, 1, 2000))
        assert not outside(robot, q)
        assert collisions(robot, scene, path) == 0
    else:
        assert "neither" not in verdict.reason
        q = path(np.array([verdict.s]))[0]
        assert outside(robot, q) or not valid(robot.chain, scene.obstacles, q, 0.0)


@settings(max_examples=40, deadline=None)
@given(SEEDS)
def test_a_path_cut_otherwise_has_the_same_verdict(bent: Robot, seed: int) -> None:
    """Cut at random places, slowed and hastened piece by piece, written with a higher degree, or backwards."""
    generator = np.random.default_rng(seed)
    robot = (ARM, bent)[seed % 2]
    scene = random_scene(generator, 3, 1.0)
    path = random_path(robot, generator, share=generator.uniform(0.05, 0.5))
    free = certify(robot, scene, path).free
    cut = split(path, generator.uniform(0, 1, 7))
    at = np.linspace(0, 1, 101)
    np.testing.assert_allclose(cut(at), path(at), atol=1e-12)
    assert certify(robot, scene, cut).free == free
    steps = generator.uniform(0.01, 1, len(cut.breaks) - 1)
    retimed = Path(np.concatenate([[0], np.cumsum(steps) / steps.sum()]), cut.coefficients)
    assert certify(robot, scene, retimed).free == free
    np.testing.assert_allclose(raised(path)(at), path(at), atol=1e-12)
    assert certify(robot, scene, raised(path)).free == free
    backwards = Path(1 - path.breaks[::-1], path.coefficients[::-1, ::-1])
    assert certify(robot, scene, backwards).free == free


@pytest.mark.parametrize("thickness", [1e-4, 1e-5, 1e-6])
def test_plates_thinner_than_any_step_are_found(thickness: float) -> None:
    """A point crosses a plate within 1e-4 to 1e-6 of its way, between all of 2000 samples."""
    robot, generator = point_robot(0.0), np.random.default_rng(1)
    path = quintic(
        np.linspace(0, 1, 4),
        np.array([[0.1, 0.1], [0.3, 0.7], [0.7, 0.8], [0.9, 0.2]]),
        np.array([[0.5, 1.0], [1.0, 1.0], [1.0, -0.5], [0.5, -1.0]]),
        np.zeros((4, 2)),
    )
    missed = 0
    for s in generator.uniform(0.02, 0.98, 50):
        place, heading = path(np.array([s]))[0], path(np.array([s]), 1)[0]
        along = np.array([*heading, 0.0]) / np.linalg.norm(heading)
        rotation = np.stack([along, np.cross([0, 0, 1], along), [0, 0, 1]], axis=1)
        plate = Box([*place, 0.0], [thickness / 2, 0.01, 0.01], rotation, "plate")
        verdict = certify(robot, make_scene([plate]), path)
        assert not verdict.free
        assert verdict.reason.startswith("point meets plate")
        assert verdict.s == pytest.approx(s, abs=2 * thickness)
        missed += collisions(robot, make_scene([plate]), path) == 0
    assert missed >= 35


@pytest.mark.parametrize("thickness", [1e-4, 1e-6])
def test_plates_in_the_way_of_an_arm_are_found(bent: Robot, thickness: float) -> None:
    """Small plates at the skin of a link, wherever on its way and on its body."""
    generator = np.random.default_rng(2)
    path = random_path(bent, generator, share=0.4)
    assert certify(bent, EMPTY, path).free
    for s in generator.uniform(0.02, 0.98, 30):
        (rotations,), (positions,) = poses(bent.chain, path(np.array([s])))
        sphere = int(generator.integers(np.count_nonzero(bent.chain.sphere_frame == 0), len(bent.chain.sphere_radius)))
        frame = bent.chain.sphere_frame[sphere]
        centre = rotations[frame] @ bent.chain.sphere_centre[sphere] + positions[frame]
        out = generator.standard_normal(3)
        out *= bent.chain.sphere_radius[sphere] / np.linalg.norm(out)
        plate = Box(centre + 0.99 * out, [thickness / 2] * 3)
        assert not certify(bent, make_scene([plate]), path).free


@pytest.mark.parametrize("depth", [1e-3, 1e-5, 1e-7])
def test_a_graze_is_told_from_a_near_miss(depth: float) -> None:
    """The arm's tip passes a ball, `depth` within reach or out of it, for a ten-thousandth of the way."""
    path = polyline(np.array([[-1.0, 0.0, 0.0], [1.0, 0.0, 0.0]]))
    reach = 0.5 + 0.4 + 0.3 + 0.03
    for side in (-1, 1):
        angle = 0.3217
        ball = Sphere((reach + 0.05 + side * depth) * np.array([np.cos(angle), np.sin(angle), 0.0]), 0.05, "ball")
        verdict = certify(ARM, make_scene([ball]), path)
        assert verdict.free == (side > 0)
        if side < 0:
            assert verdict.s == pytest.approx((1 + angle) / 2, abs=0.1)
            assert "link3 meets ball" in verdict.reason


def test_exact_contact_is_never_called_free() -> None:
    """Whether rounding makes it a touch or not, a proof may fail or end undecided, but soon."""
    path = polyline(np.array([[-1.0, 0.0, 0.0], [1.0, 0.0, 0.0]]))
    verdict = certify(ARM, make_scene([Sphere([1.2 + 0.03 + 0.05, 0.0, 0.0], 0.05)]), path)
    assert not verdict.free
    assert verdict.configurations < 200_000


@settings(max_examples=25, deadline=None)
@given(SEEDS)
def test_the_margin_that_is_there_is_proved(seed: int) -> None:
    generator = np.random.default_rng(seed)
    path = random_path(ARM, generator, share=0.3)
    scene = make_scene([Sphere(generator.uniform(-1.2, 1.2, 3), 0.1), Box(generator.uniform(-1.2, 1.2, 3), [0.1] * 3)])
    times = np.linspace(0, 1, 2001)
    least = clearance_of(ARM, scene, times, path(times)).values.min()
    assert certify(ARM, scene, path, least - 2e-3).free
    assert not certify(ARM, scene, path, least + 1e-4).free


@pytest.mark.parametrize("excess", [1e-2, 1e-4, 1e-6])
def test_limits_exceeded_between_knots_are_found(excess: float) -> None:
    """Knots lie within the limits; in between a joint goes beyond by 0.01 to 1e-6 rad, or stays as far inside."""
    upper = ARM.chain.upper[0]
    for side in (-1, 1):
        knots = np.zeros((2, 3))
        bump = quintic(np.array([0.0, 1.0]), knots, np.array([[1.0, 0, 0], [-1.0, 0, 0]]), np.zeros((2, 3)))
        top = bump(np.array([0.5]))[0, 0]
        knots[:, 0] = upper + side * excess - top
        path = quintic(np.array([0.0, 1.0]), knots, np.array([[1.0, 0, 0], [-1.0, 0, 0]]), np.zeros((2, 3)))
        verdict = certify(ARM, EMPTY, path)
        assert verdict.free == (side < 0)
        if side > 0:
            assert verdict.reason.startswith("joint1 leaves its limits")
            assert path(np.array([verdict.s]))[0, 0] > upper


def test_a_path_along_its_limits_is_free() -> None:
    path = polyline(np.array([ARM.chain.upper, ARM.chain.upper - [0.0, 2.5, 3.0]]))
    start_free = valid(ARM.chain, EMPTY.obstacles, path(np.zeros(1))[0], 0.0)
    assert certify(ARM, EMPTY, path).free == start_free
    straight = polyline(np.array([[np.pi, 0.0, 0.0], [-np.pi, 0.0, 0.0]]))
    assert certify(ARM, EMPTY, straight).free


def test_links_that_fold_onto_one_another_are_found() -> None:
    """The third link sweeps over the first."""
    path = polyline(np.array([[0.0, 2.3, 0.0], [0.0, 2.3, 2.9]]))
    verdict = certify(ARM, EMPTY, path)
    assert not verdict.free
    assert "link1 meets link3" in verdict.reason
    q = path(np.array([verdict.s]))[0]
    assert not valid(ARM.chain, EMPTY.obstacles, q, 0.0)


def test_a_path_that_stands_still_needs_one_look_a_piece() -> None:
    path = polyline(np.zeros((1, 3)))
    verdict = certify(ARM, EMPTY, path)
    assert (verdict.free, verdict.configurations) == (True, 1)


def test_a_proof_that_may_look_at_few_configurations_gives_up() -> None:
    path = polyline(np.array([[-1.0, 0.0, 0.0], [1.0, 0.0, 0.0]]))
    scene = make_scene([Sphere([1.25 + 0.06, 0.0, 0.0], 0.05)])
    assert certify(ARM, scene, path).free
    verdict = prove(ARM.chain, scene.obstacles, path.breaks, path.coefficients, 0.0, 2)
    assert (verdict.kind, verdict.configurations) == (4, 2)


def test_pieces_meet() -> None:
    """The test's own subdivision keeps paths whole."""
    path = random_path(ARM, np.random.default_rng(0))
    cut = split(path, np.array([0.1, 0.26, 0.5001]))
    assert len(cut.breaks) == len(path.breaks) + 3
    for left, right in pairwise(cut.coefficients):
        np.testing.assert_allclose(left[-1], right[0], atol=1e-12)
