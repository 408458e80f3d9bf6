import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from safetensors.numpy import save

from predplan.artifacts.tensors import read_tensors, write_tensors
from predplan.errors import InputError

ARRAYS: dict[str, NDArray[Any]] = {
    "numbers": np.arange(6.0).reshape(2, 3),
    "single": np.array([1.5], np.float32),
    "none": np.zeros((4, 0)),
    "alone": np.array(2.0),
    "flags": np.array([True, False]),
    "turned": np.arange(6).reshape(2, 3).T,
    "missing": np.array([np.nan, np.inf]),
}
SHEET = {"large": 2**127 + 1, "text": "µ", "nested": {"list": [1, 2.5, None]}}


def test_what_was_written_is_read(tmp_path: Path) -> None:
    path = tmp_path / "folder" / "arrays.safetensors"
    write_tensors(path, ARRAYS, "some kind", SHEET)
    arrays, sheet = read_tensors(path, "some kind")
    assert sheet == SHEET
    assert arrays.keys() == ARRAYS.keys()
    for name, one in ARRAYS.items():
        np.testing.assert_array_equal(arrays[name], one)
        assert arrays[name].dtype == one.dtype
        assert arrays[name].shape == one.shape


def test_same_arrays_same_bytes(tmp_path: Path) -> None:
    written = []
    for _ in range(20):
        write_tensors(tmp_path / "a", ARRAYS, "some kind", SHEET)
        written.append((tmp_path / "a").read_bytes())
    assert len(set(written)) == 1


def test_what_was_read_can_be_changed(tmp_path: Path) -> None:
    write_tensors(tmp_path / "a", ARRAYS, "some kind", {})
    read_tensors(tmp_path / "a", "some kind")[0]["numbers"][0, 0] = 7.0
    assert read_tensors(tmp_path / "a", "some kind")[0]["numbers"][0, 0] == 0.0


def test_a_failed_write_leaves_what_was_there(tmp_path: Path) -> None:
    path = tmp_path / "a"
    write_tensors(path, ARRAYS, "some kind", SHEET)
    before = path.read_bytes()
    with pytest.raises(ValueError, match="JSON"):
        write_tensors(path, ARRAYS, "some kind", {"not": float("nan")})
    assert path.read_bytes() == before
    assert list(tmp_path.iterdir()) == [path]


def test_missing_damaged_and_other_files_are_named(tmp_path: Path) -> None:
    path = tmp_path / "arrays.safetensors"
    with pytest.raises(InputError, match=f"{path}: no such file, expected a some kind"):
        read_tensors(path, "some kind")
    write_tensors(path, ARRAYS, "some kind", SHEET)
    data = path.read_bytes()
    with pytest.raises(InputError, match=f"{path}: found 'some kind', expected a other kind"):
        read_tensors(path, "other kind")
    for length in (0, 7, 50, len(data) // 2, len(data) - 1):
        path.write_bytes(data[:length])
        with pytest.raises(InputError, match=f"{path}: damaged, or not a some kind"):
            read_tensors(path, "some kind")
    path.write_text("no tensors, whatever the name says")
    with pytest.raises(InputError, match=f"{path}: damaged"):
        read_tensors(path, "some kind")


@pytest.mark.parametrize(
    "metadata", [None, {"kind": "some kind"}, {"kind": "some kind", "sheet": "{"}, {"kind": "some kind", "sheet": "3"}]
)
def test_files_without_a_whole_sheet_are_named(tmp_path: Path, metadata: dict[str, str] | None) -> None:
    path = tmp_path / "a"
    path.write_bytes(save({"x": np.zeros(3)}, metadata=metadata))
    with pytest.raises(InputError, match=f"{path}: "):
        read_tensors(path, "some kind")


def test_a_sheet_is_plain_json(tmp_path: Path) -> None:
    write_tensors(tmp_path / "a", {}, "some kind", SHEET)
    assert json.loads(json.dumps(SHEET)) == read_tensors(tmp_path / "a", "some kind")[1]
