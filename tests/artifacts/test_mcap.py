import json
import subprocess
import sys
from collections.abc import Callable
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from mcap.reader import make_reader
from mcap.writer import Writer
from mcap_protobuf.decoder import DecoderFactory

from predplan.artifacts import mcap
from predplan.artifacts.provenance import Provenance
from predplan.artifacts.recordings import (
    Curves,
    JointStates,
    LogLine,
    Mesh,
    Primitive,
    Solid,
    Steps,
    Transforms,
)
from predplan.errors import InputError

PROVENANCE = Provenance({"method": "kernel", "width": 0.3}, seed=7, upstream={"problems": "00" * 32})
RED, TURNED = (1.0, 0.0, 0.0, 0.5), np.array([0.0, 0.0, np.sqrt(0.5), np.sqrt(0.5)])
SOLIDS: tuple[Solid, ...] = (
    Primitive("box", "cube", np.array([1.0, 2.0, 3.0]), TURNED, np.array([0.1, 0.2, 0.3]), RED),
    Primitive("ball", "sphere", np.zeros(3), np.array([0.0, 0.0, 0.0, 1.0]), np.full(3, 0.4), RED, "elbow"),
    Primitive("can", "cylinder", np.ones(3), TURNED, np.array([0.1, 0.1, 0.5]), RED),
    Mesh("wedge", np.eye(3), np.array([[0, 1, 2]]), RED, "elbow"),
)


def make_states(n: int = 50, joints: int = 2) -> JointStates:
    generator = np.random.default_rng(0)
    q, v, a = generator.normal(size=(3, n, joints))
    return JointStates(np.arange(n) / 100, tuple(f"joint{j}" for j in range(joints)), q, v, a)


def make_transforms(n: int = 50) -> Transforms:
    generator = np.random.default_rng(1)
    turn = generator.normal(size=(n, 2, 4))
    turn /= np.linalg.norm(turn, axis=-1, keepdims=True)
    return Transforms(
        np.arange(n) / 100, ("world", "world"), ("shoulder", "elbow"), generator.normal(size=(n, 2, 3)), turn
    )


def make_steps(n: int, sizes: tuple[int, int, int, int] = (3, 2, 4, 5)) -> Steps:
    generator = np.random.default_rng(2)
    observation, action, state, prediction = (generator.normal(size=(n, size)) for size in sizes)
    last = np.arange(n) % 10 == 9
    return Steps(
        np.arange(n) / 20,
        np.arange(n) // 10,
        observation,
        action,
        generator.normal(size=n),
        last,
        ~last,
        state,
        prediction,
    )


def write_all(path: Path, provenance: Provenance = PROVENANCE) -> Path:
    mcap.write_recording(
        path,
        provenance,
        joint_states={mcap.JOINT_STATES: make_states()},
        transforms=make_transforms(),
        curves={"/clearance": Curves(np.arange(3.0), ("scene_m", "self_m"), np.arange(6.0).reshape(3, 2))},
        steps=make_steps(30),
        scene=SOLIDS,
        log=[LogLine(0.0, "began", "planner"), LogLine(0.4, "ended", "planner", "warning")],
        attachments={"plan.json": b"{}"},
    )
    return path


def assert_equal(found: Any, expected: Any) -> None:
    for field in fields(expected):
        a, b = getattr(found, field.name), getattr(expected, field.name)
        if isinstance(b, np.ndarray):
            assert a.dtype == b.dtype
            np.testing.assert_array_equal(a, b)
        else:
            assert a == b


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return write_all(tmp_path / "a.mcap")


def test_everything_comes_back(path: Path) -> None:
    assert_equal(mcap.read_joint_states(path), make_states())
    assert_equal(mcap.read_transforms(path), make_transforms())
    assert_equal(mcap.read_steps(path), make_steps(30))
    curves = mcap.read_curves(path, "/clearance")
    assert curves.names == ("scene_m", "self_m")
    np.testing.assert_array_equal(curves.values, np.arange(6.0).reshape(3, 2))
    for found, expected in zip(mcap.read_solids(path), SOLIDS, strict=True):
        assert_equal(found, expected)
    assert [line.message for line in mcap.read_log(path)] == ["began", "ended"]
    assert mcap.read_log(path)[1] == LogLine(0.4, "ended", "planner", "warning")
    assert mcap.read_provenance(path) == PROVENANCE
    assert mcap.read_attachments(path)["plan.json"] == b"{}"
    assert json.loads(mcap.read_attachments(path)["params.json"]) == PROVENANCE.params
    assert mcap.read_topics(path) == {
        "/clearance": "predplan.Values",
        "/joint_states": "foxglove.JointStates",
        "/log": "foxglove.Log",
        "/scene": "foxglove.SceneUpdate",
        "/steps": "predplan.Step",
        "/tf": "foxglove.FrameTransforms",
    }


