"""Fitted spheres cover the geometry, and reach outside it no farther than they say."""

import numpy as np
import pytest

from predplan.errors import InputError
from predplan.planning.robots import FloatArray
from predplan.planning.scenes import Box, Capsule, Cylinder, Mesh, Shape, Sphere, make_scene
from predplan.planning.spheres import fit_spheres
from tests.planning.models import nearest_to, random_rotation

GENERATOR = np.random.default_rng(0)
TURNED = random_rotation(GENERATOR)
BODIES: dict[str, list[Shape]] = {
    "box": [Box([0.1, 0, 0], [0.1, 0.05, 0.2], TURNED)],
    "plate": [Box([0, 0, 0], [0.1, 0.1, 0.001])],
    "capsule": [Capsule([0, 0, 0], [0.1, 0.2, 0.3], 0.04)],
    "cylinder": [Cylinder([0, 0.1, 0], 0.2, 0.06, TURNED)],
    "disc": [Cylinder([0, 0.1, 0], 0.005, 0.1)],
    "mesh": [Mesh(GENERATOR.normal(0, 0.1, (40, 3)))],
    "several": [
        Sphere([0, 0, 0], 0.08),
        Capsule([0, 0, 0.05], [0, 0, 0.3], 0.03),
        Box([0, 0, 0.3], [0.02, 0.1, 0.05], TURNED),
        Mesh(GENERATOR.normal([0, 0.1, 0.1], 0.05, (20, 3))),
    ],
}


def points_of(shape: Shape, count: int) -> FloatArray:
    """Random points of a shape, corners and edges among them."""
    generator = np.random.default_rng(1)
    if isinstance(shape, Mesh):
        weights = generator.dirichlet(np.full(len(np.asarray(shape.vertices)), 0.1), count)
        return np.asarray(weights @ np.asarray(shape.vertices))
    bound = np.clip(generator.uniform(-1.5, 1.5, (count, 3)), -1, 1)  # a third of each coordinate lies on a face
    if isinstance(shape, Box):
        return np.asarray(bound * np.asarray(shape.half) @ np.asarray(shape.rotation).T + np.asarray(shape.centre))
    if isinstance(shape, Cylinder):
        angle, radius = generator.uniform(0, 2 * np.pi, count), shape.radius * np.sqrt(np.abs(bound[:, 0]))
        local = np.stack([radius * np.cos(angle), radius * np.sin(angle), shape.half * bound[:, 2]], axis=1)
        return np.asarray(local @ np.asarray(shape.rotation).T + np.asarray(shape.centre))
    directions = generator.standard_normal((count, 3))
    offsets = shape.radius * np.abs(bound[:, :1]) * directions / np.linalg.norm(directions, axis=1, keepdims=True)
    if isinstance(shape, Sphere):
        return np.asarray(np.asarray(shape.centre) + offsets)
    share = (bound[:, 1:2] + 1) / 2
    return np.asarray((1 - share) * np.asarray(shape.a) + share * np.asarray(shape.b) + offsets)


@pytest.mark.parametrize("tolerance", [0.02, 0.04])
@pytest.mark.parametrize("body", BODIES)
def test_spheres_cover_and_stay_within_the_tolerance(body: str, tolerance: float) -> None:
    shapes = BODIES[body]
    spheres = fit_spheres(shapes, tolerance, body)
    for shape in shapes:
        points = points_of(shape, 10000)
        for part in np.array_split(points, 20):
            apart = np.linalg.norm(part[:, None] - spheres.centres[None], axis=2) - spheres.radii
            assert apart.min(axis=1).max() <= 1e-9
    assert 0 < spheres.overshoot <= tolerance + 1e-8
    obstacles = make_scene(shapes).obstacles
    directions = np.random.default_rng(2).standard_normal((500, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    for centre, radius in zip(spheres.centres, spheres.radii, strict=True):
        farthest = max(nearest_to(obstacles, centre + radius * d)[0] for d in directions)
        assert farthest <= spheres.overshoot + 1e-9


def test_few_spheres_are_enough_and_finer_ones_are_more() -> None:
    arm = [Capsule([0, 0, 0], [0, 0, 0.4], 0.06)]
    counts = [len(fit_spheres(arm, tolerance, "arm").radii) for tolerance in (0.03, 0.015)]
    assert counts == sorted(counts)
    assert counts[0] <= 5
    assert len(fit_spheres(BODIES["box"], 0.03, "box").radii) <= 40


def test_a_body_of_spheres_stays_as_it_is() -> None:
    balls = [Sphere([0, 0, 0], 0.1), Sphere([0, 0, 0.5], 0.2)]
    spheres = fit_spheres(balls, 0.01, "balls")
    assert spheres.centres.tolist() == [[0, 0, 0], [0, 0, 0.5]]
    assert (spheres.radii.tolist(), spheres.overshoot) == ([0.1, 0.2], 0.0)


def test_a_tolerance_must_be_positive_and_a_mesh_solid() -> None:
    with pytest.raises(InputError, match=r"arm: sphere tolerance 0.0; expected more than zero"):
        fit_spheres(BODIES["box"], 0.0, "arm")
    with pytest.raises(InputError, match="leaf: 3 points without volume"):
        fit_spheres([Mesh([[0, 0, 0], [1, 0, 0], [0, 1, 0]])], 0.01, "leaf")
