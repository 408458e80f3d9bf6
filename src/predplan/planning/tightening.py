"""A certified path drawn tight: the least detour from the straight line that keeps clear, in the norm of durations.

The path is line + f. Near contacts at fixed times are linearised around it, and f is replaced by the element of least
norm that keeps those clearances, again and again: with multipliers μ_c >= 0 of contacts c at t_c with gradients g_c,
f = Σ_c μ_c k(., t_c) B g_c, Eqs. 4.16-4.19 with obstacles as the inequalities. The kernel k is that of a path's energy
(tension.py). B = diag(v_d² / (r_d² + ε)) weighs joints by what share r_d of their velocity limit v_d they use, the
slowest joint's being 1: joints with time to spare make the detour, and the slowest, which decides how long the motion
takes, does not.
"""

from typing import NamedTuple

import numpy as np
from numba import njit

from predplan.planning.contacts import Contacts, contacts
from predplan.planning.kernels import normalise
from predplan.planning.robots import Chain, FloatArray
from predplan.planning.scenes import Obstacles
from predplan.planning.tension import Tension

SPARE = 0.05
"""ε: how much sooner a joint that hardly moves makes the detour than the slowest: 1 + 1/ε times."""
ROOM = 0.01
"""rad or m: what is kept from joint limits at the times looked at, where the line does."""
PER_TIME = 20
"""Contacts there is room for, by time."""
SOFTNESS = 1e-4
"""Added to the Gram matrix's diagonal, 1, so that contacts which contradict each other have an answer."""
SWEEPS, SETTLED = 40, 2e-4
"""Of all contacts, to find their multipliers; the change (m) that ends it."""


class Loop(NamedTuple):
    """The kernel's space at the times looked at."""

    times: FloatArray  # [F]
    gram: FloatArray  # [F, F]
    inverse: FloatArray  # [F, F]: coefficients of an element with given values at the times
    to_knots: tuple[FloatArray, FloatArray, FloatArray]  # [P + 1, F] for values, first and second derivatives


class Tightening(NamedTuple):
    """How paths are drawn tight."""

    iterations: int
    step_cap: float  # rad or m: largest change of a joint in an iteration
    enough: float  # rad or m: a change that ends it
    reach: float  # m: clearances that are looked at
    self_reach: float  # m: the same between links


class Element(NamedTuple):
    """f, by its values and its coefficients [F, D] at a loop's times."""

    values: FloatArray
    coefficients: FloatArray


def loop_of(samples: int, knots: int, width: float) -> Loop:
    """The tension kernel of a width at `samples` inner times."""
    kernel = normalise(Tension(width))
    times, at = np.arange(1, samples + 1) / (samples + 1), np.linspace(0.0, 1.0, knots + 1)
    gram = kernel.gram(times, times)
    return Loop(
        times,
        gram,
        np.asarray(np.linalg.inv(gram + 1e-8 * np.eye(samples)), np.float64),
        (kernel.gram(at, times), kernel.gram(at, times, 1), kernel.gram(at, times, 2)),
    )


@njit(cache=True, error_model="numpy")
def tighten(
    chain: Chain,
    obstacles: Obstacles,
    loop: Loop,
    how: Tightening,
    start: FloatArray,
    goal: FloatArray,
    velocity_limit: FloatArray,
    margin: FloatArray,
    element: Element,
) -> tuple[Element, int]:
    """The element drawn tight, and after how many iterations; margin [F]: clearance (m) that is kept at each time."""
    span = goal - start
    line = start + np.outer(loop.times, span)
    lower, upper = np.minimum(chain.lower + ROOM - line, 0.0), np.maximum(chain.upper - ROOM - line, 0.0)
    values, coefficients, step = element.values, element.coefficients, np.inf
    for iteration in range(how.iterations):
        near = contacts(chain, obstacles, line + values, how.reach, how.self_reach, PER_TIME * len(line))
        if step < how.enough and np.all(near.clearance >= 0.5 * margin[near.at]):
            return Element(values, coefficients), iteration
        bound = np.empty(len(near.at))
        for c in range(len(bound)):
            bound[c] = margin[near.at[c]] - near.clearance[c] + _product(near.gradient[c], values[near.at[c]])
        weights = joint_weights(loop.to_knots[1] @ coefficients + span, velocity_limit)
        aim = least_norm(loop.gram, weights, near, bound, lower, upper)
        step = np.max(np.abs(aim.values - values))
        share = min(1.0, how.step_cap / max(step, 1e-300))
        values = values + share * (aim.values - values)
        coefficients = coefficients + share * (aim.coefficients - coefficients)
    return Element(values, coefficients), how.iterations


