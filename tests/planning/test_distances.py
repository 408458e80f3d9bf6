"""Signed distances against MuJoCo's and against brute force, and their gradients against finite differences."""

from typing import Any

import mujoco
import numpy as np
import pytest

from predplan.planning.distances import anything_within, count, nearest
from predplan.planning.robots import FloatArray
from predplan.planning.scenes import Box, Capsule, Cylinder, Mesh, Scene, Shape, Sphere, make_scene
from tests.planning.models import nearest_to, random_rotation

RADIUS = 0.01
GENERATOR = np.random.default_rng(0)
CLOUD = GENERATOR.standard_normal((20, 3)) * [0.3, 0.2, 0.4]
CUBE = np.stack(np.meshgrid(*[(-0.3, 0.3)] * 3), axis=-1).reshape(-1, 3)
SHAPES: dict[str, tuple[Shape, str]] = {
    "box": (Box([0.1, 0.2, 0.3], [0.3, 0.1, 0.2], random_rotation(GENERATOR)), 'type="box" size=".3 .1 .2"'),
    "sphere": (Sphere([0.1, 0.2, 0.3], 0.25), 'type="sphere" size=".25"'),
    "capsule": (Capsule([0.1, 0.2, 0.1], [0.1, 0.2, 0.5], 0.15), 'type="capsule" size=".15 .2"'),
    "cylinder": (
        Cylinder([0.1, 0.2, 0.3], 0.3, 0.2, random_rotation(GENERATOR)),
        'type="cylinder" size=".2 .3"',
    ),
    "mesh": (Mesh(np.add(CLOUD, [0.1, 0.2, 0.3])), 'type="mesh" mesh="cloud"'),
}


def mujoco_distance(kind: str, shape: Shape) -> tuple[Any, Any]:
    """A model of the shape and of a small sphere, whose place is set by hand."""
    vertices = " ".join(str(value) for value in CLOUD.ravel())
    model = mujoco.MjModel.from_xml_string(
        f'<mujoco><option ccd_tolerance="1e-12" ccd_iterations="500"/><asset><mesh name="cloud" vertex="{vertices}"/>'
        f'</asset><worldbody><geom {SHAPES[kind][1]}/><body><freejoint/><geom type="sphere" size="{RADIUS}"/></body>'
        "</worldbody></mujoco>"
    )
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    if kind == "mesh":
        data.geom_xpos[0] += [0.1, 0.2, 0.3]
    else:
        data.geom_xpos[0] = [0.1, 0.2, 0.3]
        data.geom_xmat[0] = np.asarray(getattr(shape, "rotation", np.eye(3))).ravel()
    return model, data


def signed(scene: Scene, point: FloatArray) -> float:
    return nearest_to(scene.obstacles, point)[0]


@pytest.mark.parametrize("kind", SHAPES)
def test_distances_are_mujocos(kind: str) -> None:
    shape = SHAPES[kind][0]
    scene = make_scene([shape])
    model, data = mujoco_distance(kind, shape)
    outside = inside = 0
    for point in np.random.default_rng(1).normal([0.1, 0.2, 0.3], 0.35, (400, 3)):
        data.geom_xpos[1] = point
        expected = mujoco.mj_geomDistance(model, data, 0, 1, 100.0, np.zeros(6)) + RADIUS
        found = signed(scene, point)
        # Where the spheres overlap a mesh MuJoCo's iteration finds some separating direction, not always the nearest.
        if kind != "mesh" or expected > RADIUS:
            assert found == pytest.approx(expected, abs=1e-6)
        outside, inside = outside + (found > 0), inside + (found < 0)
    assert min(outside, inside) > 10


