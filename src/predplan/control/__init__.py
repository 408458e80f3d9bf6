"""Recurrent predictive-state policies: filters learned by regression, policies that act on their states (chapter 5)."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from predplan.control.environments import Environments, EnvironmentSettings
    from predplan.control.policies import Policy
    from predplan.control.policy_files import load_policy, save_policy
    from predplan.control.running import Order, Run, run
    from predplan.control.training import Schedule

__all__ = [
    "EnvironmentSettings",
    "Environments",
    "Order",
    "Policy",
    "Run",
    "Schedule",
    "load_policy",
    "run",
    "save_policy",
]

_NAMES = {
    "environments": ("EnvironmentSettings", "Environments"),
    "policies": ("Policy",),
    "policy_files": ("load_policy", "save_policy"),
    "running": ("Order", "Run", "run"),
    "training": ("Schedule",),
}
_HOMES = {name: home for home, names in _NAMES.items() for name in names}


def __getattr__(name: str) -> Any:
    """Names are found when they are asked for: torch is imported by nothing that does not need it."""
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.{_HOMES[name]}"), name)
