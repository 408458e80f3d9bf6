"""Scenes made in code: order, names, what is refused, and moved shapes."""

from typing import Any

import numpy as np
import pytest

from predplan.errors import InputError
from predplan.planning.scenes import Box, Capsule, Cylinder, Mesh, Shape, Sphere, make_scene, moved
from tests.planning.models import nearest_to, random_rotation

TETRAHEDRON = [[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]]


def test_obstacles_are_numbered_by_kind_and_keep_their_names() -> None:
    scene = make_scene([Mesh(TETRAHEDRON, "rock"), Sphere([0, 0, 0], 1), Box([0, 0, 0], [1, 1, 1], name="crate")])
    assert scene.names == ("crate", "sphere1", "rock")
    assert scene.obstacles.hull_first.tolist() == [0, 4]
    assert scene.obstacles.capsule_a.tolist() == scene.obstacles.capsule_b.tolist()
    assert all(array.flags.c_contiguous for array in scene.obstacles)


def test_distances_move_with_the_shapes() -> None:
    generator = np.random.default_rng(0)
    shapes: list[Shape] = [
        Box([0.1, 0, 0], [0.1, 0.2, 0.3]),
        Sphere([0, 1, 0], 0.1),
        Capsule([0, 0, 1], [0, 1, 1], 0.1),
        Cylinder([1, 0, 0], 0.1, 0.2),
        Mesh(TETRAHEDRON),
    ]
    for shape in shapes:
        rotation, translation = random_rotation(generator), generator.standard_normal(3)
        before, after = make_scene([shape]).obstacles, make_scene([moved(shape, rotation, translation)]).obstacles
        for point in generator.normal(0, 1, (20, 3)):
            distance, gradient, _ = nearest_to(before, point)
            found, turned, _ = nearest_to(after, rotation @ point + translation)
            assert found == pytest.approx(distance)
            np.testing.assert_allclose(turned, rotation @ gradient, atol=1e-9)


@pytest.mark.parametrize(
    ("shape", "message"),
    [
        (Box([0, 0, np.nan], [1, 1, 1], name="crate"), "crate: centre is .*nan.*; expected finite numbers"),
        (Box([0, 0, 0], [1, -1, 1], name="crate"), "crate: half is .*; expected more than zero"),
        (Box([0, 0], [1, 1, 1], name="crate"), r"crate: centre has shape \(2,\); expected \(3,\)"),
        (Box([0, 0, 0], [1, 1, 1], 2 * np.eye(3), name="crate"), "crate: the rotation's rows are not orthonormal"),
        (Sphere([0, 0, 0], 0.0, "ball"), "ball: radius is 0.0 m; expected more than zero"),
        (Cylinder([0, 0, 0], -0.1, 1, name="can"), "can: half is -0.1 m; expected more than zero"),
        (Capsule([0, 0, 0], [0, 0, np.inf], 0.1, "pole"), "pole: b is .*inf.*; expected finite numbers"),
        (Mesh([[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0]], "leaf"), "leaf: 4 points without volume"),
        (Mesh([[0, 0], [1, 0]], "leaf"), r"leaf: vertices have shape \(2, 2\); expected \[n, 3\]"),
        (Mesh([[0, 0, 0]], "leaf"), "leaf: 1 points without volume"),
    ],
)
def test_what_is_no_solid_is_refused_by_name(shape: Any, message: str) -> None:
    with pytest.raises(InputError, match=f"room.yaml: {message}"):
        make_scene([shape], source="room.yaml")
