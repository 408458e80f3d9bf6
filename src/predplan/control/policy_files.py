"""Learned policies as folders. Loading runs no code.

policy.json           the task and the method it was learned with, and the SHA-256 of the network
network.safetensors   weights and whitening
filter.*              the predictive state's model, where there is one (`models`)
"""

from __future__ import annotations

import hashlib
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
import torch

from predplan.artifacts.files import read_json, write_json
from predplan.artifacts.tensors import read_tensors, write_tensors
from predplan.control.environments import EnvironmentSettings
from predplan.control.learned import Learned
from predplan.control.linear_filter import LinearFilter
from predplan.control.memories import Arrays, under
from predplan.control.methods import find_method
from predplan.control.models import load_model, save_model
from predplan.control.networks import ActorCritic
from predplan.control.whitening import Whitening
from predplan.errors import InputError

SHEET, WEIGHTS, KIND = "policy.json", "network.safetensors", "predplan policy"
VERSION = 1


def save_policy(folder: Path, learned: Learned) -> None:
    """Write the policy into the folder; the sheet last, so that a folder is whole where it fits the rest."""
    if learned.model is not None:
        save_model(folder, learned.model)
    arrays = {f"network.{name}": one.numpy() for name, one in learned.network.state_dict().items()}
    arrays |= {"whitening.mean": learned.whitening.mean, "whitening.matrix": learned.whitening.matrix}
    write_tensors(folder / WEIGHTS, arrays, KIND, {})
    sheet = {
        "format": KIND,
        "version": VERSION,
        "method": learned.name,
        "task": asdict(learned.task),
        "observations": learned.observations,
        "actions": learned.actions,
        "network_sha256": _digest(folder / WEIGHTS),
    }
    write_json(folder / SHEET, sheet)


def load_policy(folder: Path) -> Learned:
    """Raises InputError, naming file and field, where the folder does not hold a whole policy."""
    path = folder / SHEET
    sheet = read_json(path)
    if not isinstance(sheet, dict) or sheet.get("format") != KIND:
        raise InputError(f"{path}: format: expected {KIND!r}; this is no saved policy")
    if sheet.get("version") != VERSION:
        raise InputError(f"{path}: version: found {sheet.get('version')!r}, expected {VERSION}")
    task = _task(path, sheet.get("task"))
    name = sheet.get("method")
    try:
        method = find_method(str(name))
    except InputError as error:
        raise InputError(f"{path}: {error}") from error
    sizes = [_size(path, sheet, field) for field in ("observations", "actions")]
    if not (folder / WEIGHTS).is_file():
        raise InputError(f"{folder / WEIGHTS}: no such file, expected the network of {path}")
    if _digest(folder / WEIGHTS) != sheet.get("network_sha256"):
        raise InputError(f"{folder / WEIGHTS}: damaged, or not of {SHEET}: its SHA-256 is not network_sha256 there")
    arrays, _ = read_tensors(folder / WEIGHTS, KIND)
    for array_name, array in arrays.items():
        if not np.isfinite(array).all():
            raise InputError(f"{folder / WEIGHTS}: {array_name}: found a number that is not finite")
    model = load_model(folder) if method.filter is not None else None
    if model is not None and not isinstance(model, LinearFilter):
        raise InputError(f"{folder}: filter.json: kind: expected 'linear'")
    whitening = _whitening(folder / WEIGHTS, under(arrays, "whitening"))
    network = ActorCritic(len(whitening.mean), sizes[1], method.network, torch.Generator())
    weights = {key: torch.from_numpy(one) for key, one in under(arrays, "network").items()}
    try:
        network.load_state_dict(weights)
    except RuntimeError as error:
        raise InputError(f"{folder / WEIGHTS}: not the weights of {name!r}: {error}") from error
    if model is not None and (model.observation_size, model.B.shape[1]) != tuple(sizes):
        found = f"{model.observation_size} observations and {model.B.shape[1]} actions"
        raise InputError(f"{folder}: filter.safetensors: found a filter of {found}, expected {sizes[0]} and {sizes[1]}")
    learned = Learned(task, str(name), method, sizes[0], sizes[1], network, whitening, model)
    told = learned.memory(1).size
    if told != len(whitening.mean):
        raise InputError(
            f"{folder / WEIGHTS}: whitening.mean: found {len(whitening.mean)} numbers, expected {told}: as many as"
            f" {name!r} is told of {sizes[0]} observations"
        )
    return learned


def _whitening(path: Path, arrays: Arrays) -> Whitening:
    shapes = {name: one.shape for name, one in arrays.items()}
    size = len(arrays["mean"]) if "mean" in arrays and arrays["mean"].ndim == 1 else 0
    if size == 0 or shapes != {"mean": (size,), "matrix": (size, size)}:
        raise InputError(f"{path}: whitening: found arrays of shapes {shapes}, expected mean [F] and matrix [F, F]")
    return Whitening(*(np.array(arrays[name], np.float64) for name in ("mean", "matrix")))


def _task(path: Path, found: Any) -> EnvironmentSettings:
    if not isinstance(found, dict):
        raise InputError(f"{path}: task: found {found!r}, expected its settings")
    try:
        scale = found.get("scale")
        return EnvironmentSettings(**{**found, "scale": tuple(scale) if scale else None})
    except (TypeError, InputError) as error:
        raise InputError(f"{path}: task: {error}") from error


def _size(path: Path, sheet: dict[str, Any], field: str) -> int:
    value = sheet.get(field)
    if isinstance(value, bool) or not isinstance(value, int) or value < 1:
        raise InputError(f"{path}: {field}: found {value!r}, expected a number from 1 on")
    return value


def _digest(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()