@pytest.mark.parametrize("kind", SHAPES)
def test_distances_inside_are_to_the_nearest_place_outside(kind: str) -> None:
    scene = make_scene([SHAPES[kind][0]])
    generator = np.random.default_rng(2)
    points = generator.normal([0.1, 0.2, 0.3], 0.15, (60, 3))
    depths = np.array([-signed(scene, point) for point in points])
    directions = generator.standard_normal((4000, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    for point, depth in zip(points[depths > 0.01], depths[depths > 0.01], strict=True):
        ball = [signed(scene, point + 0.999 * depth * direction) for direction in directions]
        assert max(ball) < 0.0  # the ball of that radius is inside
        sphere = [signed(scene, point + 1.02 * depth * direction) for direction in directions]
        assert max(sphere) > 0.0  # and no larger one


@pytest.mark.parametrize("kind", SHAPES)
def test_gradients_are_unit_vectors_and_finite_differences(kind: str) -> None:
    obstacles = make_scene([SHAPES[kind][0]]).obstacles
    step = 1e-6
    for point in np.random.default_rng(3).normal([0.1, 0.2, 0.3], 0.35, (200, 3)):
        gradient = nearest_to(obstacles, point)[1]
        assert np.linalg.norm(gradient) == pytest.approx(1.0)
        ahead, behind = (
            np.array([nearest_to(obstacles, point + sign * step * e)[0] for e in np.eye(3)]) for sign in (1, -1)
        )
        np.testing.assert_allclose(gradient, (ahead - behind) / (2 * step), atol=1e-4)


def test_the_nearest_of_many_is_named_and_a_ceiling_is_kept() -> None:
    generator = np.random.default_rng(4)
    shapes: list[Shape] = []
    for i in range(30):
        centre, turned = generator.uniform(-1, 1, 3), random_rotation(generator)
        small: list[Shape] = [
            Box(centre, generator.uniform(0.05, 0.2, 3), turned),
            Sphere(centre, 0.1),
            Capsule(centre, centre + generator.normal(0, 0.1, 3), 0.05),
            Cylinder(centre, 0.1, 0.1, turned),
            Mesh(centre + generator.normal(0, 0.1, (8, 3))),
        ]
        shapes.append(small[i % 5])
    scene = make_scene(shapes)
    alone = [make_scene([shape]) for shape in scene.shapes]
    assert count(scene.obstacles) == len(scene.names) == 30
    for point in generator.uniform(-1, 1, (300, 3)):
        distances = np.array([signed(one, point) for one in alone])
        least = int(np.argmin(distances))
        for ceiling in (100.0, 0.05, 0.0, -0.02):
            distance, gradient, which = nearest_to(scene.obstacles, point, ceiling)
            if distances[least] < ceiling:
                assert distance == pytest.approx(distances[least])
                assert which == least
            else:
                assert (distance, gradient.tolist(), which) == (ceiling, [0.0, 0.0, 0.0], -1)
            x, y, z = point.tolist()
            assert anything_within(scene.obstacles, x, y, z, ceiling) == (distances[least] < ceiling)


def test_an_empty_scene_is_far_from_everything() -> None:
    empty = make_scene([]).obstacles
    assert nearest(empty, 0.0, 0.0, 0.0, 0.5) == (0.5, 0.0, 0.0, 0.0, -1)
    assert not anything_within(empty, 0.0, 0.0, 0.0, 10.0)


def test_a_hull_of_a_cube_is_the_box() -> None:
    hull, box = make_scene([Mesh(CUBE)]).obstacles, make_scene([Box([0, 0, 0], [0.3, 0.3, 0.3])]).obstacles
    for point in np.random.default_rng(5).uniform(-0.6, 0.6, (300, 3)):
        found, expected = nearest_to(hull, point), nearest_to(box, point)
        assert found[0] == pytest.approx(expected[0])
        np.testing.assert_allclose(found[1], expected[1], atol=1e-9)


def test_centres_and_axes_have_some_direction() -> None:
    for shape in (Sphere([0, 0, 0], 0.1), Cylinder([0, 0, 0], 0.3, 0.1), Box([0, 0, 0], [0.1, 0.2, 0.3])):
        distance, gradient, _ = nearest_to(make_scene([shape]).obstacles, [0.0, 0.0, 0.0])
        assert distance == pytest.approx(-0.1)
        assert np.linalg.norm(gradient) == pytest.approx(1.0)