def test_another_reader_decodes_it_from_the_file_alone(path: Path) -> None:
    states, steps = make_states(), make_steps(30)
    with path.open("rb") as file:
        reader = make_reader(file, validate_crcs=True, decoder_factories=[DecoderFactory()])
        found: dict[str, list[Any]] = {}
        for _, channel, message, decoded in reader.iter_decoded_messages():
            found.setdefault(channel.topic, []).append((message.log_time, message.sequence, decoded))
        summary = reader.get_summary()
    assert summary is not None
    assert summary.statistics is not None
    assert summary.statistics.message_count == sum(map(len, found.values()))
    assert summary.chunk_indexes
    for row, (time, sequence, message) in enumerate(found["/joint_states"]):
        assert (time, sequence) == (row * 10_000_000, row)
        assert message.timestamp.seconds * 10**9 + message.timestamp.nanos == time
        assert [joint.name for joint in message.joints] == list(states.names)
        assert [joint.velocity for joint in message.joints] == states.velocity[row].tolist()  # type: ignore[index]
    for row, (_, _, message) in enumerate(found["/steps"]):
        assert list(message.observation) == steps.observation[row].tolist()
        assert message.reward == steps.reward[row]
        assert (message.episode, message.terminated) == (steps.episode[row], steps.terminated[row])
        assert list(message.prediction) == steps.prediction[row].tolist()
    box = found["/scene"][0][2].entities[0]
    assert (box.id, box.frame_id, box.cubes[0].size.y, box.cubes[0].pose.position.z) == ("box", "world", 0.2, 3.0)
    transform = found["/tf"][3][2].transforms[1]
    assert (transform.parent_frame_id, transform.child_frame_id) == ("world", "elbow")


def test_the_viewer_finds_no_fault(path: Path) -> None:
    done = subprocess.run(
        [sys.executable, "-m", "rerun", "mcap", "check", "--full", str(path)],
        capture_output=True,
        text=True,
        check=True,
    )
    statuses = [line.split()[0] for line in done.stdout.split("──\n")[-1].splitlines() if line.strip()]
    assert statuses == ["ok"] * 6


def test_the_same_content_has_the_same_bytes(tmp_path: Path) -> None:
    assert write_all(tmp_path / "a.mcap").read_bytes() == write_all(tmp_path / "b.mcap").read_bytes()
    shuffled = replace(PROVENANCE, params=dict(reversed(list(PROVENANCE.params.items()))))
    assert write_all(tmp_path / "c.mcap", shuffled).read_bytes() == (tmp_path / "a.mcap").read_bytes()


@settings(max_examples=30, deadline=None)
@given(
    n=st.integers(1, 5),
    sizes=st.tuples(*[st.sampled_from([0, 1, 2, 15, 16, 40])] * 4),
    numbers=st.lists(st.floats(), min_size=5, max_size=5),
    episode=st.integers(0, 2**32 - 1),
)
def test_any_steps_come_back(
    tmp_path_factory: pytest.TempPathFactory,
    n: int,
    sizes: tuple[int, int, int, int],
    numbers: list[float],
    episode: int,
) -> None:
    path = tmp_path_factory.mktemp("steps") / "a.mcap"
    steps = replace(make_steps(n, sizes), reward=np.array(numbers[:n]), episode=np.full(n, episode))
    mcap.write_recording(path, PROVENANCE, steps=steps)
    assert_equal(mcap.read_steps(path), steps)


