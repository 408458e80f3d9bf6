"""What a training leaves behind: all that acting needs."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from predplan.control.environments import EnvironmentSettings
from predplan.control.linear_filter import LinearFilter
from predplan.control.memories import Memory, Predictive, Window
from predplan.control.methods import Method
from predplan.control.networks import ActorCritic
from predplan.control.whitening import Whitening


@dataclass(frozen=True)
class Learned:
    """All that acting needs."""

    task: EnvironmentSettings  # that it was learned in
    name: str  # of the method
    method: Method
    observations: int  # O
    actions: int  # A
    network: ActorCritic
    whitening: Whitening
    model: LinearFilter | None = None

    def memory(self, copies: int) -> Memory:
        """Of that many copies."""
        window = Window(copies, max(self.method.window, 1), np.zeros(self.observations), self.actions)
        if self.model is None:
            return window
        return Predictive(copies, self.model, self.actions, window if self.method.window else None)
