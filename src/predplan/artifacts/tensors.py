"""Arrays by name, with a sheet of plain data beside them, in one safetensors file. Loading runs no code."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from safetensors import SafetensorError, safe_open
from safetensors.numpy import save

from predplan.artifacts.files import write_whole
from predplan.errors import InputError


def write_tensors(path: Path, arrays: Mapping[str, NDArray[Any]], kind: str, sheet: Mapping[str, Any]) -> None:
    """Write arrays, and a sheet of what JSON can hold, whole. kind says what the file is."""
    whole = {name: np.asarray(one, order="C") for name, one in arrays.items()}
    data = save(whole, metadata={"kind": kind, "sheet": json.dumps(dict(sheet), allow_nan=False)})
    with write_whole(path) as temporary:
        temporary.write_bytes(_ordered(data))


def read_tensors(path: Path, kind: str) -> tuple[dict[str, NDArray[Any]], dict[str, Any]]:
    """Arrays and sheet. Raises InputError where the file is missing, cut short, of another kind or not safetensors."""
    if not path.is_file():
        raise InputError(f"{path}: no such file, expected a {kind}")
    try:
        with safe_open(path, framework="numpy") as opened:
            metadata = opened.metadata() or {}
            arrays = {name: np.array(opened.get_tensor(name)) for name in opened.keys()}  # noqa: SIM118
    except (SafetensorError, OSError, ValueError) as error:
        raise InputError(f"{path}: damaged, or not a {kind}: {error}") from error
    if metadata.get("kind") != kind:
        raise InputError(f"{path}: found {metadata.get('kind')!r}, expected a {kind}")
    try:
        return arrays, dict(json.loads(metadata["sheet"]))
    except (KeyError, TypeError, ValueError) as error:
        raise InputError(f"{path}: damaged: its sheet is not whole") from error


def _ordered(data: bytes) -> bytes:
    """The same file with its header's fields in order: safetensors writes metadata in an order that changes."""
    end = 8 + int.from_bytes(data[:8], "little")
    header = json.dumps(json.loads(data[8:end]), sort_keys=True, separators=(",", ":")).encode()
    header += b" " * (-len(header) % 8)
    return len(header).to_bytes(8, "little") + header + data[end:]