@njit(cache=True, error_model="numpy")
def joint_weights(velocity: FloatArray, velocity_limit: FloatArray) -> FloatArray:
    """The diagonal of B [D], its largest 1; velocity [n, D] by the path's parameter at equal steps."""
    used = np.empty(len(velocity_limit))
    for d in range(len(used)):
        used[d] = np.sqrt(np.mean(velocity[:, d] ** 2)) / velocity_limit[d]
    weights = velocity_limit**2 / ((used / max(np.max(used), 1e-300)) ** 2 + SPARE)
    return weights / np.max(weights)


@njit(cache=True, error_model="numpy")
def least_norm(
    gram: FloatArray, weights: FloatArray, near: Contacts, bound: FloatArray, lower: FloatArray, upper: FloatArray
) -> Element:
    """The f of least norm with g_c·f(t_c) >= bound_c and lower <= f <= upper [F, D] at the times.

    The dual by coordinates: one multiplier after the other is set to what its own constraint needs.
    """
    times, joints = lower.shape
    values, coefficients = np.zeros((joints, times)), np.zeros((joints, times))
    multipliers, limits = np.zeros(len(bound)), np.zeros((joints, times))
    heights = np.empty(len(bound))
    for c in range(len(bound)):
        heights[c] = SOFTNESS
        for d in range(joints):
            heights[c] += gram[near.at[c], near.at[c]] * weights[d] * near.gradient[c, d] ** 2
    for _ in range(SWEEPS):
        largest = 0.0
        for c in range(len(bound)):
            i = near.at[c]
            lacking = bound[c] - SOFTNESS * multipliers[c]
            for d in range(joints):
                lacking -= near.gradient[c, d] * values[d, i]
            change = max(0.0, multipliers[c] + lacking / heights[c]) - multipliers[c]
            if change != 0.0:
                multipliers[c] += change
                for d in range(joints):
                    _add(gram[i], i, weights[d] * near.gradient[c, d] * change, values[d], coefficients[d])
                largest = max(largest, abs(change) * heights[c])
        for d in range(joints):
            for i in range(times):
                if limits[d, i] == 0.0 and lower[i, d] <= values[d, i] <= upper[i, d]:
                    continue
                height = gram[i, i] * weights[d]
                from_lower = limits[d, i] + (lower[i, d] - values[d, i]) / height
                from_upper = limits[d, i] + (upper[i, d] - values[d, i]) / height
                change = max(from_lower, 0.0) + min(from_upper, 0.0) - limits[d, i]
                limits[d, i] += change
                _add(gram[i], i, weights[d] * change, values[d], coefficients[d])
                largest = max(largest, abs(change) * height)
        if largest < SETTLED:
            break
    return Element(values.T.copy(), coefficients.T.copy())


@njit(cache=True, error_model="numpy")
def _add(row: FloatArray, i: int, amount: float, values: FloatArray, coefficients: FloatArray) -> None:
    """Add amount k(., t_i) to one joint; row, values, coefficients: [F]."""
    if amount != 0.0:
        coefficients[i] += amount
        for k in range(len(row)):
            values[k] += amount * row[k]


@njit(cache=True, error_model="numpy")
def _product(a: FloatArray, b: FloatArray) -> float:
    total = 0.0
    for d in range(len(a)):
        total += a[d] * b[d]
    return total
