"""The thesis's predictive state: Hilbert space embeddings of controlled systems by random features (§2.5.6, §5.4).

The state embeds the distribution of future observations given future actions. Stage 1 regresses products of features
on the past and conditions by kernel Bayes' rule, sample by sample; stage 2 regresses extended on predictive states,
W_ext, for the future skipped by one step and for the present observation. An update contracts:

    q' = W_ext^ξ q ⊗ φ(a) ⊗ v,    v = (C'C + λI)⁻¹ C φ(o),    C = W_ext^o q ⊗ φ(a),

with Tikhonov's λ squared-in (C is estimated, and not positive definite), where Eq. 2.77 has C + λI and an order of
products that does not fit its shapes. λ = 1e-4 and W_pred fitted on filtered states are 3 and 2 times better than the
published .01 and states of stage 1.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numba import njit
from scipy.linalg import cho_factor, cho_solve

from predplan.control import cholesky
from predplan.control.autoregression import hold_last, standardise
from predplan.control.bounds import check_number, check_whole
from predplan.control.features import FeatureMap, Features, FeatureSettings, components, fit_features
from predplan.control.filtering import FilterState, filter_trajectories
from predplan.control.moments import solve_right
from predplan.control.tasks import FloatArray, IntArray
from predplan.control.trajectories import Trajectories, seen
from predplan.control.windows import Windows, make_windows


@dataclass(frozen=True)
class KernelSettings:
    """How the filter is learned."""

    past: int = 10  # P, rows
    future: int = 10  # F, rows
    dimension: int = 20  # p, of the state and of each feature
    frequencies: int = 500  # of each feature map
    percentile: float = 95.0  # of squared distances, the squared bandwidth
    lam: float = 1e-4  # of both regressions and of kernel Bayes' rule
    beyond: float = 3.0  # states are clipped at so many times the largest of stage 1

    def __post_init__(self) -> None:
        check_whole(self, "past", "future", "dimension", "frequencies")
        check_number(self, "percentile", above=0, most=100)
        check_number(self, "lam", "beyond", above=0)


@dataclass(frozen=True)
class KernelFilter:
    """What was learned. p: state, o and a: features of the present observation and action, x and y: extended ones."""

    observed: Features  # φ of o_t
    acted: Features  # φ of a_t
    to_state: FloatArray  # [p, P, Q]: of the future's matrix, observations by actions
    from_skipped: FloatArray  # [P, o, x]: of extended observations, future by present
    from_skipped_action: FloatArray  # [a, Q, y]: of extended actions, present by future
    from_square: FloatArray  # [o, o, s]: of φ(o) φ(o)'
    extend: FloatArray  # [x, y, p] W_ext for the skipped future
    immediate: FloatArray  # [s, a, p] W_ext for the present observation
    predictor: FloatArray  # [O, p, a] W_pred, of standardised observations
    shift: FloatArray  # [O] m, rad
    scale: FloatArray  # [O] m, rad
    start: FloatArray  # [p] q_0
    lam: float
    limit: float  # |q| is clipped here

    @property
    def state_size(self) -> int:
        """p."""
        return len(self.start)

    @property
    def observation_size(self) -> int:
        """O."""
        return len(self.predictor)

    def initial(self, copies: int) -> FilterState:
        """q_0, the mean state of stage 1 at the start of trajectories."""
        return FilterState(np.tile(self.start, (copies, 1)), np.empty((copies, 0, 0)), np.zeros(copies, np.int64))

    def update(self, state: FilterState, action: FloatArray, observation: FloatArray) -> FilterState:
        """Extend and condition; where o is missing, condition on what is expected of it."""
        expected = self.predict(state, action)
        observation = np.where(seen(observation)[:, None], observation, expected)
        mean, skipped = state.mean.copy(), state.skipped.copy()
        a, o = np.ascontiguousarray(self.acted(action)), np.ascontiguousarray(self.observed(observation))
        weights = (self.to_state, self.from_skipped, self.from_skipped_action, self.from_square)
        _update_rows(weights, self.extend, self.immediate, mean, skipped, a, o, self.lam, self.limit)
        return FilterState(mean, state.covariance, skipped)

    def predict(self, state: FilterState, action: FloatArray) -> FloatArray:
        """W_pred (q ⊗ φ(a))."""
        outer = state.mean[:, :, None] * self.acted(action)[:, None, :]
        weights = self.predictor.reshape(self.observation_size, -1)
        predicted: FloatArray = outer.reshape(len(outer), -1) @ weights.T * self.scale + self.shift
        return predicted


def fit_kernel(trajectories: Trajectories, settings: KernelSettings, generator: np.random.Generator) -> KernelFilter:
    """Learn the filter; missing observations are held at the last that was seen. Raises InputError on short data."""
    standard = standardise(trajectories)
    trajectories = trajectories.with_observation(hold_last(trajectories, standard.shift))
    # Filters start at a trajectory's start: states of stage 1 must be known there too, or W_ext is used where it was
    # never fitted. So pasts reach back before it, to a time when the first observation had been there all along.
    padding = settings.past - 1
    padded = trajectories.padded(padding)
    windows = make_windows(padded, settings.past, settings.future)
    started = padded.age[windows.rows] == settings.past
    maps = _feature_maps(windows, settings, generator)
    past = maps["past"](_flat(windows.past_observation, windows.past_action))
    o, a = maps["o"](windows.extended_observation[:, 0]), maps["a"](windows.extended_action[:, 0])
    later_o = maps["future o"](_flat(windows.shifted_observation))
    later_a = maps["future a"](_flat(windows.shifted_action))

    def pairs(left: FloatArray, right: FloatArray) -> tuple[FloatArray, FloatArray]:
        outer = np.einsum("ni,nj->nij", left, right)
        flat = outer.reshape(len(outer), -1)
        projection = components(flat, settings.dimension, generator)
        return flat @ projection, projection.reshape(*outer.shape[1:], -1)

    skipped, from_skipped = pairs(later_o, o)
    skipped_action, from_skipped_action = pairs(a, later_a)
    square, from_square = pairs(o, o)
    now_o, now_a = maps["future o"](_flat(windows.future_observation)), maps["future a"](_flat(windows.future_action))
    states = conditioned(past, now_o, now_a, settings.lam)
    flat = states.reshape(len(states), -1)
    to_state = components(flat, settings.dimension, generator)
    q = flat @ to_state
    extended = conditioned(past, skipped, skipped_action, settings.lam)
    immediate = conditioned(past, square, a, settings.lam)
    model = KernelFilter(
        observed=maps["o"],
        acted=maps["a"],
        to_state=np.ascontiguousarray(to_state.T).reshape(-1, *states.shape[1:]),
        from_skipped=from_skipped,
        from_skipped_action=from_skipped_action,
        from_square=from_square,
        extend=_regress(q, extended, settings.lam),
        immediate=_regress(q, immediate, settings.lam),
        predictor=np.zeros((trajectories.observation.shape[1], q.shape[1], a.shape[1])),
        shift=standard.shift,
        scale=standard.scale,
        start=q[started].mean(axis=0),
        lam=settings.lam,
        limit=float(settings.beyond * np.sqrt((q**2).sum(axis=1).max())),
    )
    # Filtering needs a W_pred where observations are missing; they are held here, and the one on stage 1 is not used.
    rows = trajectories.age >= 1
    filtered = filter_trajectories(model, trajectories).state[rows]
    acted = model.acted(trajectories.action[rows])
    return _with_predictor(model, filtered, acted, trajectories.observation[rows], settings.lam)


def conditioned(past: FloatArray, left: FloatArray, right: FloatArray, lam: float) -> FloatArray:
    """Joint stage 1: C_{left | right} = C_LR C_RR (C_RR² + λI)⁻¹ given each past. [n, h], [n, l], [n, r] -> [n, l, r].

    C_LR and C_RR are ridge regressions of products of features on those of the past.
    """
    n, rows, columns = len(past), left.shape[1], right.shape[1]
    crossed = _fitted(past, np.einsum("ni,nj->nij", left, right).reshape(n, -1), lam).reshape(n, rows, columns)
    squares = _fitted(past, np.einsum("ni,nj->nij", right, right).reshape(n, -1), lam).reshape(n, columns, columns)
    crossed = np.ascontiguousarray(crossed)
    _condition_rows(crossed, np.ascontiguousarray(squares), lam)
    return crossed


def _feature_maps(windows: Windows, settings: KernelSettings, generator: np.random.Generator) -> dict[str, FeatureMap]:
    points = {
        "past": _flat(windows.past_observation, windows.past_action),
        "o": windows.extended_observation[:, 0],
        "a": windows.extended_action[:, 0],
        "future o": _flat(windows.future_observation),
        "future a": _flat(windows.future_action),
    }
    one = FeatureSettings(settings.frequencies, settings.percentile, settings.dimension)
    return {name: fit_features(values, one, generator) for name, values in points.items()}


def _fitted(inputs: FloatArray, outputs: FloatArray, lam: float) -> FloatArray:
    """Outputs as ridge regression without intercept has them."""
    fitted: FloatArray = inputs @ _ridge(inputs, outputs, lam)
    return fitted


def _ridge(inputs: FloatArray, outputs: FloatArray, lam: float) -> FloatArray:
    """Coefficients [d, e] of outputs [n, e] on inputs [n, d]; lam is relative to the inputs' mean square."""
    n = len(inputs)
    gram = inputs.T @ inputs / n
    regular = gram + lam * np.trace(gram) / len(gram) * np.eye(len(gram))
    return np.asarray(cho_solve(cho_factor(regular), inputs.T @ outputs / n))


