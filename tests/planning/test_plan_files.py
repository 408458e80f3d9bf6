import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from mcap.reader import make_reader
from mcap_protobuf.decoder import DecoderFactory

from predplan.artifacts import mcap
from predplan.artifacts.provenance import Provenance
from predplan.artifacts.recordings import Curves, JointStates
from predplan.errors import InputError
from predplan.planning.certificates import certify
from predplan.planning.collisions import nearest_names
from predplan.planning.paths import polyline, quintic
from predplan.planning.plan_files import CEILING, FACTS, clearance_of, read_plan, write_motion, write_plan
from predplan.planning.plans import Attempt, Plan
from predplan.planning.robots import planar_arm
from predplan.planning.scenes import Box, Scene, Sphere, make_scene
from predplan.planning.timing import trajectory

ROBOT = planar_arm([0.5, 0.4])
PROVENANCE = Provenance({"method": "kernel"}, seed=1)


@pytest.fixture
def scene() -> Scene:
    return make_scene([Sphere([0.9, 0.5, 0.0], 0.1, "ball"), Box([0.0, 5.0, 0.0], [1.0, 1.0, 1.0], name="far")])


def make_plan(scene: Scene) -> Plan:
    knots = np.array([[0.0, 0.0], [0.5, 1.0], [1.5, 0.5]])
    path = quintic(np.array([0.0, 0.5, 1.0]), knots, np.full((3, 2), 1.0), np.zeros((3, 2)))
    tried = (Attempt("line", "the proof failed", 3, 0.1), Attempt("prior", "certified", 5, 0.2))
    return Plan(
        robot=ROBOT,
        scene=scene,
        success=True,
        reason="",
        method="cascade",
        time_s=0.2,
        attempts=tried,
        certificate=None,
        path=path,
    )


def test_a_plan_comes_back(tmp_path: Path, scene: Scene) -> None:
    plan = make_plan(scene)
    write_plan(tmp_path / "a.mcap", plan, PROVENANCE)
    found = read_plan(tmp_path / "a.mcap")
    times = found.states.times
    assert times[-1] == pytest.approx(plan.duration_s, abs=1e-9)
    assert np.diff(times).max() <= 0.01 + 1e-9
    assert found.states.names == ROBOT.joints
    np.testing.assert_allclose(found.states.position, plan.trajectory(times), atol=1e-7)
    assert found.states.velocity is not None
    np.testing.assert_allclose(found.states.velocity, plan.trajectory(times, 1), atol=1e-5)
    assert found.facts["method"] == "cascade"
    assert found.facts["attempts"] == [
        {"start": "line", "outcome": "the proof failed"},
        {"start": "prior", "outcome": "certified"},
    ]
    assert plan.path is not None
    np.testing.assert_array_equal(found.facts["path"]["coefficients"], plan.path.coefficients)
    assert found.facts["limits"]["upper"] == ROBOT.chain.upper.tolist()
    assert {solid.name for solid in found.solids} >= {"scene/ball", "scene/far"}


def test_path_and_timing_come_back_to_the_last_bit(tmp_path: Path, scene: Scene) -> None:
    plan = make_plan(scene)
    write_plan(tmp_path / "a.mcap", plan, PROVENANCE)
    found = read_plan(tmp_path / "a.mcap")
    assert plan.path is not None
    assert found.path is not None
    assert found.timing is not None
    np.testing.assert_array_equal(found.path.breaks, plan.path.breaks)
    np.testing.assert_array_equal(found.path.coefficients, plan.path.coefficients)
    t = np.random.default_rng(0).uniform(0, plan.duration_s, 100)
    np.testing.assert_array_equal(trajectory(found.path, found.timing, t), plan.trajectory(t))
    assert certify(ROBOT, scene, found.path).configurations == certify(ROBOT, scene, plan.path).configurations


@pytest.mark.parametrize("rate", [10.0, 100.0, 333.0])
def test_samples_stand_at_the_rate_and_at_the_end(tmp_path: Path, scene: Scene, rate: float) -> None:
    plan = make_plan(scene)
    write_plan(tmp_path / "a.mcap", plan, PROVENANCE, rate)
    times = read_plan(tmp_path / "a.mcap").states.times
    np.testing.assert_allclose(times[:-1], np.arange(len(times) - 1) / rate, atol=1e-9)
    assert times[-1] == pytest.approx(plan.duration_s, abs=1e-9)
    assert 0.0 < times[-1] - times[-2] <= 1 / rate + 1e-9


def test_a_motion_that_stands_still_is_one_sample(tmp_path: Path, scene: Scene) -> None:
    plan = make_plan(scene)
    still = replace(plan, path=polyline(np.zeros((1, 2))))
    write_plan(tmp_path / "a.mcap", still, PROVENANCE)
    np.testing.assert_array_equal(read_plan(tmp_path / "a.mcap").states.position, [[0.0, 0.0]])


