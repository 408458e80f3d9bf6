"""Recordings in MCAP files, which Foxglove and Rerun open: written whole, indexed, with checksums.

Topics carry Foxglove's schemas where there is one: /joint_states, /tf, /scene (once, at 0) and /log; /steps carries
predplan.Step, and curves predplan.Values. Provenance is metadata, its params an attachment. The same content gives the
same bytes.
"""

from __future__ import annotations

import heapq
import json
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import IO, Any, NamedTuple, TypeVar

import numpy as np
from mcap.reader import McapReader, make_reader
from mcap.writer import CompressionType, Writer

from predplan.artifacts import motion_messages, scene_messages, step_messages
from predplan.artifacts.files import write_whole
from predplan.artifacts.messages import Kind
from predplan.artifacts.provenance import Provenance
from predplan.artifacts.recordings import (
    Curves,
    FloatArray,
    IntArray,
    JointStates,
    LogLine,
    Solid,
    Steps,
    Transforms,
    to_nanoseconds,
    to_seconds,
)
from predplan.errors import InputError

JOINT_STATES, TRANSFORMS, SCENE, LOG, STEPS = "/joint_states", "/tf", "/scene", "/log", "/steps"
CHUNK_BYTES = 1 << 18
"""A file that was cut short gives back whole chunks at best."""
UNKNOWN_MAKER = "the stage or command that wrote it"

_PARAMS = "params.json"
_PROVENANCE = "provenance"
_MEDIA_TYPES = {".json": "application/json", ".parquet": "application/vnd.apache.parquet", ".yaml": "application/yaml"}
_T = TypeVar("_T")


def write_recording(
    path: Path,
    provenance: Provenance,
    *,
    joint_states: Mapping[str, JointStates] | None = None,
    transforms: Transforms | None = None,
    curves: Mapping[str, Curves] | None = None,
    steps: Steps | None = None,
    scene: Sequence[Solid] = (),
    log: Sequence[LogLine] = (),
    attachments: Mapping[str, bytes] | None = None,
) -> None:
    """Write a recording, whole. joint_states, as in {JOINT_STATES: ...}, and curves are by topic, attachments by name.

    A message's sequence number is its row, its time the simulation's clock in ns. Raises ValueError where arrays differ
    in length, times are not as `recordings` says, or a topic would be empty.
    """
    topics: list[_Topic] = []
    if scene:
        topics.append(_topic(SCENE, scene_messages.SCENE, np.zeros(1), scene))
    if transforms is not None:
        topics.append(_topic(TRANSFORMS, motion_messages.TRANSFORMS, transforms.times, transforms))
    for name, states in (joint_states or {}).items():
        topics.append(_topic(name, motion_messages.JOINT_STATES, states.times, states))
    for name, values in (curves or {}).items():
        topics.append(_topic(name, motion_messages.CURVES, values.times, values))
    if steps is not None:
        topics.append(_topic(STEPS, step_messages.STEPS, steps.times, steps))
    if log:
        topics.append(_topic(LOG, motion_messages.LOG, np.array([line.time for line in log]), log))
    with write_whole(path) as temporary, temporary.open("wb") as file:
        _write(file, provenance, topics, attachments or {})


def read_joint_states(path: Path, topic: str = JOINT_STATES, maker: str = UNKNOWN_MAKER) -> JointStates:
    """The joint states on a topic. Raises InputError, which names `maker` as what to run again, as all readers here do:

    if the file is missing, cut short, damaged or no MCAP, has no such topic, or has another kind of message on it.
    """
    return _read(path, topic, motion_messages.JOINT_STATES, maker)


def read_transforms(path: Path, topic: str = TRANSFORMS, maker: str = UNKNOWN_MAKER) -> Transforms:
    """The poses of frames on a topic. Raises InputError."""
    return _read(path, topic, motion_messages.TRANSFORMS, maker)


def read_curves(path: Path, topic: str, maker: str = UNKNOWN_MAKER) -> Curves:
    """The named numbers on a topic. Raises InputError."""
    return _read(path, topic, motion_messages.CURVES, maker)


def read_steps(path: Path, topic: str = STEPS, maker: str = UNKNOWN_MAKER) -> Steps:
    """The rollouts on a topic. Raises InputError."""
    return _read(path, topic, step_messages.STEPS, maker)


def read_solids(path: Path, topic: str = SCENE, maker: str = UNKNOWN_MAKER) -> Sequence[Solid]:
    """What stands in the scene and what moves in it, from the first message on a topic. Raises InputError."""
    return _read(path, topic, scene_messages.SCENE, maker)


def read_log(path: Path, topic: str = LOG, maker: str = UNKNOWN_MAKER) -> Sequence[LogLine]:
    """What was said. Raises InputError."""
    return _read(path, topic, motion_messages.LOG, maker)


