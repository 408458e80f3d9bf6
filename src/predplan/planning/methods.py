"""The methods that chapter 4 compares: a kernel, how its cost is reduced over time and body, and how far a step goes.

Every kernel is conditioned on both ends and normalised to max k(t, t) = 1, so that one step size means the same for
all; raw kernels differ by five orders of magnitude, and then the step alone decides which is best.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal, NamedTuple

from predplan.planning.kernels import (
    BSpline,
    Gaussian,
    Kernel,
    Laplacian,
    Waypoints,
    condition,
    normalise,
    with_derivative,
)
from predplan.planning.kinds import SuiteKind
from predplan.planning.optimiser import INTEGRAL, MAXIMUM_BODY, MAXIMUM_POINT, PATH_INTEGRAL

KernelName = Literal[
    "gaussian", "gaussian-derivative", "laplacian", "b-spline", "waypoints-velocity", "waypoints-acceleration"
]
Reduce = Literal["point", "body", "integral", "path-integral"]
"""The worst (time, body point) of each section; the whole body at the worst time of each; integrals over all times."""
REDUCES: dict[Reduce, int] = {
    "point": MAXIMUM_POINT,
    "body": MAXIMUM_BODY,
    "integral": INTEGRAL,
    "path-integral": PATH_INTEGRAL,
}

WIDE = 0.9
"""σ of the thesis, t in [0, 1]: conditioned on both ends it is practically one bump."""
NARROW = 0.15
"""σ at which an arm in the plane can go around several obstacles."""
MIDDLE = 0.3
"""σ for seven joints."""


@dataclass(frozen=True)
class Method:
    """One row of a comparison."""

    name: str
    label: str
    kernel: KernelName
    width: float = WIDE  # of the kernel, t in [0, 1]; waypoints have none
    interaction: bool = False  # joints coupled by the end effector's Jacobian at the start (Eq. 4.7)
    reduce: Reduce = "point"
    sections: int = 1  # of time, one maximum in each
    samples: int = 48  # inner times at which the arm is looked at
    quadrature: bool = False  # Gauss-Legendre's times and weights in place of equal steps
    shrinkage: float = 0.025  # β/λ, what an iteration takes off f; the thesis's β = 1 with λ = 40
    epsilon: float = 0.05  # m: clearance at which obstacles begin to cost
    self_epsilon: float = 0.01  # m: the same between links
    step_cap: float = float("inf")  # rad or m: largest change of a joint in an iteration
    inverse_step: float = 1.0  # λ, where it is not tuned
    tuned_at: int = 0  # the iteration by whose costs λ is tuned; 0 is the last
    step_of: str = ""  # a method whose λ it takes
    step_factor: float = 1.0  # how many times as long its steps are as those that were chosen

    @property
    def beta(self) -> float:
        """Weight of ½‖f‖²."""
        return self.shrinkage * self.inverse_step

    @property
    def kernel_key(self) -> KernelKey:
        """What its kernel depends on."""
        return KernelKey(self.kernel, self.width, self.samples)


class KernelKey(NamedTuple):
    """A kernel by name."""

    name: KernelName
    width: float  # t in [0, 1]
    samples: int  # how many waypoints

    @property
    def waypoints(self) -> bool:
        """Whether its trajectories are polylines."""
        return self.name.startswith("waypoints")


def build_kernel(key: KernelKey) -> Kernel:
    """The kernel, conditioned on both ends and normalised."""
    kernel: Kernel
    match key.name:
        case "gaussian":
            kernel = Gaussian(key.width)
        case "gaussian-derivative":
            kernel = with_derivative(Gaussian(key.width), key.width)
        case "laplacian":
            kernel = Laplacian(key.width)
        case "b-spline":
            kernel = BSpline(key.width)
        case "waypoints-velocity":
            return normalise(Waypoints(key.samples, "velocity"))
        case "waypoints-acceleration":
            return normalise(Waypoints(key.samples, "acceleration"))
    return normalise(condition(kernel))


def methods_of(kind: SuiteKind) -> tuple[Method, ...]:
    """The methods of a suite, in the order of its figures and tables."""
    if kind == "maze":
        return _maze_methods()
    if kind == "planar":
        return _planar_methods()
    return _kitchen_methods()


def _maze_methods() -> tuple[Method, ...]:
    """Five sections; "large" steps are twice those that are best after five iterations of the narrow Gaussian."""
    narrow = Method("grbf-narrow", f"Gaussian σ={NARROW}", "gaussian", NARROW, sections=5, samples=100, tuned_at=5)
    velocity = Method("waypoints-velocity", "waypoints, velocity", "waypoints-velocity", sections=5, samples=100)
    acceleration = Method(
        "waypoints-acceleration", "waypoints, acceleration", "waypoints-acceleration", sections=5, samples=100
    )
    same = replace(narrow, step_of=narrow.name)

    def large(method: Method, label: str) -> Method:
        return replace(method, name=f"{method.name}-large", label=label, step_of=narrow.name, step_factor=2.0)

    return (
        replace(narrow, name="grbf", label=f"Gaussian σ={WIDE}", width=WIDE),
        narrow,
        velocity,
        acceleration,
        replace(velocity, name="waypoints-few", label="5 waypoints, velocity", samples=5),
        replace(same, name="b-spline-narrow", label=f"B-spline h={NARROW}", kernel="b-spline"),
        replace(same, name="laplacian-narrow", label=f"Laplacian σ={NARROW}", kernel="laplacian"),
        large(narrow, f"Gaussian σ={NARROW}, large"),
        large(velocity, "waypoints, vel., large"),
        large(acceleration, "waypoints, acc., large"),
    )


def _planar_methods() -> tuple[Method, ...]:
    """Four maxima over time and body for all kernels, then the costs of Fig. 4.6 and the points of Fig. 4.16."""
    grbf = Method("grbf", f"Gaussian σ={WIDE}", "gaussian", sections=4)
    velocity = Method("waypoints-velocity", "waypoints, velocity", "waypoints-velocity", sections=4)
    acceleration = Method("waypoints-acceleration", "waypoints, acceleration", "waypoints-acceleration", sections=4)
    narrow = replace(grbf, name="grbf-narrow", label=f"Gaussian σ={NARROW}", width=NARROW)
    return (
        grbf,
        narrow,
        Method("laplacian", f"Laplacian σ={WIDE}", "laplacian", sections=4),
        Method("b-spline", f"B-spline h={WIDE}", "b-spline", sections=4),
        Method("b-spline-narrow", f"B-spline h={MIDDLE}", "b-spline", MIDDLE, sections=4),
        velocity,
        acceleration,
        Method("grbf-der", f"Gaussian + derivative σ={WIDE}", "gaussian-derivative", sections=4),
        replace(grbf, name="grbf-jj", label=f"Gaussian, joints coupled, σ={WIDE}", interaction=True),
        replace(velocity, name="chomp-velocity", label="CHOMP, velocity", reduce="integral"),
        replace(acceleration, name="chomp-acceleration", label="CHOMP, acceleration", reduce="integral"),
        replace(velocity, name="chomp-path", label="CHOMP, velocity, by arc length", reduce="path-integral"),
        replace(grbf, name="grbf-waypoints", label=f"Gaussian σ={WIDE} at 20 waypoints", reduce="integral", samples=20),
        replace(
            narrow,
            name="grbf-narrow-waypoints",
            label=f"Gaussian σ={NARROW} at 20 waypoints",
            reduce="integral",
            samples=20,
        ),
        replace(
            grbf,
            name="grbf-quadrature",
            label=f"Gaussian σ={WIDE}, Gauss-Legendre",
            reduce="integral",
            samples=20,
            quadrature=True,
        ),
        replace(
            narrow,
            name="grbf-narrow-quadrature",
            label=f"Gaussian σ={NARROW}, Gauss-Legendre",
            reduce="integral",
            samples=20,
            quadrature=True,
        ),
    )


def _kitchen_methods() -> tuple[Method, ...]:
    """One maximum for the kernels, all waypoints for CHOMP, as the thesis; narrower kernels and more maxima besides."""
    grbf = Method("grbf", f"Gaussian σ={WIDE}", "gaussian", samples=32)
    velocity = Method("chomp-velocity", "CHOMP, velocity", "waypoints-velocity", reduce="integral", samples=32)
    return (
        grbf,
        replace(grbf, name="grbf-der", label=f"Gaussian + derivative σ={WIDE}", kernel="gaussian-derivative"),
        replace(grbf, name="grbf-jj", label=f"Gaussian, joints coupled, σ={WIDE}", interaction=True),
        replace(grbf, name="grbf-middle", label=f"Gaussian σ={MIDDLE}", width=MIDDLE),
        replace(
            grbf,
            name="grbf-body",
            label=f"Gaussian σ={MIDDLE}, 4 times",
            width=MIDDLE,
            reduce="body",
            sections=4,
        ),
        velocity,
        replace(velocity, name="chomp-acceleration", label="CHOMP, acceleration", kernel="waypoints-acceleration"),
        replace(velocity, name="waypoints-velocity", label="waypoints, velocity, 1 maximum", reduce="point"),
    )