def test_long_recordings_have_many_chunks(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    mcap.write_recording(path, PROVENANCE, steps=make_steps(20_000))
    with path.open("rb") as file:
        summary = make_reader(file).get_summary()
    assert summary is not None
    sizes = [chunk.uncompressed_size for chunk in summary.chunk_indexes]
    assert len(sizes) > 5
    assert max(sizes) < 2 * mcap.CHUNK_BYTES


def test_joint_states_without_velocities_have_none(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    states = replace(make_states(), velocity=None, acceleration=None)
    mcap.write_recording(path, PROVENANCE, joint_states={"/kernel/joint_states": states})
    assert mcap.read_joint_states(path, "/kernel/joint_states").velocity is None


def test_a_mesh_is_read_where_its_pose_puts_it(tmp_path: Path) -> None:
    from foxglove_schemas_protobuf.SceneUpdate_pb2 import SceneUpdate

    from predplan.artifacts.scene_messages import SCENE

    message = SceneUpdate()
    surface = message.entities.add().triangles.add(indices=[0, 0, 0], points=[{"x": 1.0}])
    surface.pose.position.z = 2.0
    surface.pose.orientation.z, surface.pose.orientation.w = TURNED[2:]
    (mesh,) = SCENE.decode(np.zeros(1), [message.SerializeToString()])
    assert isinstance(mesh, Mesh)
    np.testing.assert_allclose(mesh.vertices, [[0.0, 1.0, 2.0]], atol=1e-15)


@pytest.mark.parametrize("times", [[0.0, -1.0], [1.0, 0.5], [-0.1, 0.0], [0.0, np.nan]])
def test_a_clock_that_runs_back_is_refused(tmp_path: Path, times: list[float]) -> None:
    curves = Curves(np.array(times), ("x",), np.zeros((2, 1)))
    with pytest.raises(ValueError, match="never run back"):
        mcap.write_recording(tmp_path / "a.mcap", PROVENANCE, curves={"/x": curves})
    assert not list(tmp_path.iterdir())


def test_arrays_of_unequal_length_are_refused() -> None:
    with pytest.raises(ValueError, match=r"JointStates.position has shape \(2, 1\); expected \(2, 3\)"):
        JointStates(np.arange(2.0), ("a", "b", "c"), np.zeros((2, 1)))
    with pytest.raises(ValueError, match=r"Steps.reward has shape \(4,\); expected \(3\)"):
        replace(make_steps(3), reward=np.zeros(4))


def test_nothing_is_not_written(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="nothing to write on /steps"):
        mcap.write_recording(tmp_path / "a.mcap", PROVENANCE, steps=make_steps(0))
    assert not list(tmp_path.iterdir())


READERS: list[Callable[..., Any]] = [
    mcap.read_joint_states,
    mcap.read_transforms,
    mcap.read_steps,
    mcap.read_solids,
    mcap.read_log,
    mcap.read_topics,
    mcap.read_attachments,
    mcap.read_provenance,
]


@pytest.mark.parametrize("read", READERS)
def test_a_missing_file_is_said_with_what_makes_it(tmp_path: Path, read: Callable[..., Any]) -> None:
    with pytest.raises(InputError, match=r"a\.mcap: no such file; make it: dvc repro plan"):
        read(tmp_path / "a.mcap", maker="dvc repro plan")


@pytest.mark.parametrize("share", [0.0, 0.001, 0.5, 0.9, 0.999])
@pytest.mark.parametrize("read", READERS)
def test_a_file_cut_short_is_said(path: Path, read: Callable[..., Any], share: float) -> None:
    data = path.read_bytes()
    path.write_bytes(data[: int(share * len(data))])
    with pytest.raises(InputError, match=r"a\.mcap: not a whole MCAP file \(.+\); make it again: dvc repro plan$"):
        read(path, maker="dvc repro plan")


def test_damage_is_said_or_does_no_harm(path: Path) -> None:
    data, generator = path.read_bytes(), np.random.default_rng(0)
    refused = 0
    for place in generator.integers(len(data), size=300):
        damaged = bytearray(data)
        damaged[place] ^= 1 << int(generator.integers(8))
        path.write_bytes(damaged)
        for read in (mcap.read_joint_states, mcap.read_steps):
            try:
                found = read(path)
            except InputError:
                refused += 1
            else:
                assert_equal(found, make_states() if read is mcap.read_joint_states else make_steps(30))
    assert refused > 100


def test_what_is_no_recording_of_ours_is_said(tmp_path: Path, path: Path) -> None:
    with pytest.raises(InputError, match=r"no topic /other among /clearance, /joint_states, .*make it again: dvc"):
        mcap.read_joint_states(path, "/other", "dvc repro plan")
    with pytest.raises(InputError, match=r"/tf carries foxglove\.FrameTransforms, expected foxglove\.JointStates"):
        mcap.read_joint_states(path, "/tf")
    foreign = tmp_path / "foreign.mcap"
    with foreign.open("wb") as file:
        writer = Writer(file)
        writer.start()
        channel = writer.register_channel("/a", "json", writer.register_schema("A", "jsonschema", b"{}"))
        writer.add_message(channel, 0, b"{}", 0)
        writer.finish()  # type: ignore[no-untyped-call]
    with pytest.raises(InputError, match=r"/a carries A, expected predplan\.Step"):
        mcap.read_steps(foreign, "/a")
    with pytest.raises(InputError, match="carries no provenance"):
        mcap.read_provenance(foreign)
    (tmp_path / "text.mcap").write_text("no recording at all")
    with pytest.raises(InputError, match="not a whole MCAP file"):
        mcap.read_steps(tmp_path / "text.mcap")
