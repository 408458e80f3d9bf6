"""Protobuf messages by kind of content, and what encoding and decoding them share."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any, Generic, TypeAlias, TypeVar

import numpy as np
from google.protobuf import descriptor_pb2, descriptor_pool, message_factory

from predplan.artifacts.recordings import FloatArray

MessageClass: TypeAlias = Any
"""A class of protobuf messages, which have no types of their own."""

_T = TypeVar("_T")
FIELD = descriptor_pb2.FieldDescriptorProto
"""Has the types that `own_message` takes, as FIELD.TYPE_DOUBLE."""


@dataclass(frozen=True)
class Kind(Generic[_T]):
    """A kind of content: its class of message, the messages of a content, and the content of messages.

    decode takes the messages' times [n] s too, and raises ValueError where messages do not belong together.
    """

    message: MessageClass
    encode: Callable[[_T], Iterable[bytes]]
    decode: Callable[[FloatArray, Sequence[bytes]], _T]

    @property
    def name(self) -> str:
        """The message's full name."""
        return str(self.message.DESCRIPTOR.full_name)

    @property
    def schema(self) -> bytes:
        """The message's schema as MCAP keeps it: its file's descriptor after those it imports."""
        return _schema(self.message)


def _schema(message: MessageClass) -> bytes:
    found: dict[str, Any] = {}

    def add(file: Any) -> None:
        if file.name not in found:
            for needed in file.dependencies:
                add(needed)
            found[file.name] = file

    add(message.DESCRIPTOR.file)
    described = descriptor_pb2.FileDescriptorSet()
    for file in found.values():
        file.CopyToProto(described.file.add())
    return bytes(described.SerializeToString(deterministic=True))


def own_message(name: str, *fields: tuple[str, int, bool]) -> MessageClass:
    """The class of predplan.<name>, made without a compiler. fields: name, type, whether repeated."""
    file = descriptor_pb2.FileDescriptorProto(name=f"predplan/{name}.proto", package="predplan", syntax="proto3")
    message = file.message_type.add(name=name)
    for number, (field, kind, repeated) in enumerate(fields, 1):
        label = FIELD.LABEL_REPEATED if repeated else FIELD.LABEL_OPTIONAL
        message.field.add(name=field, number=number, type=kind, label=label)
    pool = descriptor_pool.DescriptorPool()
    pool.Add(file)
    return message_factory.GetMessageClass(pool.FindMessageTypeByName(f"predplan.{name}"))


def named(names: str, values: Iterable[float]) -> dict[str, float]:
    """Fields of one letter each, as a message's arguments."""
    return dict(zip(names, values, strict=True))


def numbers(message: Any, names: str) -> list[float]:
    """The values of fields of one letter each."""
    return [getattr(message, name) for name in names]


def column(rows: Sequence[Sequence[float]]) -> FloatArray:
    """Rows of one length as a table [n, length]."""
    width = len(rows[0])
    if any(len(row) != width for row in rows):
        raise ValueError("the messages differ in length")
    values = np.fromiter(itertools.chain.from_iterable(rows), np.float64, len(rows) * width)
    return values.reshape(len(rows), width)