def _regress(q: FloatArray, matrices: FloatArray, lam: float) -> FloatArray:
    """Stage 2: W [l, r, p] of matrices [n, l, r] on states [n, p]."""
    n, rows, columns = matrices.shape
    weights = _ridge(q, matrices.reshape(n, -1), lam)
    return np.ascontiguousarray(weights.T).reshape(rows, columns, -1)


def _with_predictor(
    model: KernelFilter, q: FloatArray, acted: FloatArray, observation: FloatArray, lam: float
) -> KernelFilter:
    """W_pred by ridge regression on q ⊗ φ(a)."""
    outer = np.einsum("ni,nj->nij", q, acted).reshape(len(q), -1)
    scaled = (observation - model.shift) / model.scale
    xx, yx = outer.T @ outer / len(q), scaled.T @ outer / len(q)
    return replace(model, predictor=solve_right(yx, xx, 1e-3 * lam).reshape(model.predictor.shape))


def _flat(*windows: FloatArray) -> FloatArray:
    return np.concatenate([one.reshape(len(one), -1) for one in windows], axis=1)


@njit(cache=True, error_model="numpy")
def _condition_rows(crossed: FloatArray, squares: FloatArray, lam: float) -> None:
    """C_LR C_RR (C_RR² + λI)⁻¹ in place of C_LR, for each sample."""
    for i in range(len(crossed)):
        square = 0.5 * (squares[i] + squares[i].T)
        total = np.dot(square, square)
        for j in range(len(total)):
            total[j, j] += lam
        product = np.dot(crossed[i], square)
        cholesky.factor(total)
        for j in range(len(product)):
            cholesky.solve(total, product[j])
        crossed[i] = product


