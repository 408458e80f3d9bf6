"""The linear innovation form of a predictive state, learned by two-stage regression on second moments.

Stage 1 regresses the observation on the window before it and the action. Rolled forward F steps with actions of 0 it
is the expected future as a linear function of the past: a predictive state under intervened actions. Principal
components, in units of what of the future cannot be foretold (canonical variates; Larimore 1990), bring it to p
numbers of variance 1. Stage 2 regresses the next state on state, action and innovation. All of it follows from the
second moments of one window of P + 1 rows, so that missing observations are dealt with there.

The thesis's state (§5.4.1) conditions on features of futures by kernel Bayes' rule; with linear features the update
is linear in the innovation, and nothing in it can be singular.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from predplan.control.autoregression import (
    Autoregression,
    Layout,
    Standard,
    fit_autoregression,
    residual_covariance,
    standardise,
    window_moments,
)
from predplan.control.bounds import check_number, check_whole
from predplan.control.filtering import Filtered, filter_trajectories
from predplan.control.linear_filter import LinearFilter
from predplan.control.moments import Moments, ridge, second_moments, solve_right
from predplan.control.tasks import FloatArray
from predplan.control.trajectories import Trajectories, seen
from predplan.errors import InputError

LEAST = 1e-8
"""Variance of innovations, of standardised observations, below which one is not told from another."""


@dataclass(frozen=True)
class InnovationSettings:
    """How the filter is learned."""

    past: int = 10  # P, rows
    future: int = 5  # F, rows
    dimension: int = 10  # p; no more than F O, and twice O is enough for a mechanism's positions
    lam: float = 1e-8  # of the ridge, relative to each input's variance; where it matters more data are the cure
    refits: int = 1  # times that W_pred is fitted anew on filtered states
    beyond: float = 3.0  # states are clipped at so many times the largest seen in learning
    starts: int = 30  # iterations that fit where trajectories start

    def __post_init__(self) -> None:
        check_whole(self, "past", "future", "dimension")
        check_whole(self, "refits", "starts", least=0)
        check_number(self, "lam", least=0)
        check_number(self, "beyond", above=0)


def suited(task: str, observations: int) -> InnovationSettings:
    """What predicted best on one draw of exploration data, with noise of 0 and .2; for other tasks a guess.

    States are positions and velocities: twice as many numbers as are observed. A longer past says more under noise,
    until there are too few data for it: Swimmer's trajectories are long, and 20 rows of it beat every order.
    """
    past = {"cartpole": 10, "swimmer": 20, "hopper": 10, "walker2d": 8}.get(task, 10)
    dimension = {"swimmer": 8, "hopper": 12}.get(task, 2 * observations)
    return InnovationSettings(past=past, future=5, dimension=dimension)


@dataclass(frozen=True)
class Basis:
    """What a state means: q = linear (window - mean), the window before t, standardised."""

    layout: Layout
    standard: Standard
    linear: FloatArray  # [p, P (O + A)]
    mean: FloatArray  # [P (O + A)]


def fit_innovation(trajectories: Trajectories, settings: InnovationSettings) -> LinearFilter:
    """Learn the filter. Raises InputError where trajectories are too short for the past and one row more."""
    standard = standardise(trajectories)
    layout, moments = window_moments(trajectories, settings.past, standard)
    basis = fit_basis(layout, moments, standard, settings)
    return fit_in_basis(basis, moments, trajectories, settings)


def fit_basis(layout: Layout, moments: Moments, standard: Standard, settings: InnovationSettings) -> Basis:
    """Stage 1: the expected future given the past, in whitened canonical variates.

    In the observations' own units what is small but exactly foretold, as velocities are in noiseless positions, would
    be among the last components: on Walker2d 26 were needed to predict as well as 16 of these. Components are as many
    as settings.dimension, or as the rank where that is less. Raises InputError where observations never change.
    """
    regression = fit_autoregression(layout, moments, standard, settings.lam)
    unforetold = future_errors(regression, residual_covariance(regression, moments), settings.future)
    futures = np.linalg.solve(np.linalg.cholesky(unforetold), expected_future(regression, settings.future))
    past = moments.mapped(layout.before)
    covariance = futures @ past.covariance @ futures.T
    values, vectors = np.linalg.eigh(covariance)
    rank = min(settings.dimension, int(np.sum(values > 1e-12 * values[-1])))
    if rank == 0 or not values[-1] > 0.0:
        raise InputError("trajectories: observations never change")
    chosen = np.arange(len(values))[::-1][:rank]
    linear = (vectors[:, chosen] / np.sqrt(values[chosen])).T @ futures
    return Basis(layout, standard, linear, past.mean)


def expected_future(regression: Autoregression, future: int) -> FloatArray:
    """The linear map [F O, P (O + A)] of a window to the F observations after it, should actions be 0."""
    layout = regression.layout
    observed = layout.past * layout.observations
    window = np.eye(observed + layout.past * layout.actions)
    rolled = []
    for _ in range(future):
        following = regression.past @ window
        rolled.append(following)
        seen = np.concatenate([window[layout.observations : observed], following])
        done = np.concatenate([window[observed + layout.actions :], np.zeros((layout.actions, window.shape[1]))])
        window = np.concatenate([seen, done])
    return np.concatenate(rolled)


def future_errors(regression: Autoregression, innovations: FloatArray, future: int) -> FloatArray:
    """Covariance [F O, F O] of what F observations will differ by from those expected, innovations [O, O] each."""
    layout, o = regression.layout, regression.layout.observations
    # Observations of a window run from the oldest to the last: lag 1 comes last.
    lags = range(1, min(future, layout.past + 1))
    back = [regression.past[:, (layout.past - lag) * o : (layout.past - lag + 1) * o] for lag in lags]
    response = [np.eye(o)]
    for k in range(1, future):
        response.append(np.sum([step @ response[k - lag] for lag, step in enumerate(back[:k], 1)], axis=0))
    nothing = np.zeros((o, o))
    rows = [[response[i - j] if i >= j else nothing for j in range(future)] for i in range(future)]
    lasting = np.block(rows)
    covariance: FloatArray = lasting @ np.kron(np.eye(future), innovations + LEAST * np.eye(o)) @ lasting.T
    return covariance


def fit_in_basis(
    basis: Basis, moments: Moments, trajectories: Trajectories, settings: InnovationSettings
) -> LinearFilter:
    """Stage 2 in a given basis, and the prediction fitted on filtered states."""
    layout, p = basis.layout, len(basis.linear)
    stacked = np.concatenate(
        [basis.linear @ layout.before, layout.action, layout.observation, basis.linear @ layout.through]
    )
    both = moments.mapped(stacked)
    q, a = slice(0, p), slice(p, p + layout.actions)
    o, after = slice(a.stop, a.stop + layout.observations), slice(a.stop + layout.observations, None)
    inputs = slice(0, a.stop)
    mean = np.concatenate([both.mean, [1.0]])[:-1]
    # Means of the states of windows before and after t count from the same zero.
    mean[q] -= basis.linear @ basis.mean
    mean[after] -= basis.linear @ basis.mean
    known = both.covariance[inputs, inputs]
    prediction = ridge(both, inputs, o, settings.lam)
    S = both.covariance[o, o] - prediction @ known @ prediction.T
    S = _floored(S + settings.lam * np.diag(np.diag(both.covariance[o, o])))
    transition = ridge(both, inputs, after, settings.lam)
    # o - E[o | q, a] is uncorrelated with q and a: its coefficients are found apart, in its own scale.
    crossed = both.covariance[after, o] - transition @ known @ prediction.T
    K = solve_right(crossed, S, 0.0)
    model = LinearFilter(
        A=transition[:, q],
        B=transition[:, a],
        c=mean[after] - transition @ mean[inputs],
        K=K,
        C=prediction[:, q],
        D=prediction[:, a],
        d=mean[o] - prediction @ mean[inputs],
        S=S,
        initial_mean=np.zeros(p),
        initial_covariance=np.eye(p),
        limit=1e6,
        shift=basis.standard.shift,
        scale=basis.standard.scale,
    )
    model = fit_start(model, trajectories, settings.starts)
    for _ in range(settings.refits):
        model = refit_prediction(model, trajectories, settings)
    largest = np.sqrt((filter_trajectories(model, trajectories).after ** 2).sum(axis=1).max())
    return replace(model, limit=float(settings.beyond * largest))


def refit_prediction(model: LinearFilter, trajectories: Trajectories, settings: InnovationSettings) -> LinearFilter:
    """Fit W_pred = (C, D, d) on filtered states, the update q' ~ [1, q, a, o] left as it is.

    S is fitted anew only where nothing is missing: after a gap errors are larger than innovations.
    """
    filtered = filter_trajectories(model, trajectories)
    moments, p = _prediction_moments(filtered, model, trajectories, settings.past), model.state_size
    actions = model.B.shape[1]
    weights = ridge(moments, slice(0, p + actions), slice(p + actions, None), settings.lam)
    S = model.S
    if trajectories.seen.all():
        known = moments.covariance[: p + actions, : p + actions]
        S = moments.covariance[p + actions :, p + actions :] - weights @ known @ weights.T
        S = _floored(S + settings.lam * np.eye(len(S)))
    C, D = weights[:, :p], weights[:, p:]
    d = moments.mean[p + actions :] - weights @ moments.mean[: p + actions]
    changed = replace(
        model,
        A=model.A + model.K @ (C - model.C),
        B=model.B + model.K @ (D - model.D),
        c=model.c + model.K @ (d - model.d),
        C=C,
        D=D,
        d=d,
        S=S,
    )
    return fit_start(changed, trajectories, settings.starts)


def fit_start(model: LinearFilter, trajectories: Trajectories, iterations: int, rows: int = 10) -> LinearFilter:
    """Mean and covariance of q_0, by expectation maximisation over the first rows of all trajectories.

    Were q_0 known, innovations would be white with covariance S_t: they are linear in what q_0 differs by from any
    guess, e_t = e_t(guess) - C Phi_t delta, with Phi_{t+1} = (A - K_t C) Phi_t. So each trajectory gives an
    information matrix M and vector b on its own delta ~ N(mu, P_0).
    """
    if iterations == 0:
        return model
    guess = replace(model, initial_covariance=np.zeros_like(model.initial_covariance), limit=np.inf)
    M, b = _start_information(guess, trajectories, rows)
    mean, covariance = np.zeros(model.state_size), np.eye(model.state_size)
    identity = np.eye(model.state_size)
    for _ in range(iterations):
        # (P⁻¹ + M)⁻¹ = (I + P M)⁻¹ P needs no inverse of P, which shrinks in directions that all starts share.
        posterior = np.linalg.solve(identity + covariance @ M, np.broadcast_to(covariance, M.shape))
        residual = b - M @ mean
        moved = mean + np.einsum("eij,ej->ei", posterior, residual)
        mean = moved.mean(axis=0)
        covariance = posterior.mean(axis=0) + np.cov(moved.T, bias=True).reshape(identity.shape)
        covariance = 0.5 * (covariance + covariance.T)
    return replace(model, initial_mean=model.initial_mean + mean, initial_covariance=covariance)


def _start_information(
    model: LinearFilter, trajectories: Trajectories, rows: int
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """M [E, p, p] and b [E, p] of each trajectory."""
    count, p = len(trajectories.lengths), model.state_size
    state = model.initial(count)
    phi = np.tile(np.eye(p), (count, 1, 1))
    M, b = np.zeros((count, p, p)), np.zeros((count, p))
    for step in range(min(rows, int(trajectories.lengths.max()))):
        index = np.minimum(trajectories.first[:-1] + step, trajectories.first[1:] - 1)
        running = trajectories.lengths > step
        observation = np.where(running[:, None], trajectories.observation[index], np.nan)
        action = trajectories.action[index]
        there = seen(observation)
        P = state.covariance
        total = model.C @ P @ model.C.T + model.S
        innovation = np.where(there[:, None], (observation - model.predict(state, action)) / model.scale, 0.0)
        slope = model.C @ phi
        weighted = np.linalg.solve(total, slope) * there[:, None, None]
        M += slope.transpose(0, 2, 1) @ weighted
        b += np.einsum("eoi,eo->ei", weighted, innovation)
        gain = np.linalg.solve(total, (model.A @ P @ model.C.T + model.K @ model.S).transpose(0, 2, 1))
        phi = model.A @ phi - (gain.transpose(0, 2, 1) @ slope) * there[:, None, None]
        state = model.update(state, action, observation)
    return M, b


def _prediction_moments(filtered: Filtered, model: LinearFilter, trajectories: Trajectories, past: int) -> Moments:
    """Of state, action and standardised observation, where it was seen and the filter has settled."""
    rows = trajectories.seen & (trajectories.age >= past)
    scaled = (trajectories.observation[rows] - model.shift) / model.scale
    return second_moments(np.concatenate([filtered.state[rows], trajectories.action[rows], scaled], axis=1))


def _floored(S: FloatArray) -> FloatArray:
    """A covariance without directions of no variance."""
    values, vectors = np.linalg.eigh(0.5 * (S + S.T))
    floored: FloatArray = (vectors * np.maximum(values, 1e-9 * max(values[-1], 1e-12))) @ vectors.T
    return floored
