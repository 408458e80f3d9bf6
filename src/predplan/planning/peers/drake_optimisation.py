"""Drake's KinematicTrajectoryOptimization (Tedrake et al.), as its own tutorial sets it up, on the same spheres.

A cubic B-spline of configurations with the least mean squared velocity, first without obstacles, then with Drake's
MinimumDistanceLowerBoundConstraint at equally spaced times, solved by SNOPT; where that fails, again from a random
guess until the time is over. The robot's spheres and the scene's shapes are Drake's own geometry and its distances are
Drake's own: nothing is called back into Python. The pairs of links that may touch are ours.
"""

from __future__ import annotations

import time
from typing import Any

import numpy as np
from pydrake.geometry import Box as DrakeBox
from pydrake.geometry import Capsule as DrakeCapsule
from pydrake.geometry import CollisionFilterDeclaration, GeometrySet
from pydrake.geometry import Cylinder as DrakeCylinder
from pydrake.geometry import Sphere as DrakeSphere
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.multibody.inverse_kinematics import MinimumDistanceLowerBoundConstraint
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph, CoulombFriction
from pydrake.multibody.tree import FixedOffsetFrame, PrismaticJoint, RevoluteJoint, SpatialInertia
from pydrake.planning import KinematicTrajectoryOptimization
from pydrake.solvers import SnoptSolver, SolverOptions
from pydrake.systems.framework import DiagramBuilder
from scipy.interpolate import BSpline

from predplan.errors import PredplanError
from predplan.planning.benchmarks import Found, Prepare, Solve, piecewise
from predplan.planning.paths import Path
from predplan.planning.peers import PeerSettings
from predplan.planning.poses import along
from predplan.planning.problems import Problem
from predplan.planning.robots import Chain, FloatArray, Robot
from predplan.planning.scenes import Box, Capsule, Cylinder, Shape, Sphere

CONTROL_POINTS, ORDER, TIMES = 10, 4, 50
BOUND, INFLUENCE = 0.01, 0.05
"""m: the smallest distance allowed, and how far beyond it Drake looks.

Chosen on ten of the given problems, in Drake's favour: with the 25 times and 1 mm of its tutorial it solved all ten and
none was free between the times; with these nine, seven of them certified.
"""
GUESS_SPREAD = 0.5
"""rad: standard deviation of the control points of a random guess about the straight line's."""
MAJOR_ITERATIONS = 200


def make(name: str, robot: Robot, settings: PeerSettings) -> Prepare:
    """The optimisation for a robot; building Drake's model of a scene is preparation."""

    def prepare(problem: Problem) -> Solve:
        plant, context, keep_alive = model(problem)
        constraint = MinimumDistanceLowerBoundConstraint(plant, BOUND, context, None, INFLUENCE)

        def solve(seed: int) -> Found:
            assert keep_alive
            return _solve(problem, constraint, np.random.default_rng(seed), settings.drake_s)

        return solve

    return prepare


def _solve(problem: Problem, constraint: Any, generator: np.random.Generator, budget_s: float) -> Found:
    began = time.perf_counter()
    chain, joints = problem.robot.chain, len(problem.start)
    optimisation = KinematicTrajectoryOptimization(joints, CONTROL_POINTS, ORDER)
    optimisation.AddPositionBounds(chain.lower, chain.upper)
    optimisation.AddPathPositionConstraint(problem.start, problem.start, 0.0)
    optimisation.AddPathPositionConstraint(problem.goal, problem.goal, 1.0)
    optimisation.AddDurationConstraint(1.0, 1.0)
    program, solver = optimisation.get_mutable_prog(), SnoptSolver()
    points = optimisation.control_points()
    _add_velocity_cost(optimisation, points)
    # Control points at their Greville abscissae make the straight line at constant speed.
    knots = np.asarray(optimisation.basis().knots())
    line = problem.start[:, None] + np.multiply.outer(problem.goal - problem.start, _greville(knots))
    program.SetInitialGuess(points, line)
    free = solver.Solve(program)
    guess = free.GetSolution(points) if free.is_success() else line
    for s in np.linspace(0.0, 1.0, TIMES + 2)[1:-1]:
        optimisation.AddPathPositionConstraint(constraint, s)
    tries = 0
    while (left := budget_s - (time.perf_counter() - began)) > 0.0:
        program.SetInitialGuess(points, guess)
        options = SolverOptions()
        options.SetOption(solver.solver_id(), "Major iterations limit", MAJOR_ITERATIONS)
        options.SetOption(solver.solver_id(), "Time limit", max(left, 0.01))
        result = solver.Solve(program, None, options)
        tries += 1
        if result.is_success():
            return Found(_path(optimisation.ReconstructTrajectory(result)), f"solution {tries}")
        guess = line + np.pad(generator.normal(0.0, GUESS_SPREAD, (joints, CONTROL_POINTS - 2)), ((0, 0), (1, 1)))
        guess = np.clip(guess, chain.lower[:, None], chain.upper[:, None])
    return Found(None, f"{tries} starts without a solution")


