"""Adam (Kingma and Ba 2015) on one vector of all parameters.

torch.optim's costs seconds of imports and a dispatch for each parameter; here a step is a handful of operations on
one vector, and what must be kept to resume is three arrays.
"""

from __future__ import annotations

import numpy as np
import torch
from torch import Tensor, nn

from predplan.control.memories import Arrays

BETAS = (0.9, 0.999)
"""Shares of both averages that a step keeps, as published."""


class Adam:
    """Averages of the gradient and of its square."""

    def __init__(self, module: nn.Module, rate: float) -> None:
        self.rate = rate
        self._parameters = [one for one in module.parameters() if one.requires_grad]
        size = sum(one.numel() for one in self._parameters)
        self._first, self._second, self._count = torch.zeros(size), torch.zeros(size), 0

    def step(self, loss: Tensor, largest: float) -> bool:
        """One step down the loss, its gradient's norm at most `largest`; False, and no step, if it is not finite."""
        return self.follow(self.gradient(loss), largest)

    def gradient(self, loss: Tensor) -> Tensor:
        """Of the loss by all parameters, one vector; 0 where it does not depend on one."""
        gradients = torch.autograd.grad(loss, self._parameters, allow_unused=True, retain_graph=True)
        both = zip(self._parameters, gradients, strict=True)
        return torch.cat(
            [(torch.zeros_like(one) if slope is None else slope).reshape(-1).float() for one, slope in both]
        )

    @torch.no_grad()
    def follow(self, gradient: Tensor, largest: float) -> bool:
        """The same with a gradient that is known."""
        norm = float(gradient.norm())
        if not np.isfinite(norm):
            return False
        gradient = gradient * min(1.0, largest / max(norm, 1e-12))
        self._count += 1
        first, second = BETAS
        self._first.mul_(first).add_(gradient, alpha=1.0 - first)
        self._second.mul_(second).addcmul_(gradient, gradient, value=1.0 - second)
        rate = self.rate / (1.0 - first**self._count)
        change = self._first / (self._second / (1.0 - second**self._count)).sqrt_().add_(1e-5)
        at = 0
        for one in self._parameters:
            one.sub_(change[at : at + one.numel()].view_as(one), alpha=rate)
            at += one.numel()
        return True

    def arrays(self) -> Arrays:
        """Both averages and the count."""
        return {"first": self._first.numpy(), "second": self._second.numpy(), "count": np.array([self._count])}

    def restore(self, arrays: Arrays) -> None:
        """Go on from those."""
        self._first, self._second = (torch.from_numpy(np.array(arrays[name])) for name in ("first", "second"))
        self._count = int(arrays["count"][0])
