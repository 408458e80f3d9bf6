"""Solids as Foxglove's scene updates."""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from typing import Any, Literal

import numpy as np
from foxglove_schemas_protobuf.SceneUpdate_pb2 import SceneUpdate

from predplan.artifacts.messages import Kind, named, numbers
from predplan.artifacts.recordings import Colour, FloatArray, IntArray, Mesh, Primitive, Solid

_KINDS: tuple[Literal["cube", "sphere", "cylinder"], ...] = ("cube", "sphere", "cylinder")


def _encode_solids(solids: Sequence[Solid]) -> Iterator[bytes]:
    """One foxglove.SceneUpdate: an entity for each run of solids that share name and frame."""
    message = SceneUpdate()
    for (name, frame), parts in itertools.groupby(solids, key=lambda solid: (solid.name, solid.frame)):
        entity = message.entities.add(id=name, frame_id=frame, frame_locked=True)
        entity.timestamp.SetInParent()
        for part in parts:
            colour = named("rgba", part.colour)
            if isinstance(part, Mesh):
                surface = entity.triangles.add(color=colour, indices=part.triangles.ravel().tolist())
                surface.pose.orientation.w = 1.0
                for x, y, z in part.vertices.tolist():
                    surface.points.add(x=x, y=y, z=z)
            else:
                pose = {
                    "position": named("xyz", part.centre.tolist()),
                    "orientation": named("xyzw", part.quaternion.tolist()),
                }
                shape = {"pose": pose, "size": named("xyz", part.size.tolist()), "color": colour}
                if part.kind == "cube":
                    entity.cubes.add(**shape)
                elif part.kind == "sphere":
                    entity.spheres.add(**shape)
                else:
                    entity.cylinders.add(**shape, bottom_scale=1.0, top_scale=1.0)
    yield message.SerializeToString()


def _decode_solids(times: FloatArray, messages: Sequence[bytes]) -> Sequence[Solid]:
    """The solids of the first message: in each entity cubes, spheres, cylinders, meshes."""
    solids: list[Solid] = []
    for entity in SceneUpdate.FromString(messages[0]).entities:
        for kind in _KINDS:
            for part in getattr(entity, f"{kind}s"):
                solids.append(
                    Primitive(
                        entity.id,
                        kind,
                        np.array(numbers(part.pose.position, "xyz")),
                        np.array(numbers(part.pose.orientation, "xyzw")),
                        np.array(numbers(part.size, "xyz")),
                        _colour(part.color),
                        entity.frame_id,
                    )
                )
        for surface in entity.triangles:
            vertices = np.array([(point.x, point.y, point.z) for point in surface.points], np.float64).reshape(-1, 3)
            triangles: IntArray = np.array(surface.indices, np.int64).reshape(-1, 3)
            if triangles.size and triangles.max() >= len(vertices):
                raise ValueError(f"the mesh {entity.id!r} has triangles without vertices")
            vertices = _placed(surface.pose, vertices)
            solids.append(Mesh(entity.id, vertices, triangles, _colour(surface.color), entity.frame_id))
    return tuple(solids)


def _colour(message: Any) -> Colour:
    return message.r, message.g, message.b, message.a


def _placed(pose: Any, points: FloatArray) -> FloatArray:
    """Points [n, 3] of a thing at a pose, in the pose's frame."""
    w, axis = pose.orientation.w, np.array(numbers(pose.orientation, "xyz"))
    twist = 2.0 * np.cross(axis, points)
    placed: FloatArray = points + w * twist + np.cross(axis, twist) + np.array(numbers(pose.position, "xyz"))
    return placed


SCENE = Kind(SceneUpdate, _encode_solids, _decode_solids)
