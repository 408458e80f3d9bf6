"""What acts in an environment, whatever it remembers and however it was learned."""

from __future__ import annotations

from typing import Protocol

from predplan.control.tasks import FloatArray, IntArray


class Actor(Protocol):
    """What acts: copies side by side."""

    def reset(self, rows: IntArray, observation: FloatArray) -> None:
        """Those copies begin an episode; observation [len(rows), O] of the reset, NaN where it was lost."""

    def act(self, rows: IntArray) -> FloatArray:
        """Actions [len(rows), A] in [-1, 1] from what was seen so far."""

    def observe(self, rows: IntArray, action: FloatArray, observation: FloatArray) -> None:
        """Those copies did action [len(rows), A] and observed [len(rows), O] upon it."""

    @property
    def state(self) -> FloatArray:
        """[copies, p] predictive (or memory) state; p may be 0."""

    def predict(self, rows: IntArray, action: FloatArray) -> FloatArray:
        """[len(rows), O] expected of actions [len(rows), A]; NaN where a method predicts nothing."""
