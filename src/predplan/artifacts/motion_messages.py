"""Joint states, poses and log lines in Foxglove's published schemas, and curves in one of our own."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from typing import TypeVar

import numpy as np
from foxglove_schemas_protobuf.FrameTransforms_pb2 import FrameTransforms
from foxglove_schemas_protobuf.JointStates_pb2 import JointStates as JointStatesMessage
from foxglove_schemas_protobuf.Log_pb2 import Log

from predplan.artifacts.messages import FIELD, Kind, column, named, numbers, own_message
from predplan.artifacts.recordings import (
    Curves,
    FloatArray,
    JointStates,
    Level,
    LogLine,
    Transforms,
    to_nanoseconds,
)

_T = TypeVar("_T")
_LEVELS: tuple[Level, ...] = ("unknown", "debug", "info", "warning", "error", "fatal")


def _encode_joint_states(states: JointStates) -> Iterator[bytes]:
    """foxglove.JointStates, one a time."""
    kinds = [
        (name, values.tolist())
        for name, values in (
            ("position", states.position),
            ("velocity", states.velocity),
            ("acceleration", states.acceleration),
        )
        if values is not None
    ]
    for i, stamp in enumerate(_stamps(states.times)):
        message = JointStatesMessage(timestamp=stamp)
        for j, name in enumerate(states.names):
            message.joints.add(name=name, **{kind: values[i][j] for kind, values in kinds})
        yield message.SerializeToString()


def _decode_joint_states(times: FloatArray, messages: Sequence[bytes]) -> JointStates:
    """Raises ValueError where the joints are not the same throughout."""
    parsed = [JointStatesMessage.FromString(message).joints for message in messages]
    names = _same(tuple(joint.name for joint in joints) for joints in parsed)

    def values(kind: str) -> FloatArray | None:
        if not all(joint.HasField(kind) for joint in parsed[0]):
            return None
        return column([[getattr(joint, kind) for joint in joints] for joints in parsed])

    position = values("position")
    if position is None:
        raise ValueError("the joints have no positions")
    return JointStates(times, names, position, values("velocity"), values("acceleration"))


def _encode_transforms(transforms: Transforms) -> Iterator[bytes]:
    """foxglove.FrameTransforms, one a time."""
    frames = list(zip(transforms.parents, transforms.children, strict=True))
    rows = zip(transforms.translation.tolist(), transforms.quaternion.tolist(), strict=True)
    for stamp, (translation, rotation) in zip(_stamps(transforms.times), rows, strict=True):
        message = FrameTransforms()
        for (parent, child), at, turn in zip(frames, translation, rotation, strict=True):
            message.transforms.add(
                timestamp=stamp,
                parent_frame_id=parent,
                child_frame_id=child,
                translation=named("xyz", at),
                rotation=named("xyzw", turn),
            )
        yield message.SerializeToString()


def _decode_transforms(times: FloatArray, messages: Sequence[bytes]) -> Transforms:
    """Raises ValueError where the frames are not the same throughout."""
    parsed = [FrameTransforms.FromString(message).transforms for message in messages]
    pairs = _same(tuple((one.parent_frame_id, one.child_frame_id) for one in row) for row in parsed)
    table = np.array(
        [[numbers(one.translation, "xyz") + numbers(one.rotation, "xyzw") for one in row] for row in parsed]
    )
    return Transforms(
        times,
        tuple(parent for parent, _ in pairs),
        tuple(child for _, child in pairs),
        np.ascontiguousarray(table[..., :3]),
        np.ascontiguousarray(table[..., 3:]),
    )


def _encode_curves(curves: Curves) -> Iterator[bytes]:
    """predplan.Values, one a time."""
    for row in curves.values.tolist():
        yield _VALUES(names=curves.names, values=row).SerializeToString()


def _decode_curves(times: FloatArray, messages: Sequence[bytes]) -> Curves:
    """Raises ValueError where the names are not the same throughout."""
    parsed = [_VALUES.FromString(message) for message in messages]
    names = _same(tuple(one.names) for one in parsed)
    return Curves(times, names, column([one.values for one in parsed]))


def _encode_log(lines: Sequence[LogLine]) -> Iterator[bytes]:
    """foxglove.Log, one a line."""
    for stamp, line in zip(_stamps(np.array([line.time for line in lines])), lines, strict=True):
        message = Log(timestamp=stamp, message=line.message, name=line.name)
        message.level = Log.Level.Value(line.level.upper())
        yield message.SerializeToString()


def _decode_log(times: FloatArray, messages: Sequence[bytes]) -> Sequence[LogLine]:
    parsed = [Log.FromString(message) for message in messages]
    return tuple(
        LogLine(time, one.message, one.name, _LEVELS[one.level])
        for time, one in zip(times.tolist(), parsed, strict=True)
    )


def _stamps(times: FloatArray) -> Iterator[dict[str, int]]:
    for nanoseconds in to_nanoseconds(times).tolist():
        yield {"seconds": nanoseconds // 10**9, "nanos": nanoseconds % 10**9}


def _same(rows: Iterable[_T]) -> _T:
    first, *others = rows
    if any(row != first for row in others):
        raise ValueError("the names are not the same in all messages")
    return first


_VALUES = own_message("Values", ("names", FIELD.TYPE_STRING, True), ("values", FIELD.TYPE_DOUBLE, True))

JOINT_STATES = Kind(JointStatesMessage, _encode_joint_states, _decode_joint_states)
TRANSFORMS = Kind(FrameTransforms, _encode_transforms, _decode_transforms)
LOG = Kind(Log, _encode_log, _decode_log)
CURVES = Kind(_VALUES, _encode_curves, _decode_curves)
