"""Motion planning by functional gradient descent in reproducing kernel Hilbert spaces, with proofs (chapter 4)."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from predplan.planning.certificates import Certificate, certify
    from predplan.planning.plan_files import read_plan, write_plan
    from predplan.planning.planner import METHODS, Planner, PlannerSettings
    from predplan.planning.plans import Plan
    from predplan.planning.robot_files import read_robot
    from predplan.planning.robots import Robot
    from predplan.planning.scene_files import Request, read_request, read_scene
    from predplan.planning.scenes import Box, Capsule, Cylinder, Mesh, Scene, Sphere, make_scene

__all__ = [
    "METHODS",
    "Box",
    "Capsule",
    "Certificate",
    "Cylinder",
    "Mesh",
    "Plan",
    "Planner",
    "PlannerSettings",
    "Request",
    "Robot",
    "Scene",
    "Sphere",
    "certify",
    "make_scene",
    "read_plan",
    "read_request",
    "read_robot",
    "read_scene",
    "write_plan",
]

_NAMES = {
    "certificates": ("Certificate", "certify"),
    "plan_files": ("read_plan", "write_plan"),
    "planner": ("METHODS", "Planner", "PlannerSettings"),
    "plans": ("Plan",),
    "robot_files": ("read_robot",),
    "robots": ("Robot",),
    "scene_files": ("Request", "read_request", "read_scene"),
    "scenes": ("Box", "Capsule", "Cylinder", "Mesh", "Scene", "Sphere", "make_scene"),
}
_HOMES = {name: home for home, names in _NAMES.items() for name in names}


def __getattr__(name: str) -> Any:
    """Names are found when they are asked for, so that importing one module does not load them all."""
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.{_HOMES[name]}"), name)
