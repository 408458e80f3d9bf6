"""Sampled paths: RRT-Connect (Kuffner and LaValle 2000) and shortcuts, compiled beside the collision checker."""

import numpy as np
from numba import njit

from predplan.planning.collisions import valid
from predplan.planning.robots import Chain, FloatArray, IntArray
from predplan.planning.scenes import Obstacles


@njit(cache=True, error_model="numpy")
def motion_is_valid(
    chain: Chain, obstacles: Obstacles, start: FloatArray, goal: FloatArray, resolution: float, margin: float
) -> bool:
    """Whether configurations at most `resolution` (rad or m, largest joint) apart are valid between two valid ones.

    The middle is looked at first, then the quarters: a collision is more likely far from what is known to be free.
    """
    steps = int(np.ceil(np.max(np.abs(goal - start)) / resolution))
    stride = 1
    while stride < steps:
        stride *= 2
    while stride > 1:
        for i in range(stride // 2, steps, stride):
            if not valid(chain, obstacles, start + (goal - start) * (i / steps), margin):
                return False
        stride //= 2
    return True


@njit(cache=True, error_model="numpy")
def connect(
    chain: Chain,
    obstacles: Obstacles,
    start: FloatArray,
    goal: FloatArray,
    generator: np.random.Generator,
    reach: float,
    resolution: float,
    margin: float,
    iterations: int,
) -> FloatArray:
    """A path of valid straight motions from start to goal, as points [n, D]; no rows if none was found.

    reach: longest motion added at once (rad or m, 2-norm). start and goal are valid.
    """
    joints = len(start)
    if motion_is_valid(chain, obstacles, start, goal, resolution, margin):
        direct = np.empty((2, joints))
        direct[0], direct[1] = start, goal
        return direct
    capacity = 2 * iterations + 64
    nodes, parents = np.empty((2, capacity, joints)), np.full((2, capacity), -1)
    sizes = np.ones(2, np.int64)
    nodes[0, 0], nodes[1, 0] = start, goal
    target, new = np.empty(joints), np.empty(joints)
    tree = 0
    for _ in range(iterations):
        tree = 1 if sizes[0] > sizes[1] else 0
        for j in range(joints):
            target[j] = chain.lower[j] + (chain.upper[j] - chain.lower[j]) * generator.random()
        near = _nearest_node(nodes[tree], sizes[tree], target)
        _towards(nodes[tree, near], target, reach, new)
        if not (
            valid(chain, obstacles, new, margin)
            and motion_is_valid(chain, obstacles, nodes[tree, near], new, resolution, margin)
        ):
            continue
        added = sizes[tree]
        nodes[tree, added], parents[tree, added] = new, near
        sizes[tree] += 1
        other = 1 - tree
        last = _nearest_node(nodes[other], sizes[other], new)
        target[:] = new
        while sizes[other] < capacity and sizes[tree] < capacity:
            arrived = _towards(nodes[other, last], target, reach, new)
            if not (
                (arrived or valid(chain, obstacles, new, margin))
                and motion_is_valid(chain, obstacles, nodes[other, last], new, resolution, margin)
            ):
                break
            if arrived:
                return _joined(nodes, parents, tree, added, last)
            nodes[other, sizes[other]], parents[other, sizes[other]] = new, last
            last = sizes[other]
            sizes[other] += 1
        if sizes[0] >= capacity - 1 or sizes[1] >= capacity - 1:
            break
    return np.empty((0, joints))


@njit(cache=True, error_model="numpy")
def _nearest_node(nodes: FloatArray, size: int, target: FloatArray) -> int:
    best, nearest = np.inf, 0
    for i in range(size):
        square = 0.0
        for j in range(len(target)):
            difference = nodes[i, j] - target[j]
            square += difference * difference
        if square < best:
            best, nearest = square, i
    return nearest


@njit(cache=True, error_model="numpy")
def _towards(origin: FloatArray, target: FloatArray, reach: float, new: FloatArray) -> bool:
    """Fill `new` with the point at most `reach` from origin towards target; whether that is the target."""
    square = 0.0
    for j in range(len(origin)):
        square += (target[j] - origin[j]) ** 2
    fraction = min(1.0, reach / max(np.sqrt(square), 1e-300))
    for j in range(len(origin)):
        new[j] = origin[j] + fraction * (target[j] - origin[j])
    return bool(fraction == 1.0)


@njit(cache=True, error_model="numpy")
def _joined(nodes: FloatArray, parents: IntArray, tree: int, first: int, second: int) -> FloatArray:
    """The branch of `first` in its tree and of `second` in the other, from start to goal."""
    ends = np.array([first, second]) if tree == 0 else np.array([second, first])
    count = 0
    for side in range(2):
        node = ends[side]
        while node >= 0:
            count += 1
            node = parents[side, node]
    path = np.empty((count, nodes.shape[2]))
    node, row = ends[0], 0
    while node >= 0:
        row += 1
        node = parents[0, node]
    split = row
    node = ends[0]
    while node >= 0:
        row -= 1
        path[row] = nodes[0, node]
        node = parents[0, node]
    node, row = ends[1], split
    while node >= 0:
        path[row] = nodes[1, node]
        row += 1
        node = parents[1, node]
    return path


@njit(cache=True, error_model="numpy")
def shortcut(
    chain: Chain,
    obstacles: Obstacles,
    points: FloatArray,
    generator: np.random.Generator,
    attempts: int,
    resolution: float,
    margin: float,
) -> FloatArray:
    """Replace the path between two random places on it by a straight motion, wherever that is valid and shorter."""
    path = points.copy()
    joints = path.shape[1]
    for _ in range(attempts):
        if len(path) < 3:
            break
        lengths = np.empty(len(path))
        lengths[0] = 0.0
        for i in range(1, len(path)):
            lengths[i] = lengths[i - 1] + np.sqrt(np.sum((path[i] - path[i - 1]) ** 2))
        low, high = generator.random() * lengths[-1], generator.random() * lengths[-1]
        if low > high:
            low, high = high, low
        i = max(np.searchsorted(lengths, low, side="right") - 1, 0)
        k = min(np.searchsorted(lengths, high, side="right") - 1, len(path) - 2)
        if i == k:
            continue
        first = path[i] + (path[i + 1] - path[i]) * ((low - lengths[i]) / (lengths[i + 1] - lengths[i]))
        second = path[k] + (path[k + 1] - path[k]) * ((high - lengths[k]) / (lengths[k + 1] - lengths[k]))
        if not (
            valid(chain, obstacles, first, margin)
            and valid(chain, obstacles, second, margin)
            and motion_is_valid(chain, obstacles, first, second, resolution, margin)
        ):
            continue
        shorter = np.empty((i + 1 + 2 + len(path) - k - 1, joints))
        shorter[: i + 1] = path[: i + 1]
        shorter[i + 1], shorter[i + 2] = first, second
        shorter[i + 3 :] = path[k + 1 :]
        path = shorter
    return path


@njit(cache=True, error_model="numpy")
def resampled(points: FloatArray, times: FloatArray) -> FloatArray:
    """The polyline at fractions of its length, times [n] -> [n, D]."""
    lengths = np.zeros(len(points))
    for i in range(1, len(points)):
        lengths[i] = lengths[i - 1] + np.sqrt(np.sum((points[i] - points[i - 1]) ** 2))
    values = np.empty((len(times), points.shape[1]))
    for d in range(points.shape[1]):
        values[:, d] = np.interp(times * lengths[-1], lengths, points[:, d])
    return values
