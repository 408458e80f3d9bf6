"""What every trajectory is judged by, whatever its kernel: costs on one grid of times, and the certificate."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit

from predplan.planning.collisions import workspace_cost
from predplan.planning.distances import anything_within, nearest
from predplan.planning.kinematics import forward, to_world
from predplan.planning.robots import Chain, FloatArray
from predplan.planning.scenes import Obstacles, Scene

GRID = np.linspace(0.0, 1.0, 101)
"""The times in [0, 1] at which all trajectories are measured."""


class Measures(NamedTuple):
    """Costs of trajectories, each [n]."""

    maximum: FloatArray  # m: workspace cost of the worst body sphere at the worst time
    integral: FloatArray  # m²: workspace cost along every body sphere's way, by arc length, summed over the body
    velocity: FloatArray  # rad² or m²: ½ mean ‖q̇‖², t in [0, 1] (the norm of waypoints with a velocity metric)
    acceleration: FloatArray  # rad² or m²: ½ mean ‖q̈‖² (the norm of waypoints with an acceleration metric)


def measured(chain: Chain, obstacles: Obstacles, trajectories: FloatArray, epsilon: float) -> Measures:
    """Measures of trajectories [n, 101, D] on GRID; epsilon (m): clearance from which on obstacles cost nothing."""
    costs = np.empty((len(trajectories), 2))
    for n, q in enumerate(trajectories):
        costs[n] = obstacle_costs(chain, obstacles, np.ascontiguousarray(q), epsilon)
    return Measures(costs[:, 0], costs[:, 1], velocity_costs(trajectories), acceleration_costs(trajectories))


def velocity_costs(trajectories: FloatArray) -> FloatArray:
    """½ mean ‖q̇‖² by differences [n], as paths.velocity_cost has it; trajectories [n, T, D] over t in [0, 1]."""
    steps = trajectories.shape[1] - 1
    differences = np.diff(trajectories, axis=1) * steps
    return np.asarray(0.5 * np.mean(np.sum(differences**2, axis=2), axis=1))


def acceleration_costs(trajectories: FloatArray) -> FloatArray:
    """½ mean ‖q̈‖² by second differences [n], as paths.acceleration_cost has it."""
    steps = trajectories.shape[1] - 1
    differences = np.diff(trajectories, n=2, axis=1) * steps**2
    return np.asarray(0.5 * np.mean(np.sum(differences**2, axis=2), axis=1))


@njit(cache=True, nogil=True, error_model="numpy")
def obstacle_costs(chain: Chain, obstacles: Obstacles, q: FloatArray, epsilon: float) -> tuple[float, float]:
    """Largest workspace cost over time and body (m), and CHOMP's arc-length integral over the body (m²); q [T, D]."""
    joints, spheres = q.shape[1], chain.sphere_radius.shape[0]
    rotations, positions = np.empty((joints + 1, 3, 3)), np.empty((joints + 1, 3))
    before, centres = np.empty((spheres, 3)), np.empty((spheres, 3))
    costs_before, costs = np.zeros(spheres), np.zeros(spheres)
    largest, integral = 0.0, 0.0
    for i in range(q.shape[0]):
        forward(chain, q[i], rotations, positions, centres)
        costs[:] = 0.0
        for link in range(chain.scene_link, chain.link_frame.shape[0]):
            x, y, z = to_world(rotations, positions, chain.link_frame[link], chain.link_centre, link)
            if not anything_within(obstacles, x, y, z, chain.link_radius[link] + epsilon):
                continue
            for s in range(chain.link_first[link], chain.link_first[link + 1]):
                radius = chain.sphere_radius[s]
                distance = nearest(obstacles, centres[s, 0], centres[s, 1], centres[s, 2], radius + epsilon)[0]
                costs[s] = workspace_cost(distance - radius, epsilon)[0]
                largest = max(largest, costs[s])
        if i > 0:
            for s in range(spheres):
                if costs[s] + costs_before[s] > 0.0:
                    way = np.sqrt(np.sum((centres[s] - before[s]) ** 2))
                    integral += 0.5 * (costs[s] + costs_before[s]) * way
        before[:] = centres
        costs_before[:] = costs
    return largest, integral


def cost_field(scene: Scene, lower: FloatArray, upper: FloatArray, count: int, epsilon: float) -> FloatArray:
    """Workspace cost (m) of points of z = 0, row by row from the bottom [count, count]; lower, upper [2] m."""
    xs, ys = (np.linspace(low, high, count) for low, high in zip(lower, upper, strict=True))
    return np.array(
        [[workspace_cost(nearest(scene.obstacles, x, y, 0.0, 2.0 * epsilon)[0], epsilon)[0] for x in xs] for y in ys]
    )