@njit(cache=True, error_model="numpy")
def _update_rows(
    weights: tuple[FloatArray, FloatArray, FloatArray, FloatArray],
    extend: FloatArray,
    immediate: FloatArray,
    mean: FloatArray,
    skipped: IntArray,
    action: FloatArray,
    observation: FloatArray,
    lam: float,
    limit: float,
) -> None:
    """Update all copies in place."""
    to_state, from_skipped, from_skipped_action, from_square = weights
    p = mean.shape[1]
    P, o, x = from_skipped.shape
    a, Q, y = from_skipped_action.shape
    s = from_square.shape[2]
    extend_flat, immediate_flat = extend.reshape(x * y, p), immediate.reshape(s * a, p)
    square_flat, state_flat = from_square.reshape(o * o, s), to_state.reshape(p, P * Q)
    action_flat = from_skipped_action.reshape(a, Q * y)
    for i in range(len(mean)):
        q = mean[i]
        present = np.dot(np.dot(immediate_flat, q).reshape(s, a), action[i])
        C = np.dot(square_flat, present).reshape(o, o)
        total = np.dot(C.T, C)
        for j in range(o):
            total[j, j] += lam
        v = np.dot(C, observation[i])
        cholesky.factor(total)
        cholesky.solve(total, v)
        later = np.zeros((P, x))
        for j in range(P):
            for k in range(o):
                value = v[k]
                for m in range(x):
                    later[j, m] += value * from_skipped[j, k, m]
        done = np.dot(action[i], action_flat).reshape(Q, y)
        extended = np.dot(extend_flat, q).reshape(x, y)
        moved = np.dot(state_flat, np.dot(np.dot(later, extended), done.T).reshape(P * Q))
        square = np.dot(moved, moved)
        if not np.isfinite(square):
            skipped[i] += 1
            continue
        shrink = min(1.0, limit / max(np.sqrt(square), 1e-300))
        for j in range(p):
            q[j] = shrink * moved[j]
