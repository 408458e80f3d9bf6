"""Scenes: convex obstacles, as shapes to write down and as arrays for compiled code."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import NamedTuple, TypeVar

import numpy as np
from numpy.typing import ArrayLike

from predplan.errors import InputError
from predplan.planning.robots import FloatArray, IntArray


def _identity() -> FloatArray:
    return np.eye(3)


@dataclass(frozen=True)
class Box:
    """centre [3] m, half extents [3] m along the columns of rotation [3, 3]."""

    centre: ArrayLike
    half: ArrayLike
    rotation: ArrayLike = field(default_factory=_identity)
    name: str = ""


@dataclass(frozen=True)
class Sphere:
    """centre [3] m, radius m."""

    centre: ArrayLike
    radius: float
    name: str = ""


@dataclass(frozen=True)
class Capsule:
    """All points within `radius` m of the segment from a [3] m to b [3] m."""

    a: ArrayLike
    b: ArrayLike
    radius: float
    name: str = ""


@dataclass(frozen=True)
class Cylinder:
    """centre [3] m, half its height and its radius in m; its axis is the third column of rotation [3, 3]."""

    centre: ArrayLike
    half: float
    radius: float
    rotation: ArrayLike = field(default_factory=_identity)
    name: str = ""


@dataclass(frozen=True)
class Mesh:
    """The convex hull of vertices [n, 3] m; a mesh that is not convex is filled up, as MuJoCo fills it."""

    vertices: ArrayLike
    name: str = ""


Shape = Box | Sphere | Capsule | Cylinder | Mesh
AnyShape = TypeVar("AnyShape", bound=Box | Sphere | Capsule | Cylinder | Mesh)


class Obstacles(NamedTuple):
    """A scene as compiled code takes it. Obstacles are numbered boxes first, then capsules, cylinders and hulls."""

    box_rotation: FloatArray  # [B, 3, 3]
    box_centre: FloatArray  # [B, 3] m
    box_half: FloatArray  # [B, 3] m
    capsule_a: FloatArray  # [C, 3] m; a sphere is a capsule with a = b
    capsule_b: FloatArray  # [C, 3] m
    capsule_radius: FloatArray  # [C] m
    cylinder_rotation: FloatArray  # [Y, 3, 3], the axis its third column
    cylinder_centre: FloatArray  # [Y, 3] m
    cylinder_half: FloatArray  # [Y] m
    cylinder_radius: FloatArray  # [Y] m
    hull_first: IntArray  # [M + 1] hull m has the triangles and planes hull_first[m] .. hull_first[m + 1]
    triangle: FloatArray  # [T, 3, 3] m, corner by corner
    plane: FloatArray  # [T, 4] outward unit normal n and offset d of each triangle: n·x + d <= 0 inside
    hull_centre: FloatArray  # [M, 3] m, of a sphere that holds the hull
    hull_radius: FloatArray  # [M] m


@dataclass(frozen=True)
class Scene:
    """What the robot must not touch."""

    name: str
    obstacles: Obstacles
    names: tuple[str, ...]  # of each obstacle, in the order of its number
    shapes: tuple[Shape, ...] = ()  # likewise
    source: str = ""  # the file, "" if made in code
    larger: tuple[Scene, ...] = ()  # the same with solids no smaller, the largest first; see read_scene


def make_scene(shapes: Sequence[Shape], name: str = "scene", source: str = "") -> Scene:
    """A scene of shapes; a shape without a name is called by its kind and number.

    Raises InputError, naming the shape, for numbers that are not finite, sizes that are not positive, rotations that
    are not, and a mesh without volume.
    """
    named = [shape if shape.name else replace(shape, name=f"{_kind(shape)}{i}") for i, shape in enumerate(shapes)]
    file = f"{source}: " if source else ""
    boxes = [_checked(shape, file) for shape in named if isinstance(shape, Box)]
    capsules = [_checked(shape, file) for shape in named if isinstance(shape, Capsule | Sphere)]
    cylinders = [_checked(shape, file) for shape in named if isinstance(shape, Cylinder)]
    meshes = [_checked(shape, file) for shape in named if isinstance(shape, Mesh)]
    ends = [(shape.centre, shape.centre) if isinstance(shape, Sphere) else (shape.a, shape.b) for shape in capsules]
    hulls = [convex_hull(mesh.vertices, file + mesh.name) for mesh in meshes]
    spheres = [_holding_sphere(hull) for hull in hulls]
    obstacles = Obstacles(
        box_rotation=_array([box.rotation for box in boxes], 3, 3),
        box_centre=_array([box.centre for box in boxes], 3),
        box_half=_array([box.half for box in boxes], 3),
        capsule_a=_array([a for a, _ in ends], 3),
        capsule_b=_array([b for _, b in ends], 3),
        capsule_radius=_array([capsule.radius for capsule in capsules]),
        cylinder_rotation=_array([cylinder.rotation for cylinder in cylinders], 3, 3),
        cylinder_centre=_array([cylinder.centre for cylinder in cylinders], 3),
        cylinder_half=_array([cylinder.half for cylinder in cylinders]),
        cylinder_radius=_array([cylinder.radius for cylinder in cylinders]),
        hull_first=np.cumsum([0, *(len(hull.planes) for hull in hulls)], dtype=np.int64),
        triangle=_array([triangle for hull in hulls for triangle in hull.triangles], 3, 3),
        plane=_array([plane for hull in hulls for plane in hull.planes], 4),
        hull_centre=_array([centre for centre, _ in spheres], 3),
        hull_radius=_array([radius for _, radius in spheres]),
    )
    ordered = (*boxes, *capsules, *cylinders, *meshes)
    return Scene(name, obstacles, tuple(shape.name for shape in ordered), ordered, source)


class Hull(NamedTuple):
    """Triangles [T, 3, 3] m and their outward planes [T, 4] (n·x + d <= 0 inside)."""

    triangles: FloatArray
    planes: FloatArray


def convex_hull(vertices: ArrayLike, name: str) -> Hull:
    """The convex hull of points [n, 3]; raises InputError, with the mesh's name, where they have no volume."""
    from scipy.spatial import ConvexHull, QhullError  # half a second that scenes without meshes need not wait

    points = np.asarray(vertices, dtype=np.float64)
    try:
        hull = ConvexHull(points)
    except (QhullError, ValueError) as error:
        raise InputError(f"{name}: {len(points)} points without volume; expected a solid mesh") from error
    return Hull(points[hull.simplices], np.asarray(hull.equations))