def _greville(knots: FloatArray) -> FloatArray:
    """Means of each control point's inner knots [CONTROL_POINTS]."""
    return np.array([knots[i + 1 : i + ORDER].mean() for i in range(CONTROL_POINTS)])


def _add_velocity_cost(optimisation: Any, points: Any) -> None:
    """½ mean ‖ṙ‖², as we measure it; Drake's own energy cost takes control points for equally spaced."""
    spline = BSpline(np.asarray(optimisation.basis().knots()), np.eye(CONTROL_POINTS), ORDER - 1)
    rows = spline(np.linspace(0.0, 1.0, 201), nu=1)
    hessian = rows.T @ rows / len(rows)
    for row in points:
        optimisation.get_mutable_prog().AddQuadraticCost(hessian, np.zeros(CONTROL_POINTS), row)


def _path(trajectory: Any) -> Path:
    """A B-spline is polynomial between its knots."""
    end = float(trajectory.end_time())
    breaks = np.unique(np.clip(np.asarray(trajectory.basis().knots()) / end, 0.0, 1.0))

    def values(s: FloatArray) -> FloatArray:
        return np.asarray(trajectory.vector_values(s * end)).T

    return piecewise(values, breaks, ORDER - 1)


def model(problem: Problem) -> tuple[Any, Any, Any]:
    """Plant, its context, and what both live in."""
    robot, chain = problem.robot, problem.robot.chain
    builder = DiagramBuilder()
    plant, graph = AddMultibodyPlantSceneGraph(builder, 0.0)
    inertia = SpatialInertia.SolidSphereWithMass(1.0, 0.1)
    bodies = [plant.world_body()]
    for j, name in enumerate(robot.joints):
        body = plant.AddRigidBody(f"moved by {name}", inertia)
        pose = RigidTransform(RotationMatrix(chain.rotation[j]), chain.translation[j])
        mount = plant.AddFrame(FixedOffsetFrame(f"mount of {name}", bodies[chain.parent[j]].body_frame(), pose))
        joint = (PrismaticJoint if chain.prismatic[j] else RevoluteJoint)(
            name, mount, body.body_frame(), chain.axis[j], chain.lower[j], chain.upper[j]
        )
        plant.AddJoint(joint)
        bodies.append(body)
    friction = CoulombFriction(0.5, 0.5)  # demanded, and without effect on distances
    register = plant.RegisterCollisionGeometry
    links = [
        [
            register(
                bodies[chain.link_frame[link]],
                RigidTransform(chain.sphere_centre[s]),
                DrakeSphere(chain.sphere_radius[s]),
                f"{robot.links[link]} {s}",
                friction,
            )
            for s in range(chain.link_first[link], chain.link_first[link + 1])
        ]
        for link in range(len(robot.links))
    ]
    obstacles = [
        register(plant.world_body(), *_geometry(shape), f"obstacle {number}", friction)
        for number, shape in enumerate(problem.scene.shapes)
    ]
    plant.Finalize()
    _filter(graph.collision_filter_manager(), chain, links, obstacles)
    diagram = builder.Build()
    context = diagram.CreateDefaultContext()
    return plant, plant.GetMyMutableContextFromRoot(context), (diagram, context)


def _filter(manager: Any, chain: Chain, links: list[list[Any]], obstacles: list[Any]) -> None:
    """Of links in different frames only our pairs are looked at; links that stand in the scene may touch it."""
    paired = {(a, b) for a, b in chain.link_pairs.tolist()}
    declaration = CollisionFilterDeclaration()
    for b in range(len(links)):
        for a in range(b):
            if (a, b) not in paired:
                declaration.ExcludeBetween(GeometrySet(links[a]), GeometrySet(links[b]))
        if b < chain.scene_link and obstacles:
            declaration.ExcludeBetween(GeometrySet(links[b]), GeometrySet(obstacles))
    manager.Apply(declaration)


def _geometry(shape: Shape) -> tuple[Any, Any]:
    """Pose and shape in Drake's terms; raises PredplanError for meshes, which no published problem has."""
    match shape:
        case Box():
            sizes = 2.0 * np.asarray(shape.half, dtype=np.float64)
            return RigidTransform(RotationMatrix(np.asarray(shape.rotation)), shape.centre), DrakeBox(*sizes)
        case Sphere():
            return RigidTransform(np.asarray(shape.centre, dtype=np.float64)), DrakeSphere(shape.radius)
        case Capsule():
            a, b = np.asarray(shape.a, dtype=np.float64), np.asarray(shape.b, dtype=np.float64)
            pose = RigidTransform(RotationMatrix(along(b - a)), (a + b) / 2)
            return pose, DrakeCapsule(shape.radius, float(np.linalg.norm(b - a)))
        case Cylinder():
            pose = RigidTransform(RotationMatrix(np.asarray(shape.rotation)), shape.centre)
            return pose, DrakeCylinder(shape.radius, 2.0 * shape.half)
    raise PredplanError(f"{shape.name}: meshes are not handed to Drake")
