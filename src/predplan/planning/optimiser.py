"""Trajectory optimisation by functional gradient descent (Algorithm 7), compiled; one code path for every kernel.

A kernel enters as its Gram matrix between finitely many functionals of a trajectory: positions (order 0) and velocities
(order 1) at given times. The element f = Σ K(., tᵢ) aᵢ of the space is held as its coefficients and its values at the
functionals, so that a gradient step is a few columns of the Gram matrix. Ends hold exactly because the kernel is
conditioned on them; joint and velocity limits are inequalities on the functionals, met by an active set.
"""

from typing import NamedTuple

import numpy as np
from numba import njit

from predplan.planning.collisions import body_cost, worst_cost
from predplan.planning.kernels import Kernel
from predplan.planning.robots import Chain, FloatArray, IntArray
from predplan.planning.scenes import Obstacles
from predplan.planning.trajectories import functional_gram

MAXIMUM_POINT, MAXIMUM_BODY, INTEGRAL, PATH_INTEGRAL = range(4)
"""How costs over time and body become one number (§4.6): the worst (time, body point) of each section, the body's sum
at the worst time of each section, Gauss-Legendre's integral over time, the same weighted by ‖ξ̇‖ (Eq. 4.22)."""
ROUNDS = 40
"""Most times that the active set of limits grows in an iteration."""


class Space(NamedTuple):
    """A kernel on finitely many functionals of a trajectory, the first M of them positions, in order of time."""

    times: FloatArray  # [F]
    orders: IntArray  # [F]
    gram: FloatArray  # [F, F]
    joint: FloatArray  # [D, D]
    weights: FloatArray  # [M] quadrature weights of the positions, sum 1


class Descent(NamedTuple):
    """How Algorithm 7 runs."""

    reduce: int
    sections: int  # of time, one maximum in each
    inverse_step: float  # λ of Eq. 4.11
    beta: float  # weight of ½‖f‖²
    epsilon: float  # m: clearance at which obstacles begin to cost
    self_epsilon: float  # m: the same between links
    step_cap: float  # rad or m: largest change of a joint in an iteration
    iterations: int
    margin: float  # m: stop once every position is this clear; negative: run all iterations


class Descended(NamedTuple):
    """Where a descent ended."""

    coefficients: FloatArray  # [F, D]
    values: FloatArray  # [F, D] of the line and f at the functionals
    clearance: float  # m: smallest over positions and body, -inf where not computed
    iterations: int


def space_of(
    kernel: Kernel, joint: FloatArray, samples: int, quadrature: bool = False, velocities: bool = False
) -> Space:
    """The space of a kernel seen through its positions (and velocities) at `samples` inner times.

    Times are equally spaced, or Gauss-Legendre nodes mapped to [0, 1] with their weights halved (§4.4.1 uses [-1, 1]).
    """
    if quadrature:
        nodes, weights = np.polynomial.legendre.leggauss(samples)
        times, weights = (nodes + 1) / 2, weights / 2
    else:
        times, weights = np.arange(1, samples + 1) / (samples + 1), np.full(samples, 1 / samples)
    orders = np.zeros(samples, np.int64)
    if velocities:
        times, orders = np.tile(times, 2), np.repeat(np.array([0, 1]), samples)
    return Space(times, orders, functional_gram(kernel, times, orders, times, orders), joint, weights)


def line_values(space: Space, start: FloatArray, goal: FloatArray) -> FloatArray:
    """The straight line's values at the functionals [F, D]."""
    positions = start + np.multiply.outer(space.times, goal - start)
    return np.where(space.orders[:, None] == 0, positions, goal - start)


