"""Random paths and scenes, and the subdivision of paths, for tests."""

import numpy as np

from predplan.planning.paths import Path, quintic
from predplan.planning.robots import FloatArray, Robot
from predplan.planning.scenes import Box, Capsule, Cylinder, Mesh, Scene, Shape, Sphere, make_scene
from tests.planning.models import random_rotation


def random_path(robot: Robot, generator: np.random.Generator, pieces: int = 4, share: float = 0.8) -> Path:
    """A smooth path through random configurations, in the middle `share` of the joints' ranges at its knots."""
    chain = robot.chain
    middle, half = (chain.lower + chain.upper) / 2, (chain.upper - chain.lower) / 2
    shape = (pieces + 1, len(robot.joints))
    knots = middle + share * half * generator.uniform(-1, 1, shape)
    return quintic(
        np.linspace(0, 1, pieces + 1), knots, half * generator.standard_normal(shape), generator.standard_normal(shape)
    )


def random_scene(generator: np.random.Generator, obstacles: int, reach: float, size: float = 0.1) -> Scene:
    """Obstacles of every kind, with centres at most `reach` (m) away."""
    return make_scene([random_shape(generator, k, reach, size) for k in range(obstacles)])


def random_shape(generator: np.random.Generator, kind: int, reach: float, size: float) -> Shape:
    centre, rotation = generator.uniform(-reach, reach, 3), random_rotation(generator)
    sizes = size * generator.uniform(0.3, 1.0, 3)
    match kind % 5:
        case 0:
            return Box(centre, sizes, rotation)
        case 1:
            return Sphere(centre, sizes[0])
        case 2:
            return Capsule(centre, centre + rotation[0] * sizes[1], sizes[0])
        case 3:
            return Cylinder(centre, sizes[1], sizes[0], rotation)
        case _:
            return Mesh(centre + size * generator.uniform(-1, 1, (12, 3)))


def split(path: Path, places: FloatArray) -> Path:
    """The same path with more pieces: cut at places in (0, 1), by de Casteljau's construction."""
    breaks, pieces = [0.0], []
    for left, right, points in zip(path.breaks[:-1], path.breaks[1:], path.coefficients, strict=True):
        rest, at = points, left
        for place in np.sort(places[(places > left) & (places < right)]):
            u = (place - at) / (right - at)
            first, second = [rest[0]], [rest[-1]]
            while len(rest) > 1:
                rest = (1 - u) * rest[:-1] + u * rest[1:]
                first.append(rest[0])
                second.append(rest[-1])
            pieces.append(np.stack(first))
            rest, at = np.stack(second[::-1]), place
            breaks.append(place)
        pieces.append(rest)
        breaks.append(right)
    return Path(np.array(breaks), np.stack(pieces))


def raised(path: Path) -> Path:
    """The same path with polynomials of one degree more."""
    degree = path.degree
    share = (np.arange(1, degree + 1) / (degree + 1))[:, None]
    inner = share * path.coefficients[:, :-1] + (1 - share) * path.coefficients[:, 1:]
    ends = path.coefficients[:, :1], path.coefficients[:, -1:]
    return Path(path.breaks, np.concatenate([ends[0], inner, ends[1]], axis=1))
