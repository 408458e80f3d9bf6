"""Learned filters as folders: numbers in safetensors, what they are in JSON. Loading runs no code.

    filter.safetensors    arrays by name, float64
    filter.json           kind, limits, and the SHA-256 of the arrays that belong to it

Each file is written whole, arrays first. A folder in which one was replaced and the other not, or a number was
changed, is damaged, and reading says so.
"""

from __future__ import annotations

import hashlib
from dataclasses import fields
from operator import attrgetter
from pathlib import Path
from typing import Any

import numpy as np
from safetensors import SafetensorError
from safetensors.numpy import load as load_tensors
from safetensors.numpy import save as save_tensors

from predplan.artifacts.files import read_json, write_json, write_whole
from predplan.control.features import FeatureMap
from predplan.control.kernel_psr import KernelFilter
from predplan.control.linear_filter import LinearFilter
from predplan.control.tasks import FloatArray
from predplan.errors import InputError

VERSION = 1
ARRAYS, SHEET = "filter.safetensors", "filter.json"

SHAPES = {
    "linear": {
        "A": "pp", "B": "pa", "c": "p", "K": "po", "C": "op", "D": "oa", "d": "o", "S": "oo",
        "initial_mean": "p", "initial_covariance": "pp", "shift": "o", "scale": "o",
    },
    "kernel": {
        "observed.shift": "o", "observed.scale": "o", "observed.frequencies": "of", "observed.projection": "gi",
        "acted.shift": "a", "acted.scale": "a", "acted.frequencies": "ae", "acted.projection": "hj",
        "to_state": "pPQ", "from_skipped": "Pix", "from_skipped_action": "jQy", "from_square": "iis",
        "extend": "xyp", "immediate": "sjp", "predictor": "opj", "shift": "o", "scale": "o", "start": "p",
    },
}  # fmt: skip
"""Of each kind, its arrays and their sizes: one letter is one number in all of them."""
SCALARS = {"linear": ("limit",), "kernel": ("lam", "limit")}


def save_model(folder: Path, model: LinearFilter | KernelFilter) -> None:
    """Write the model into the folder, which is made if it is missing; other files there stay.

    Raises InputError for a model that could not be read back, and for a CorrectedFilter: corrections are compared with
    other predictors, no policy has one, and `fit_correction` learns one in seconds.
    """
    if not isinstance(model, LinearFilter | KernelFilter):
        raise InputError(f"model: found a {type(model).__name__}, expected a LinearFilter or a KernelFilter")
    kind = "linear" if isinstance(model, LinearFilter) else "kernel"
    arrays = _take_apart(kind, model)
    scalars = {name: float(getattr(model, name)) for name in SCALARS[kind]}
    _check(kind, arrays, scalars, "model")
    data = save_tensors(arrays)
    with write_whole(folder / ARRAYS) as temporary:
        temporary.write_bytes(data)
    sheet = {"format": "predplan filter", "version": VERSION, "kind": kind, "arrays_sha256": _digest(data), **scalars}
    write_json(folder / SHEET, sheet)


def load_model(folder: Path) -> LinearFilter | KernelFilter:
    """The model that was saved there. Raises InputError, naming file and field, where it is not whole."""
    kind, scalars, digest = _read_sheet(folder / SHEET)
    path = folder / ARRAYS
    try:
        data = path.read_bytes()
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror}") from error
    if _digest(data) != digest:
        raise InputError(f"{path}: damaged, or not of {SHEET}: its SHA-256 is not arrays_sha256 there")
    try:
        arrays = {name: np.array(array) for name, array in load_tensors(data).items()}
    except SafetensorError as error:
        raise InputError(f"{path}: not a safetensors file: {error}") from error
    _check(kind, arrays, scalars, str(path))
    return _put_together(kind, arrays, scalars)


def _read_sheet(path: Path) -> tuple[str, dict[str, float], str]:
    """Kind, numbers and the arrays' digest."""
    sheet = read_json(path)
    if not isinstance(sheet, dict) or sheet.get("format") != "predplan filter":
        raise InputError(f"{path}: format: expected 'predplan filter'; this is no saved filter")
    if sheet.get("version") != VERSION:
        raise InputError(f"{path}: version: found {sheet.get('version')!r}, expected {VERSION}")
    kind = sheet.get("kind")
    if not isinstance(kind, str) or kind not in SHAPES:
        raise InputError(f"{path}: kind: found {kind!r}, expected one of {', '.join(SHAPES)}")
    scalars = {}
    for name in SCALARS[kind]:
        value = sheet.get(name)
        if isinstance(value, bool) or not isinstance(value, int | float) or not 0.0 < value < float("inf"):
            raise InputError(f"{path}: {name}: found {value!r}, expected a number above 0")
        scalars[name] = float(value)
    return kind, scalars, str(sheet.get("arrays_sha256"))


def _check(kind: str, arrays: dict[str, FloatArray], scalars: dict[str, float], where: str) -> None:
    """Raise InputError unless the arrays are those of that kind, their shapes agree, and all numbers are finite."""
    for name in arrays.keys() - SHAPES[kind].keys():
        raise InputError(f"{where}: {name}: not an array of a {kind} filter")
    sizes: dict[str, int] = {}
    for name, letters in SHAPES[kind].items():
        if name not in arrays:
            raise InputError(f"{where}: {name}: missing")
        array = arrays[name]
        if array.dtype != np.float64:
            raise InputError(f"{where}: {name}: found {array.dtype}, expected float64")
        expected = tuple(sizes.get(letter, -1) for letter in letters)
        fits = array.ndim == len(letters) and all(
            found == sizes.setdefault(letter, found) for found, letter in zip(array.shape, letters, strict=True)
        )
        if not fits or 0 in array.shape:
            wanted = ", ".join("any" if size < 0 else str(size) for size in expected)
            raise InputError(f"{where}: {name}: found shape {array.shape}, expected ({wanted}) as of the others")
        if not np.isfinite(array).all():
            raise InputError(f"{where}: {name}: found a number that is not finite")
    for name in ("scale", "observed.scale", "acted.scale"):
        if name in arrays and not (arrays[name] > 0.0).all():
            raise InputError(f"{where}: {name}: expected numbers above 0")
    for name, value in scalars.items():
        if not 0.0 < value < float("inf"):
            raise InputError(f"{where}: {name}: found {value}, expected a finite number above 0")


def _take_apart(kind: str, model: LinearFilter | KernelFilter) -> dict[str, FloatArray]:
    if isinstance(model, KernelFilter):
        for name in ("observed", "acted"):
            if not isinstance(getattr(model, name), FeatureMap):
                raise InputError(f"model: {name}: only a FeatureMap can be saved")
    return {name: np.ascontiguousarray(attrgetter(name)(model), np.float64) for name in SHAPES[kind]}


def _put_together(kind: str, arrays: dict[str, FloatArray], scalars: dict[str, float]) -> LinearFilter | KernelFilter:
    own: dict[str, Any] = {**{name: array for name, array in arrays.items() if "." not in name}, **scalars}
    if kind == "linear":
        return LinearFilter(**own)
    for part in ("observed", "acted"):
        own[part] = FeatureMap(**{field.name: arrays[f"{part}.{field.name}"] for field in fields(FeatureMap)})
    return KernelFilter(**own)


def _digest(data: bytes) -> str:
    return hashlib.sha256(data).hexdigest()
