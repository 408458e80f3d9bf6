"""A kernel's space as the planner uses it: seen through a few times, with all tables made once."""

from typing import NamedTuple

import numpy as np

from predplan.planning.kernels import Kernel
from predplan.planning.optimiser import Space, space_of
from predplan.planning.paths import Path, quintic
from predplan.planning.robots import FloatArray


class Basis(NamedTuple):
    """A kernel's space at the planner's times, and what carries its elements to knots, draws and projections."""

    space: Space
    to_knots: tuple[FloatArray, FloatArray, FloatArray]  # [P + 1, F] for values, first and second derivatives
    root: FloatArray  # [F, r]: coefficients of a draw from the kernel's Gaussian process, root @ normal
    ridge: FloatArray  # [F, F]: coefficients of the ridge regression on values at the times


def basis_of(kernel: Kernel, joints: int, samples: int, knots: int, ridge: float) -> Basis:
    """The tables of a normalised, conditioned kernel."""
    space = space_of(kernel, np.eye(joints), samples)
    at = np.linspace(0.0, 1.0, knots + 1)
    values, vectors = np.linalg.eigh(space.gram)
    kept = values > 1e-9 * values[-1]
    return Basis(
        space,
        (kernel.gram(at, space.times), kernel.gram(at, space.times, 1), kernel.gram(at, space.times, 2)),
        np.ascontiguousarray(vectors[:, kept] / np.sqrt(values[kept])),
        np.asarray(np.linalg.inv(space.gram + ridge * np.eye(samples)), np.float64),
    )


def path_of(
    to_knots: tuple[FloatArray, FloatArray, FloatArray], coefficients: FloatArray, start: FloatArray, goal: FloatArray
) -> Path:
    """The quintic spline through line + f at equally spaced knots; f by its coefficients [F, D]."""
    position, velocity, acceleration = (table @ coefficients for table in to_knots)
    breaks, span = np.linspace(0.0, 1.0, len(position)), goal - start
    position += start + np.multiply.outer(breaks, span)
    position[0], position[-1] = start, goal
    return quintic(breaks, position, velocity + span, acceleration)