@njit(cache=True, error_model="numpy")
def descend(
    chain: Chain,
    obstacles: Obstacles,
    space: Space,
    descent: Descent,
    line: FloatArray,
    coefficients: FloatArray,
    lower: FloatArray,
    upper: FloatArray,
    history: FloatArray,
) -> Descended:
    """Minimise U_obs + β/2 ‖f‖² from f given by its coefficients [F, D].

    line, lower, upper: [F, D], the line's values and the bounds at the functionals. history [iterations + 1, F, D] is
    filled with the values before the first and after each iteration; an array of no rows keeps none.
    """
    samples, joints = len(space.weights), line.shape[1]
    coefficients = coefficients.copy()
    deviations = space.gram @ coefficients @ space.joint
    meet_limits(space, line, lower, upper, coefficients, deviations)
    values = line + deviations
    costs, gradients = np.empty(samples), np.empty((samples, joints))
    slope = np.zeros_like(line)
    clearance, iteration = -np.inf, 0
    while True:
        if iteration < len(history):
            history[iteration] = values
        if iteration == descent.iterations and descent.margin < 0.0:
            break
        clearance = _evaluate(chain, obstacles, descent, values, costs, gradients)
        if iteration == descent.iterations or (descent.margin >= 0.0 and clearance >= descent.margin):
            break
        _reduced_gradient(space, descent, values, costs, gradients, slope)
        _step(space, descent, slope, coefficients, deviations)
        meet_limits(space, line, lower, upper, coefficients, deviations)
        values = line + deviations
        iteration += 1
    return Descended(coefficients, values, clearance, iteration)


