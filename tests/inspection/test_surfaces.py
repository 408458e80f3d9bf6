import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial import ConvexHull
from scipy.spatial.transform import Rotation

from predplan.artifacts.recordings import Mesh, Primitive, Solid
from predplan.inspection.surfaces import Surface, surface_of

WHITE = (1.0, 1.0, 1.0, 1.0)
VOLUMES = {"cube": 1.0, "sphere": np.pi / 6.0, "cylinder": np.pi / 4.0}


def volume(surface: Surface) -> float:
    a, b, c = np.swapaxes(surface.vertices[surface.triangles], 0, 1)
    return float(np.einsum("ij,ij->", a, np.cross(b, c)) / 6.0)


def agreement(surface: Surface) -> float:
    """Least cosine between a corner's normal and its face's."""
    a, b, c = np.swapaxes(surface.vertices[surface.triangles], 0, 1)
    faces = np.cross(b - a, c - a)
    size = np.linalg.norm(faces, axis=1)
    kept = size > 1e-12
    cosines = np.einsum("ij,ikj->ik", faces[kept] / size[kept, None], surface.normals[surface.triangles[kept]])
    return float(cosines.min())


@given(
    kind=st.sampled_from(["cube", "sphere", "cylinder"]),
    size=st.tuples(*[st.floats(0.05, 5.0)] * 3),
    centre=st.tuples(*[st.floats(-2.0, 2.0)] * 3),
    angles=st.tuples(*[st.floats(-3.0, 3.0)] * 3),
)
def test_primitives_have_their_size_and_are_turned_outwards(
    kind: str, size: tuple[float, ...], centre: tuple[float, ...], angles: tuple[float, ...]
) -> None:
    turn = Rotation.from_euler("xyz", angles)
    solid = Primitive("a", kind, np.array(centre), turn.as_quat(), np.array(size), WHITE)  # type: ignore[arg-type]
    surface = surface_of([solid])
    assert volume(surface) == pytest.approx(VOLUMES[kind] * np.prod(size), rel=0.01)
    local = turn.inv().apply(surface.vertices - centre)
    np.testing.assert_allclose(np.ptp(local, axis=0), size, rtol=0.01)
    np.testing.assert_allclose(np.linalg.norm(surface.normals, axis=1), 1.0)
    assert agreement(surface) > 0.0


def test_a_mesh_keeps_its_edges_and_is_smooth_elsewhere() -> None:
    cube = ConvexHull(np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)], float))
    flat = surface_of([oriented(cube)])
    assert len(flat.vertices) == 24
    assert agreement(flat) == pytest.approx(1.0)
    points = np.random.default_rng(0).normal(size=(2000, 3))
    points /= np.linalg.norm(points, axis=1, keepdims=True)
    ball = surface_of([oriented(ConvexHull(points))])
    assert len(ball.vertices) == 2000
    np.testing.assert_allclose(ball.normals, ball.vertices, atol=0.15)  # the triangles are uneven


def test_faces_without_area_are_left_out_and_vertices_welded() -> None:
    vertices = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0]], float)
    surface = surface_of([Mesh("a", vertices, np.array([[0, 1, 2], [3, 5, 4], [0, 0, 1]]), WHITE)])
    assert (len(surface.vertices), len(surface.triangles)) == (4, 2)
    np.testing.assert_allclose(surface.normals, np.tile([0, 0, 1], (4, 1)))


def test_several_solids_become_one_surface() -> None:
    cube: Solid = Primitive("a", "cube", np.zeros(3), np.array([0, 0, 0, 1.0]), np.ones(3), WHITE)
    surface = surface_of([cube, cube])
    assert volume(surface) == pytest.approx(2.0)
    assert surface.triangles.max() == len(surface.vertices) - 1


def oriented(hull: ConvexHull) -> Mesh:
    """A convex hull with its faces turned outwards."""
    corners = hull.points[hull.simplices]
    edges = np.diff(corners, axis=1)
    inwards = np.einsum("ij,ij->i", np.cross(edges[:, 0], edges[:, 1]), hull.equations[:, :3]) < 0
    return Mesh("a", hull.points, np.where(inwards[:, None], hull.simplices[:, ::-1], hull.simplices), WHITE)
