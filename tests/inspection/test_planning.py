from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pytest
from rerun.chunk import RrdReader

from predplan import inspection
from predplan.artifacts.provenance import Provenance
from predplan.artifacts.recordings import JointStates, Primitive
from predplan.errors import InputError
from predplan.inspection.bodies import viewpoint
from predplan.inspection.fields import CostField, Course, PlanarPlans, draw_field
from predplan.inspection.planning import Limits, Motion, Plans, draw_plans
from predplan.inspection.recording import write_recording
from predplan.planning.kinematics import tool_trace
from predplan.planning.plan_files import clearance_of, write_motion
from predplan.planning.robots import planar_arm
from predplan.planning.scenes import Box, Sphere, make_scene
from predplan.planning.visuals import frame_poses, robot_solids, scene_solids

ROBOT = planar_arm([0.5, 0.4])
SCENE = make_scene([Sphere([0.9, 0.5, 0.0], 0.1, "ball"), Box([0.3, -0.5, 0.0], [0.1, 0.1, 0.1], name="low shelf")])
TIMES = np.linspace(0.0, 2.0, 21)
PROVENANCE = Provenance({"method": "kernel"}, upstream={"problems": "ab" * 32})


def make_states(bend: float = 0.0) -> JointStates:
    q = np.stack([np.sin(TIMES), bend + 0.3 * TIMES], axis=1)
    return JointStates(TIMES, ROBOT.joints, q, np.gradient(q, TIMES, axis=0))


def make_plans(**changes: Any) -> Plans:
    motions = []
    for method, bend in (("kernel", 0.0), ("sampled", 0.4)):
        states = make_states(bend)
        trace = tool_trace(ROBOT.chain, states.position)
        motions.append(Motion(method, states, trace, clearance_of(ROBOT, SCENE, TIMES, states.position), "#112233"))
    chain = ROBOT.chain
    limits = Limits(chain.lower, chain.upper, ROBOT.velocity_limit, ROBOT.acceleration_limit)
    plans = Plans(
        "Two methods",
        "One problem.",
        (*robot_solids(ROBOT), *scene_solids(SCENE)),
        frame_poses(ROBOT, TIMES, motions[0].states.position),
        motions,
        limits,
    )
    return replace(plans, **changes)


def make_costs(methods: tuple[str, ...] = ("kernel", "sampled")) -> pa.Table:
    rows = [(method, i, 2.0**-i, 1.0 + i, 10.0) for method in methods for i in range(8)]
    names = ("method", "iteration", "obstacle_cost", "velocity_cost", "acceleration_cost")
    return pa.table({name: [row[k] for row in rows] for k, name in enumerate(names)})


def read_back(path: Path) -> dict[str, dict[str, list[Any]]]:
    """entity -> component -> the values of its rows."""
    found: dict[str, dict[str, list[Any]]] = {}
    for chunk in RrdReader(path).stream().to_chunks():
        batch = chunk.to_record_batch()
        for name in batch.schema.names:
            if ":" in name:
                found.setdefault(chunk.entity_path, {}).setdefault(name, []).extend(batch[name].to_pylist())
    return found


def test_a_plan_file_shows_itself(tmp_path: Path) -> None:
    artifact = tmp_path / "reach.mcap"
    write_motion(artifact, ROBOT, SCENE, make_states(), PROVENANCE, {"method": "kernel"})
    inspection.record(artifact, tmp_path / "out.rrd")
    found = read_back(tmp_path / "out.rrd")
    meshes = [path for path, components in found.items() if "Mesh3D:vertex_positions" in components]
    assert any(path.startswith("/world/scene/ball/") for path in meshes)
    assert any(path.startswith(f"/world/{ROBOT.joints[1]}/robot/") for path in meshes)
    moved = found[f"/world/{ROBOT.joints[1]}"]["Transform3D:translation"]
    np.testing.assert_allclose(
        moved[5][0], frame_poses(ROBOT, TIMES, make_states().position).translation[5, 1], atol=1e-6
    )
    assert len(found["/world/traces/kernel/now"]["Points3D:positions"]) == len(TIMES)
    clearance = clearance_of(ROBOT, SCENE, TIMES, make_states().position).values[:, 0]
    shown = found["/clearance/kernel/scene_m"]["Scalars:scalars"]
    np.testing.assert_allclose([row[0] for row in shown], clearance)
    share = found["/share/velocity/joints"]["Scalars:scalars"]
    velocity = make_states().velocity
    assert velocity is not None
    np.testing.assert_allclose(share, velocity / ROBOT.velocity_limit)
    assert "/share/acceleration/joints" not in found
    text = found["/about"]["TextDocument:text"][0][0]
    assert "Nothing was proved" in text
    assert "abababababab" in text
    [blueprint] = RrdReader(tmp_path / "out.rrd").blueprints()
    assert blueprint.application_id == "predplan_plan"