def moved(shape: AnyShape, rotation: FloatArray, translation: FloatArray) -> AnyShape:
    """The shape turned by rotation [3, 3], then moved by translation [3] m."""
    if isinstance(shape, Capsule):
        return replace(
            shape,
            a=rotation @ np.asarray(shape.a, dtype=np.float64) + translation,
            b=rotation @ np.asarray(shape.b, dtype=np.float64) + translation,
        )
    if isinstance(shape, Mesh):
        return replace(shape, vertices=np.asarray(shape.vertices, dtype=np.float64) @ rotation.T + translation)
    centre = rotation @ np.asarray(shape.centre, dtype=np.float64) + translation
    if isinstance(shape, Sphere):
        return replace(shape, centre=centre)
    return replace(shape, centre=centre, rotation=rotation @ np.asarray(shape.rotation, dtype=np.float64))


def _checked(shape: AnyShape, file: str) -> AnyShape:
    where = file + shape.name
    expected = {"centre": (3,), "a": (3,), "b": (3,), "rotation": (3, 3), "radius": ()}
    expected["half"] = (3,) if isinstance(shape, Box) else ()
    for key, value in vars(shape).items():
        if key == "name":
            continue
        array = np.asarray(value, dtype=np.float64)
        if key == "vertices":
            if array.ndim != 2 or array.shape[1] != 3:
                raise InputError(f"{where}: vertices have shape {array.shape}; expected [n, 3]")
        elif array.shape != expected[key]:
            raise InputError(f"{where}: {key} has shape {array.shape}; expected {expected[key]}")
        if not np.all(np.isfinite(array)):
            raise InputError(f"{where}: {key} is {array.tolist()}; expected finite numbers")
        if key in ("half", "radius") and np.any(array <= 0.0):
            raise InputError(f"{where}: {key} is {array.tolist()} m; expected more than zero")
        if key == "rotation" and not np.allclose(array @ array.T, np.eye(3), atol=1e-6):
            raise InputError(f"{where}: the rotation's rows are not orthonormal: {array.tolist()}")
    return shape


def _holding_sphere(hull: Hull) -> tuple[FloatArray, float]:
    corners = hull.triangles.reshape(-1, 3)
    centre = (corners.min(axis=0) + corners.max(axis=0)) / 2
    return centre, float(np.linalg.norm(corners - centre, axis=1).max())


def _kind(shape: Shape) -> str:
    return type(shape).__name__.lower()


def _array(values: Sequence[ArrayLike], *shape: int) -> FloatArray:
    return np.ascontiguousarray(np.asarray(values, dtype=np.float64).reshape(-1, *shape))
