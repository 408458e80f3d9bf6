"""Vertices of mesh files (STL, OBJ); only the convex hull of a mesh is used, so faces do not matter."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from predplan.errors import InputError
from predplan.planning.robots import FloatArray


def find_mesh(name: str, described_in: Path | str, link: str) -> Path:
    """The file that a URDF calls `name`: relative to the URDF, absolute, or package://PACKAGE/PATH.

    A package is looked for in the URDF's folder and those above it, as a folder called PACKAGE or as the folder itself.
    """
    folder = Path(described_in).resolve().parent
    if name.startswith("package://"):
        package, _, inside = name.removeprefix("package://").partition("/")
        above = [folder, *folder.parents]
        places = [place / package / inside for place in above] + [place / inside for place in above]
    else:
        places = [folder / name.removeprefix("file://")]
    for place in places:
        if place.is_file():
            return place
    raise InputError(f"{described_in}: the collision mesh {name!r} of {link} is missing; looked for {places[0]}")


def read_vertices(path: Path) -> FloatArray:
    """The vertices [n, 3] of an STL or OBJ file, as written there."""
    kind = path.suffix.lower()
    if kind not in (".stl", ".obj"):
        raise InputError(f"{path}: meshes of kind {kind or 'none'} are not read; expected .stl or .obj")
    data = path.read_bytes()
    try:
        vertices = _stl(data) if kind == ".stl" else _words(data, b"v ")
    except ValueError as error:
        raise InputError(f"{path}: not a mesh of kind {kind} ({error})") from error
    if len(vertices) < 4 or not np.all(np.isfinite(vertices)):
        raise InputError(f"{path}: {len(vertices)} vertices, or some not finite; expected at least 4 that are")
    return np.unique(vertices, axis=0)


def _stl(data: bytes) -> FloatArray:
    count = int.from_bytes(data[80:84], "little")
    if len(data) == 84 + 50 * count:
        facets = np.frombuffer(data, np.dtype([("floats", "<f4", 12), ("attribute", "<u2")]), count, 84)
        return facets["floats"][:, 3:].reshape(-1, 3).astype(np.float64)
    return _words(data, b"vertex ")


def _words(data: bytes, key: bytes) -> FloatArray:
    lines = (line.strip() for line in data.splitlines())
    rows = [[float(word) for word in line.split()[1:4]] for line in lines if line.startswith(key)]
    return np.array(rows, dtype=np.float64).reshape(-1, 3)