@pytest.mark.parametrize(
    ("proof", "said"),
    [
        ({"free": True, "margin": 0.01, "reason": ""}, "**Certified**: the whole path"),
        (
            {"free": False, "margin": 0.0, "reason": "link2 meets ball at s = 0.5"},
            "**Not certified**: link2 meets ball",
        ),
    ],
)
def test_what_was_proved_is_said(tmp_path: Path, proof: dict[str, Any], said: str) -> None:
    write_motion(tmp_path / "a.mcap", ROBOT, SCENE, make_states(), PROVENANCE, {"certificate": proof})
    inspection.record(tmp_path / "a.mcap", tmp_path / "out.rrd")
    assert said in read_back(tmp_path / "out.rrd")["/about"]["TextDocument:text"][0][0]


def test_several_methods_are_compared(tmp_path: Path) -> None:
    supports = {"kernel": [np.array([0.5]), np.array([0.5, 0.25])]}
    plans = make_plans(costs=make_costs(), supports=supports)
    write_recording(
        tmp_path / "out.rrd", "plans", "x", None, lambda recording: draw_plans(recording, plans, PROVENANCE)
    )
    found = read_back(tmp_path / "out.rrd")
    for picture in ("/costs", "/supports"):
        assert bytes(found[picture]["EncodedImage:blob"][0][0]).startswith(b"\x89PNG")
    for method in ("kernel", "sampled"):
        assert found[f"/world/traces/{method}"]["LineStrips3D:colors"] == [[0x112233FF]]
        assert f"/clearance/{method}/scene_m" in found
    assert "| sampled |" in found["/about"]["TextDocument:text"][0][0]


def test_the_view_is_from_where_the_motion_is_not_hidden() -> None:
    plans = make_plans()
    tool = plans.motions[0].tool
    free, target = viewpoint(plans.solids, plans.frames, tool)
    middle = (free + target) / 2.0
    wall = Primitive("scene/wall", "cube", middle, np.array([0, 0, 0, 1.0]), np.array([0.4, 2.0, 3.0]), (1, 1, 1, 1))
    behind, _ = viewpoint((*plans.solids, wall), plans.frames, tool)
    assert not np.allclose(free, behind)
    away = replace(wall, centre=np.array([50.0, 0.0, 0.0]))
    np.testing.assert_allclose(viewpoint((*plans.solids, away), plans.frames, tool)[0], free)


def test_paths_move_over_the_field_of_costs(tmp_path: Path) -> None:
    field = CostField(np.arange(12.0).reshape(3, 4), (0.0, 2.0), (-1.0, 1.0))
    np.testing.assert_allclose(
        field.pixels(np.array([[0.0, -1.0], [2.0, 1.0], [1.0, 0.0]])), [[0.0, 3.0], [4.0, 0.0], [2.0, 1.5]]
    )
    line = np.stack([np.linspace(0.0, 2.0, 5), np.zeros(5)], axis=1)
    points = np.stack([line, line + np.array([0.0, 0.2]), line + np.array([0.0, 0.3])])
    supports = [np.zeros(0), np.array([0.5]), np.array([0.5, 0.125])]
    courses = [Course("kernel", points, supports), Course("chomp", points[:2])]
    plans = PlanarPlans("Field", "In the plane.", field, courses, make_costs(("kernel", "chomp")), [line])
    write_recording(tmp_path / "out.rrd", "planar", "x", None, lambda recording: draw_field(recording, plans, None))
    found = read_back(tmp_path / "out.rrd")
    strips = [row for row in found["/field/paths/kernel"]["LineStrips2D:strips"] if row]
    np.testing.assert_allclose(strips[2][0], field.pixels(points[2]), atol=1e-6)
    dots = [row for row in found["/field/paths/kernel/supports"]["Points2D:positions"] if row is not None]
    assert [len(row) for row in dots] == [0, 1, 2]
    np.testing.assert_allclose(dots[2], field.pixels(np.array([[1.0, 0.3], [0.25, 0.3]])), atol=1e-6)
    assert "/field/paths/chomp/supports" not in found
    assert {"/field/cost", "/field/bodies", "/costs", "/supports"} <= found.keys()


def test_a_plan_cut_short_is_said(tmp_path: Path) -> None:
    artifact = tmp_path / "reach.mcap"
    write_motion(artifact, ROBOT, SCENE, make_states(), PROVENANCE)
    artifact.write_bytes(artifact.read_bytes()[:-100])
    with pytest.raises(InputError, match=r"reach\.mcap"):
        inspection.record(artifact, tmp_path / "out.rrd")
    assert not (tmp_path / "out.rrd").exists()


def test_the_viewer_is_given_a_plans_page(tmp_path: Path) -> None:
    from predplan.inspection.pages import viewable

    artifact = tmp_path / "reach.mcap"
    write_motion(artifact, ROBOT, SCENE, make_states(), PROVENANCE)
    with viewable(artifact) as file:
        assert file.suffix == ".rrd"
        assert "/world/traces/motion" in RrdReader(file).store().schema().entity_paths()
