"""Windows of past, future and extended future around each row of the trajectories (§2.5.6).

The past of row t is rows t - P to t - 1, its future t to t + F - 1, its extended future t to t + F, of observations and
actions alike; a_t is executed before o_t. A row has windows only where its trajectory holds all of them.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from predplan.control.tasks import FloatArray, IntArray
from predplan.control.trajectories import Trajectories
from predplan.errors import InputError


@dataclass(frozen=True)
class Windows:
    """m windows. Rows that were not seen stay so: they are not finite."""

    rows: IntArray  # [m] t, the row after the past
    past_observation: FloatArray  # [m, P, O]
    past_action: FloatArray  # [m, P, A]
    extended_observation: FloatArray  # [m, F + 1, O]
    extended_action: FloatArray  # [m, F + 1, A]

    @property
    def future_observation(self) -> FloatArray:
        """[m, F, O], from o_t on."""
        return self.extended_observation[:, :-1]

    @property
    def future_action(self) -> FloatArray:
        """[m, F, A], from a_t on."""
        return self.extended_action[:, :-1]

    @property
    def shifted_observation(self) -> FloatArray:
        """[m, F, O], from o_{t + 1} on."""
        return self.extended_observation[:, 1:]

    @property
    def shifted_action(self) -> FloatArray:
        """[m, F, A], from a_{t + 1} on."""
        return self.extended_action[:, 1:]


def window_rows(trajectories: Trajectories, past: int, ahead: int) -> IntArray:
    """The rows t [m] whose trajectory holds rows t - past to t + ahead.

    Raises InputError where no trajectory is that long.
    """
    if past < 1 or ahead < 0:
        raise InputError(f"window: found past {past} and {ahead} rows ahead, expected at least 1 and 0")
    age, lengths = trajectories.age, np.repeat(trajectories.lengths, trajectories.lengths)
    rows = np.flatnonzero((age >= past) & (age + ahead < lengths))
    if not len(rows):
        raise InputError(
            f"trajectories: the longest has {trajectories.lengths.max()} rows, a window needs {past + ahead + 1}"
        )
    return rows


def make_windows(trajectories: Trajectories, past: int, future: int) -> Windows:
    """All windows of P = past and F = future rows. Raises InputError where no trajectory is long enough."""
    if future < 1:
        raise InputError(f"future: found {future}, expected at least 1 row")
    rows = window_rows(trajectories, past, future)
    before, after = rows[:, None] + np.arange(-past, 0), rows[:, None] + np.arange(future + 1)
    return Windows(
        rows,
        trajectories.observation[before],
        trajectories.action[before],
        trajectories.observation[after],
        trajectories.action[after],
    )