@njit(cache=True, error_model="numpy")
def cheapest(chain: Chain, obstacles: Obstacles, descent: Descent, values: FloatArray, stride: int) -> int:
    """Which of the starts [n, F, D] costs least, judged by every `stride`th position; outside the limits costs too."""
    best, chosen = np.inf, 0
    gradient = np.empty(values.shape[2])
    for n in range(len(values)):
        cost = 0.0
        for i in range(stride // 2, values.shape[1], stride):
            cost += body_cost(chain, obstacles, values[n, i], descent.epsilon, descent.self_epsilon, gradient)[0]
            for d in range(len(gradient)):
                cost += max(0.0, values[n, i, d] - chain.upper[d]) + max(0.0, chain.lower[d] - values[n, i, d])
            if cost > best:
                break
        if cost < best:
            best, chosen = cost, n
    return chosen


@njit(cache=True, error_model="numpy")
def _evaluate(
    chain: Chain, obstacles: Obstacles, descent: Descent, values: FloatArray, costs: FloatArray, gradients: FloatArray
) -> float:
    """Cost and its gradient by the configuration at every position; returns the smallest clearance."""
    clearance = np.inf
    for i in range(len(costs)):
        if descent.reduce == MAXIMUM_POINT:
            costs[i], clear = worst_cost(chain, obstacles, values[i], descent.epsilon, gradients[i])
        else:
            costs[i], clear = body_cost(
                chain, obstacles, values[i], descent.epsilon, descent.self_epsilon, gradients[i]
            )
        clearance = min(clearance, clear)
    return clearance


@njit(cache=True, error_model="numpy")
def _reduced_gradient(
    space: Space, descent: Descent, values: FloatArray, costs: FloatArray, gradients: FloatArray, slope: FloatArray
) -> None:
    """Coefficients [F, D] of U_obs's functional gradient (Eq. 4.13) before the joint matrix."""
    samples = len(costs)
    slope[:] = 0.0
    if descent.reduce == INTEGRAL:
        for i in range(samples):
            slope[i] = space.weights[i] * gradients[i]
    elif descent.reduce == PATH_INTEGRAL:
        for i in range(samples):
            velocity = values[samples + i]
            speed = max(np.sqrt(np.sum(velocity**2)), 1e-12)
            slope[i] = space.weights[i] * speed * gradients[i]
            slope[samples + i] = space.weights[i] * costs[i] / speed * velocity
    else:
        for section in range(descent.sections):
            first, last = section * samples // descent.sections, (section + 1) * samples // descent.sections
            worst = first + np.argmax(costs[first:last])
            if costs[worst] > 0.0:
                slope[worst] = gradients[worst]


@njit(cache=True, error_model="numpy")
def _step(space: Space, descent: Descent, slope: FloatArray, coefficients: FloatArray, deviations: FloatArray) -> None:
    """One update of Eq. 4.12, its largest change of a joint capped; coefficients and deviations change in place."""
    change = -descent.beta / descent.inverse_step * deviations
    for i in range(len(slope)):
        if np.any(slope[i] != 0.0):
            direction = -(slope[i] @ space.joint) / descent.inverse_step
            for f in range(len(change)):
                for d in range(change.shape[1]):
                    change[f, d] += space.gram[f, i] * direction[d]
    largest = np.max(np.abs(change[: len(space.weights)]))
    scale = min(1.0, descent.step_cap / largest) if largest > 0.0 else 0.0
    deviations += scale * change
    coefficients -= scale / descent.inverse_step * (slope + descent.beta * coefficients)


@njit(cache=True, error_model="numpy")
def meet_limits(
    space: Space,
    line: FloatArray,
    lower: FloatArray,
    upper: FloatArray,
    coefficients: FloatArray,
    deviations: FloatArray,
) -> None:
    """Project f onto {lower <= line + f <= upper} in the space's norm (Eqs. 4.16-4.19, with the signs mended).

    An active set grows by the worst violation of each joint and loses constraints whose multiplier turns negative,
    which Eq. 4.19 does not enforce. Without a violation nothing is computed. If the set does not settle, f is shrunk
    until the bounds hold, as they do for a line within limits.
    """
    functionals, joints = line.shape
    limit = ROUNDS * joints
    rows, columns = np.empty(limit, np.int64), np.empty(limit, np.int64)
    signs, targets = np.empty(limit), np.empty(limit)
    count = 0
    free, free_coefficients = deviations.copy(), coefficients.copy()
    for _ in range(ROUNDS):
        added = False
        for d in range(joints):
            worst, row, sign = 1e-8, -1, 0.0
            for f in range(functionals):
                value = line[f, d] + deviations[f, d]
                if value - upper[f, d] > worst:
                    worst, row, sign = value - upper[f, d], f, 1.0
                if lower[f, d] - value > worst:
                    worst, row, sign = lower[f, d] - value, f, -1.0
            if row >= 0 and count < limit:
                rows[count], columns[count], signs[count] = row, d, sign
                bound = upper[row, d] if sign > 0 else lower[row, d]
                targets[count] = sign * (line[row, d] + free[row, d] - bound)
                count += 1
                added = True
        if not added:
            return
        while count > 0:
            matrix = np.empty((count, count))
            for i in range(count):
                for j in range(count):
                    matrix[i, j] = (
                        signs[i] * signs[j] * space.gram[rows[i], rows[j]] * space.joint[columns[i], columns[j]]
                    )
                matrix[i, i] *= 1.0 + 1e-9
            multipliers = np.linalg.solve(matrix, targets[:count])
            negative = np.argmin(multipliers)
            if multipliers[negative] >= 0.0:
                break
            count -= 1
            for i in range(negative, count):
                rows[i], columns[i], signs[i], targets[i] = rows[i + 1], columns[i + 1], signs[i + 1], targets[i + 1]
        deviations[:] = free
        coefficients[:] = free_coefficients
        for i in range(count):
            coefficients[rows[i], columns[i]] -= signs[i] * multipliers[i]
            for f in range(functionals):
                for d in range(joints):
                    deviations[f, d] -= signs[i] * multipliers[i] * space.gram[f, rows[i]] * space.joint[columns[i], d]
    share = 1.0
    for f in range(functionals):
        for d in range(joints):
            value = deviations[f, d]
            if line[f, d] + value > upper[f, d] and value > 0.0:
                share = min(share, max(0.0, (upper[f, d] - line[f, d]) / value))
            elif line[f, d] + value < lower[f, d] and value < 0.0:
                share = min(share, max(0.0, (lower[f, d] - line[f, d]) / value))
    deviations *= share
    coefficients *= share
