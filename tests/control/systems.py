"""Known linear-Gaussian systems, their exact Kalman filter, and trajectories of them."""

from dataclasses import dataclass

import numpy as np
from scipy.linalg import solve_discrete_are

from predplan.control.linear_filter import LinearFilter
from predplan.control.trajectories import Trajectories

FloatArray = np.ndarray


@dataclass(frozen=True)
class System:
    """x' = A x + B a + w, o = C x + D a + v, with w ~ N(0, Q) and v ~ N(0, R) apart; x_0 ~ N(0, P0)."""

    A: FloatArray
    B: FloatArray
    C: FloatArray
    D: FloatArray
    Q: FloatArray
    R: FloatArray
    P0: FloatArray

    @property
    def steady(self) -> FloatArray:
        """The steady-state covariance of predictions."""
        return np.asarray(solve_discrete_are(self.A.T, self.C.T, self.Q, self.R))

    @property
    def innovation_form(self) -> tuple[FloatArray, FloatArray]:
        """K and S of the steady-state filter."""
        P = self.steady
        S = self.C @ P @ self.C.T + self.R
        return self.A @ P @ self.C.T @ np.linalg.inv(S), S


def example() -> System:
    """A damped spring pushed by the action, whose position alone is observed, and a slow drift of the sensor."""
    A = np.array([[0.96, 0.25, 0.0], [-0.2, 0.93, 0.0], [0.0, 0.0, 0.8]])
    B = np.array([[0.03], [0.25], [0.0]])
    C = np.array([[1.0, 0.0, 1.0], [0.3, 0.5, 0.0]])
    D = np.array([[0.02], [0.1]])
    system = System(A, B, C, D, np.diag([0.003, 0.02, 0.01]), np.diag([0.05, 0.08]), np.eye(3))
    return System(A, B, C, D, system.Q, system.R, system.steady)


def simulate(
    system: System, trajectories: int, length: int, generator: np.random.Generator, drop: float = 0.0
) -> Trajectories:
    """Trajectories of that many rows, action 0 in the first, actions N(0, 1) in the others."""
    n, o, u = len(system.A), len(system.C), system.B.shape[1]
    x = generator.multivariate_normal(np.zeros(n), system.P0, trajectories)
    action = generator.standard_normal((length, trajectories, u))
    action[0] = 0.0
    observation = np.empty((length, trajectories, o))
    for t in range(length):
        noise = generator.multivariate_normal(np.zeros(o), system.R, trajectories)
        observation[t] = x @ system.C.T + action[t] @ system.D.T + noise
        x = x @ system.A.T + action[t] @ system.B.T
        x += generator.multivariate_normal(np.zeros(n), system.Q, trajectories)
    observation[generator.random((length, trajectories)) < drop] = np.nan
    total = trajectories * length
    return Trajectories(
        observation=observation.transpose(1, 0, 2).reshape(total, o),
        action=action.transpose(1, 0, 2).reshape(total, u),
        reward=np.zeros(total),
        terminated=np.zeros(total, np.bool_),
        truncated=np.zeros(total, np.bool_),
        first=np.arange(trajectories + 1) * length,
    )


def kalman_predictions(system: System, trajectories: Trajectories) -> FloatArray:
    """E[o_t | a_t and what was seen before] [n, O], by the textbook's filter with Q and R told apart."""
    predictions = np.empty_like(trajectories.observation)
    for first, end in zip(trajectories.first[:-1], trajectories.first[1:], strict=True):
        x, P = np.zeros(len(system.A)), system.P0.copy()
        for t in range(first, end):
            a, o = trajectories.action[t], trajectories.observation[t]
            predictions[t] = system.C @ x + system.D @ a
            if np.isfinite(o).all():
                S = system.C @ P @ system.C.T + system.R
                gain = P @ system.C.T @ np.linalg.inv(S)
                x = x + gain @ (o - predictions[t])
                P = P - gain @ system.C @ P
            x = system.A @ x + system.B @ a
            P = system.A @ P @ system.A.T + system.Q
    return predictions


def exact_filter(system: System) -> LinearFilter:
    """Our filter with the system's own innovation form; it starts settled, as P0 is the steady covariance."""
    K, S = system.innovation_form
    n, o = len(system.A), len(system.C)
    return LinearFilter(
        A=system.A,
        B=system.B,
        c=np.zeros(n),
        K=K,
        C=system.C,
        D=system.D,
        d=np.zeros(o),
        S=S,
        initial_mean=np.zeros(n),
        initial_covariance=np.zeros((n, n)),
        limit=1e6,
        shift=np.zeros(o),
        scale=np.ones(o),
    )