def test_another_reader_finds_joints_frames_scene_and_path(tmp_path: Path, scene: Scene) -> None:
    """MCAP's own reader and the schemas in the file are all that is needed."""
    plan = make_plan(scene)
    write_plan(tmp_path / "a.mcap", plan, PROVENANCE)
    with (tmp_path / "a.mcap").open("rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()], validate_crcs=True)
        decoded = [
            (schema.name if schema else "", channel.topic, message.log_time, content)
            for schema, channel, message, content in reader.iter_decoded_messages()
        ]
        attachments = {one.name: one for one in reader.iter_attachments()}
        metadata = {one.name: one.metadata for one in reader.iter_metadata()}
    joints = [one for one in decoded if one[1] == "/joint_states"]
    assert joints[0][0] == "foxglove.JointStates"
    at = np.array([time for _, _, time, _ in joints]) / 1e9
    positions = [[joint.position for joint in content.joints] for _, _, _, content in joints]
    np.testing.assert_allclose(positions, plan.trajectory(at), atol=1e-7)
    assert [joint.name for joint in joints[0][3].joints] == list(ROBOT.joints)
    frames = [one for one in decoded if one[1] == "/tf"]
    assert len(frames) == len(joints)
    assert {frame.child_frame_id for frame in frames[0][3].transforms} == {*ROBOT.joints, "tool"}
    assert any(name == "foxglove.SceneUpdate" for name, *_ in decoded)
    kept = json.loads(attachments[FACTS].data)
    assert plan.path is not None
    np.testing.assert_array_equal(kept["path"]["coefficients"], plan.path.coefficients)
    assert (attachments[FACTS].log_time, attachments[FACTS].create_time) == (0, 0)
    assert metadata["provenance"]["seed"] == "1"


def test_the_same_plan_has_the_same_bytes_however_long_it_took(tmp_path: Path, scene: Scene) -> None:
    plan = make_plan(scene)
    write_plan(tmp_path / "a.mcap", plan, PROVENANCE)
    slower = Plan(**{name: getattr(plan, name) for name in plan.__dataclass_fields__} | {"time_s": 5.0})
    write_plan(tmp_path / "b.mcap", slower, PROVENANCE)
    assert (tmp_path / "a.mcap").read_bytes() == (tmp_path / "b.mcap").read_bytes()


def test_no_trajectory_is_not_written(tmp_path: Path, scene: Scene) -> None:
    plan = make_plan(scene)
    failed = Plan(
        **{name: getattr(plan, name) for name in plan.__dataclass_fields__} | {"path": None, "reason": "no time"}
    )
    with pytest.raises(ValueError, match="no time"):
        write_plan(tmp_path / "a.mcap", failed, PROVENANCE)
    assert not list(tmp_path.iterdir())


def test_clearances_are_signed_and_agree_with_what_touches(scene: Scene) -> None:
    q = polyline(np.array([[-1.0, 0.0], [1.0, 0.0]]))(np.linspace(0, 1, 41))
    clearance = clearance_of(ROBOT, scene, np.arange(41.0), q)
    assert clearance.names == ("scene_m", "self_m")
    deepest = [max((depth for _, _, depth in nearest_names(ROBOT, scene, row)), default=None) for row in q]
    for value, depth in zip(clearance.values.min(axis=1), deepest, strict=True):
        if depth is None:
            assert value >= 0.0
        else:
            assert value == pytest.approx(-depth)
    assert min(clearance.values[:, 0]) < 0.0 < max(clearance.values[:, 0]) <= CEILING


def test_any_motion_is_written_with_what_is_known_of_it(tmp_path: Path, scene: Scene) -> None:
    states = JointStates(np.arange(3.0), ROBOT.joints, np.zeros((3, 2)))
    write_motion(tmp_path / "a.mcap", ROBOT, scene, states, PROVENANCE, {"method": "chomp"})
    found = read_plan(tmp_path / "a.mcap")
    assert (found.facts["method"], found.facts["robot"], found.states.velocity) == ("chomp", ROBOT.name, None)
    assert mcap.read_provenance(tmp_path / "a.mcap") == PROVENANCE


def test_other_recordings_are_refused(tmp_path: Path) -> None:
    curves = {"/x": Curves(np.zeros(1), ("x",), np.zeros((1, 1)))}
    mcap.write_recording(tmp_path / "a.mcap", PROVENANCE, curves=curves, attachments={"b.json": json.dumps(1).encode()})
    with pytest.raises(InputError, match=rf"no {FACTS} among the attachments \(params\.json, b\.json\).*predplan plan"):
        read_plan(tmp_path / "a.mcap", "predplan plan")