def read_topics(path: Path, maker: str = UNKNOWN_MAKER) -> dict[str, str]:
    """The names of the topics, sorted, and of the messages on each. Raises InputError."""
    with _open(path, maker) as reader:
        return _topics(reader)


def read_attachments(path: Path, maker: str = UNKNOWN_MAKER) -> dict[str, bytes]:
    """Attached files by name, the provenance's params among them. Raises InputError."""
    with _open(path, maker) as reader:
        return {attachment.name: attachment.data for attachment in reader.iter_attachments()}


def read_provenance(path: Path, maker: str = UNKNOWN_MAKER) -> Provenance:
    """Where a recording came from. Raises InputError, also if it is not predplan's."""
    with _open(path, maker) as reader:
        found = {record.name: record.metadata for record in reader.iter_metadata()}.get(_PROVENANCE)
        params = next((one.data for one in reader.iter_attachments() if one.name == _PARAMS), None)
        if found is None or params is None:
            raise InputError(f"{path}: carries no provenance; expected a recording written by predplan")
        return Provenance(
            json.loads(params), json.loads(found["seed"]), found["version"], json.loads(found["upstream"])
        )


class _Topic(NamedTuple):
    name: str
    kind: Kind[Any]
    times: IntArray  # [n] ns
    encoded: Iterable[bytes]


def _topic(name: str, kind: Kind[_T], times: FloatArray, content: _T) -> _Topic:
    if not len(times):
        raise ValueError(f"nothing to write on {name}")
    return _Topic(name, kind, to_nanoseconds(times), kind.encode(content))


def _write(file: IO[bytes], provenance: Provenance, topics: Sequence[_Topic], attachments: Mapping[str, bytes]) -> None:
    writer = Writer(file, CHUNK_BYTES, CompressionType.ZSTD, enable_crcs=True, enable_data_crcs=True)
    writer.start(profile="", library="predplan")
    schemas: dict[str, int] = {}
    rows = []
    for order, topic in enumerate(topics):
        name = topic.kind.name
        if name not in schemas:
            schemas[name] = writer.register_schema(name, "protobuf", topic.kind.schema)
        channel = writer.register_channel(topic.name, "protobuf", schemas[name])
        rows.append(_rows(order, channel, topic))
    for time, _, row, channel, data in rows[0] if len(rows) == 1 else heapq.merge(*rows):
        writer.add_message(channel, time, data, time, row)
    params = json.dumps(dict(provenance.params), sort_keys=True, ensure_ascii=False, allow_nan=False, indent=2)
    for name, data in {_PARAMS: params.encode() + b"\n", **attachments}.items():
        writer.add_attachment(0, 0, name, _MEDIA_TYPES.get(Path(name).suffix, "application/octet-stream"), data)
    writer.add_metadata(
        _PROVENANCE,
        {
            "version": provenance.version,
            "seed": json.dumps(provenance.seed),
            "upstream": json.dumps(dict(provenance.upstream), sort_keys=True),
        },
    )
    writer.finish()  # type: ignore[no-untyped-call]


def _rows(order: int, channel: int, topic: _Topic) -> Iterator[tuple[int, int, int, int, bytes]]:
    for row, (time, data) in enumerate(zip(topic.times.tolist(), topic.encoded, strict=True)):
        yield time, order, row, channel, data


def _read(path: Path, topic: str, kind: Kind[_T], maker: str) -> _T:
    with _open(path, maker) as reader:
        topics = _topics(reader)
        if topic not in topics:
            listed = ", ".join(topics) or "none"
            raise InputError(f"{path}: no topic {topic} among {listed}; make it again: {maker}")
        if topics[topic] != kind.name:
            raise InputError(f"{path}: {topic} carries {topics[topic]}, expected {kind.name}; make it again: {maker}")
        found = [one for _, _, one in reader.iter_messages(topic)]
        times = to_seconds(np.array([one.log_time for one in found], np.int64))
        return kind.decode(times, [one.data for one in found])


def _topics(reader: McapReader) -> dict[str, str]:
    summary = reader.get_summary()
    if summary is None or summary.statistics is None:
        raise ValueError("it has no index")
    counted = summary.statistics.channel_message_counts
    carried = {
        channel.topic: summary.schemas[channel.schema_id].name
        for number, channel in summary.channels.items()
        if counted.get(number)
    }
    return dict(sorted(carried.items()))


@contextmanager
def _open(path: Path, maker: str) -> Iterator[McapReader]:
    """A reader. What goes wrong with it while the block lasts is the file's fault, and said so."""
    try:
        with path.open("rb") as file:
            yield make_reader(file, validate_crcs=True)
    except FileNotFoundError as error:
        raise InputError(f"{path}: no such file; make it: {maker}") from error
    except InputError:
        raise
    except Exception as error:  # the reader's library checks little: a damaged file raises anything
        reason = " ".join(str(error).split()) or type(error).__name__
        raise InputError(f"{path}: not a whole MCAP file ({reason}); make it again: {maker}") from error
