"""A filter learned anew from a policy's latest steps."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from predplan.control.autoregression import Standard, standardise, window_moments
from predplan.control.innovation import InnovationSettings, fit_basis, fit_in_basis
from predplan.control.linear_filter import LinearFilter, turned
from predplan.control.moments import Moments
from predplan.control.trajectories import Trajectories
from predplan.errors import InputError


@dataclass(frozen=True)
class Known:
    """Moments that the last fit found, for the next one to begin at."""

    standard: Standard
    past: int
    moments: Moments


def learn_filter(
    trajectories: Trajectories, settings: InnovationSettings, known: Known | None, iterations: int
) -> tuple[LinearFilter, Known]:
    """The innovation form of these trajectories. Where observations are lost, iterations of maximisation go on.

    Its state has settings.dimension numbers, whatever the trajectories tell.
    """
    past = fitting_past(trajectories, settings.past)
    settings = replace(settings, past=past)
    standard = known.standard if known else standardise(trajectories)
    begin = known.moments if known and known.past == past else None
    layout, moments = window_moments(trajectories, past, standard, iterations if begin else 100, begin)
    basis = fit_basis(layout, moments, standard, settings)
    model = fit_in_basis(basis, moments, trajectories, settings)
    model = widened(as_expectations(model, settings.future), settings.dimension)
    return model, Known(standard, past, moments)


def as_expectations(model: LinearFilter, future: int, worst: float = 1e5) -> LinearFilter:
    """The same filter, its state the observations expected one step and `future` steps ahead, actions being 0.

    So a state means the same from refit to refit, and a policy can go on with it. A filter whose state is not twice
    the observations, or does not follow from these (condition number above worst), is left as it is.
    """
    if model.state_size != 2 * model.observation_size:
        return model
    T = np.concatenate([model.C, model.C @ np.linalg.matrix_power(model.A, future - 1)])
    values = np.linalg.svd(T, compute_uv=False)
    if not values[-1] * worst > values[0]:
        return model
    return replace(turned(model, T), limit=float(model.limit * values[0]))


def widened(model: LinearFilter, dimension: int) -> LinearFilter:
    """The same filter with a state of so many numbers, the last of which are 0 and stay so.

    A future that is foretold by fewer numbers gives a basis of fewer; a policy's network has one width for all of them.
    """
    more = dimension - model.state_size
    if more <= 0:
        return model
    return replace(
        model,
        A=np.pad(model.A, (0, more)),
        B=np.pad(model.B, ((0, more), (0, 0))),
        c=np.pad(model.c, (0, more)),
        K=np.pad(model.K, ((0, more), (0, 0))),
        C=np.pad(model.C, ((0, 0), (0, more))),
        initial_mean=np.pad(model.initial_mean, (0, more)),
        initial_covariance=np.pad(model.initial_covariance, (0, more)),
    )


def fitting_past(trajectories: Trajectories, most: int) -> int:
    """The longest past, up to most, of which at least half as many windows fit as of a past of 2.

    Falling poles last a few steps: what is learned from those few that last long would be of these alone. Raises
    InputError where fewer than two windows of 3 rows fit.
    """

    def windows(past: int) -> int:
        return int(np.maximum(trajectories.lengths - past, 0).sum())

    if windows(2) < 2:
        longest = int(trajectories.lengths.max())
        raise InputError(f"trajectories: the longest has {longest} rows, a filter needs windows of 3")
    return max(past for past in range(2, max(most, 2) + 1) if windows(past) >= 0.5 * windows(2))


def random_filter(trajectories: Trajectories, dimension: int, generator: np.random.Generator) -> LinearFilter:
    """A filter that remembers, of random weights, and expects nothing: q' = A q + B a + K o, o standardised.

    Directions are forgotten at rates of e within 1 to 30 steps.
    """
    standard, p = standardise(trajectories), dimension
    o, actions = trajectories.observation.shape[1], trajectories.action.shape[1]
    rotation = np.linalg.qr(generator.standard_normal((p, p)))[0]
    return LinearFilter(
        A=rotation @ np.diag(np.exp(-1.0 / generator.uniform(1.0, 30.0, p))),
        B=generator.standard_normal((p, actions)) / np.sqrt(actions),
        c=np.zeros(p),
        K=generator.standard_normal((p, o)) / np.sqrt(o),
        C=np.zeros((o, p)),
        D=np.zeros((o, actions)),
        d=np.zeros(o),
        S=np.eye(o),
        initial_mean=np.zeros(p),
        initial_covariance=np.zeros((p, p)),
        limit=1e3,
        shift=standard.shift,
        scale=standard.scale,
    )
