"""What is said of a plan: plain data for JSON, and lines to read."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import asdict
from typing import Any

from predplan.planning.plans import Plan


def as_plain_data(plan: Plan) -> dict[str, Any]:
    """A plan as JSON has it, units in the names; what a plan without a trajectory lacks is null.

    limits: those of the robot, and as `used` the largest share of each kind that the timed trajectory takes.
    """
    robot, certificate = plan.robot, plan.certificate
    return {
        "success": plan.success,
        "certified": plan.certified,
        "reason": plan.reason,
        "method": plan.method,
        "time_s": plan.time_s,
        "duration_s": plan.duration_s if plan.success else None,
        "costs": dict(plan.costs) if plan.success else None,
        "certificate": None
        if certificate is None
        else {
            "free": certificate.free,
            "margin_m": certificate.margin,
            "configurations": certificate.configurations,
            "reason": certificate.reason,
        },
        "limits": {
            "joints": list(plan.joints),
            "lower": robot.chain.lower.tolist(),
            "upper": robot.chain.upper.tolist(),
            "velocity": robot.velocity_limit.tolist(),
            "acceleration": robot.acceleration_limit.tolist(),
            "used": dict(plan.limits) if plan.success else None,
        },
        "attempts": [asdict(attempt) for attempt in plan.attempts],
    }


def lines_of(plan: Plan) -> Iterator[str]:
    """A plan with a trajectory, a line for each thing to know of it."""
    costs, certificate = plan.costs, plan.certificate
    if certificate is not None:
        margin = f" by {1000 * certificate.margin:g} mm" if certificate.margin else ""
        looks = f"{certificate.configurations} configurations looked at"
        yield f"certified     free of collision{margin} and within joint limits all the way ({looks})"
    yield f"method        {plan.method}: {plan.attempts[-1].start}, after {_counted(len(plan.attempts), 'attempt')}"
    yield f"time          {1000 * plan.time_s:.1f} ms"
    yield f"duration      {plan.duration_s:.3f} s"
    yield f"length        {costs['length_rad']:.3f} rad"
    yield f"acceleration  {costs['acceleration_cost']:.2f} (½ mean ‖q̈‖² over the path's own time, 0 to 1)"
    yield "limits used   " + ", ".join(f"{kind} {share:.0%}" for kind, share in plan.limits.items())


def _counted(number: int, what: str) -> str:
    return f"{number} {what}" if number == 1 else f"{number} {what}s"
