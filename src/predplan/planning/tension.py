"""The kernel whose norm is a trajectory's energy: what a taut elastic rod between start and goal minimises."""

from dataclasses import dataclass

import numpy as np

from predplan.planning.robots import FloatArray


@dataclass(frozen=True)
class Tension:
    """The reproducing kernel of ‖f‖² = ∫ ḟ² + width² f̈² dt over f with f(0) = f(1) = 0: tension splines.

    With G the Green's function of -∂² and H that of width⁻² - ∂², both zero at the ends, k = G - H. Since ∫ ḟ dt = 0,
    the norm of f is the energy of line + f less that of the line: the element of least norm is the least detour, with
    corners rounded over `width`.
    """

    width: float  # t in [0, 1], .002 or more

    @property
    def smoothness(self) -> float:
        """Velocities are in the space."""
        return 1

    def gram(self, s: FloatArray, t: FloatArray, s_order: int = 0, t_order: int = 0) -> FloatArray:
        """Derivatives are continuous up to order 2 of both together; on s = t those of s < t are given."""
        first, second = np.asarray(s, np.float64)[:, None], np.asarray(t, np.float64)[None, :]
        below = self._ordered(first, second, s_order, t_order)
        above = self._ordered(second, first, t_order, s_order)
        return np.where(first <= second, below, above)

    def _ordered(self, s: FloatArray, t: FloatArray, s_order: int, t_order: int) -> FloatArray:
        """s (1 - t) - width sinh(s/width) sinh((1 - t)/width) / sinh(1/width), for s <= t, and its derivatives."""
        rate = 1.0 / self.width
        line = _power(s, s_order) * (-1.0) ** t_order * _power(1.0 - t, t_order)
        bent = _hyperbolic(rate * s, s_order) * (-1.0) ** t_order * _hyperbolic(rate * (1.0 - t), t_order)
        return np.asarray(line - rate ** (s_order + t_order - 1) * bent / np.sinh(rate), np.float64)


def _power(x: FloatArray, order: int) -> FloatArray:
    """x or its derivative."""
    return x if order == 0 else np.full_like(x, 1.0 if order == 1 else 0.0)


def _hyperbolic(x: FloatArray, order: int) -> FloatArray:
    """sinh x or its derivative."""
    return np.asarray(np.cosh(x) if order % 2 else np.sinh(x), np.float64)
