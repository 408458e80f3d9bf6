import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from safetensors.numpy import load_file, save

from predplan.artifacts.files import read_json, write_json
from predplan.control.correction import CorrectionSettings, fit_correction
from predplan.control.filtering import filter_trajectories
from predplan.control.innovation import InnovationSettings, fit_innovation
from predplan.control.kernel_psr import KernelSettings, fit_kernel
from predplan.control.linear_filter import LinearFilter
from predplan.control.models import ARRAYS, SHEET, load_model, save_model
from predplan.errors import InputError
from tests.control.systems import exact_filter, example, simulate

DATA = simulate(example(), 30, 30, np.random.default_rng(0), 0.2)


@pytest.fixture(scope="module")
def linear() -> LinearFilter:
    return fit_innovation(DATA, InnovationSettings(past=5, future=3, dimension=3))


def test_a_linear_filter_comes_back_to_the_last_bit(tmp_path: Path, linear: LinearFilter) -> None:
    save_model(tmp_path / "new" / "model", linear)
    again = load_model(tmp_path / "new" / "model")
    assert isinstance(again, LinearFilter)
    first, second = (filter_trajectories(model, DATA) for model in (linear, again))
    np.testing.assert_array_equal(first.after, second.after)
    np.testing.assert_array_equal(linear.initial_covariance, again.initial_covariance)
    assert sorted(path.name for path in (tmp_path / "new" / "model").iterdir()) == [SHEET, ARRAYS]


def test_a_kernel_filter_comes_back_to_the_last_bit(tmp_path: Path) -> None:
    settings = KernelSettings(past=4, future=3, dimension=5, frequencies=40)
    model = fit_kernel(DATA, settings, np.random.default_rng(1))
    save_model(tmp_path, model)
    first, second = (filter_trajectories(one, DATA) for one in (model, load_model(tmp_path)))
    np.testing.assert_array_equal(first.after, second.after)
    np.testing.assert_array_equal(first.prediction, second.prediction)


def test_saving_again_replaces_and_gives_the_same_bytes(tmp_path: Path, linear: LinearFilter) -> None:
    save_model(tmp_path, replace(linear, limit=1.0))
    save_model(tmp_path, linear)
    first = [(tmp_path / name).read_bytes() for name in (ARRAYS, SHEET)]
    save_model(tmp_path, linear)
    assert first == [(tmp_path / name).read_bytes() for name in (ARRAYS, SHEET)]


def test_a_correction_is_refused_and_what_is_there_stays(tmp_path: Path, linear: LinearFilter) -> None:
    save_model(tmp_path, linear)
    before = (tmp_path / SHEET).read_bytes()
    corrected = fit_correction(linear, DATA, CorrectionSettings(frequencies=10), np.random.default_rng(2))
    with pytest.raises(InputError, match="model: found a CorrectedFilter, expected a LinearFilter or a KernelFilter"):
        save_model(tmp_path, corrected)  # type: ignore[arg-type]
    assert (tmp_path / SHEET).read_bytes() == before


@pytest.mark.parametrize("cut", [0, 5, 100, -1])
def test_cut_or_changed_arrays_are_damaged(tmp_path: Path, linear: LinearFilter, cut: int) -> None:
    save_model(tmp_path, linear)
    data = (tmp_path / ARRAYS).read_bytes()
    (tmp_path / ARRAYS).write_bytes(data[:cut])
    with pytest.raises(InputError, match=f"{ARRAYS}: damaged"):
        load_model(tmp_path)
    (tmp_path / ARRAYS).write_bytes(data[:-3] + bytes([data[-3] ^ 1]) + data[-2:])
    with pytest.raises(InputError, match=f"{ARRAYS}: damaged"):
        load_model(tmp_path)


def test_missing_files_are_named(tmp_path: Path, linear: LinearFilter) -> None:
    with pytest.raises(InputError, match=f"{SHEET}: cannot be read"):
        load_model(tmp_path)
    save_model(tmp_path, linear)
    (tmp_path / ARRAYS).unlink()
    with pytest.raises(InputError, match=f"{ARRAYS}: cannot be read"):
        load_model(tmp_path)


@pytest.mark.parametrize(
    ("field", "value", "message"),
    [
        ("format", "another", "format: expected 'predplan filter'"),
        ("version", 2, "version: found 2, expected 1"),
        ("kind", "round", "kind: found 'round', expected one of linear, kernel"),
        ("kind", ["linear"], "kind: found"),
        ("kind", "kernel", "lam: found None"),
        ("limit", None, "limit: found None, expected a number above 0"),
        ("limit", True, "limit: found True"),
        ("limit", -1.0, "limit: found -1.0"),
        ("limit", "3", "limit: found '3'"),
        ("arrays_sha256", None, "damaged, or not of"),
    ],
)
def test_a_foreign_sheet_is_named(
    tmp_path: Path, linear: LinearFilter, field: str, value: object, message: str
) -> None:
    save_model(tmp_path, linear)
    write_json(tmp_path / SHEET, {**read_json(tmp_path / SHEET), field: value})
    with pytest.raises(InputError, match=message):
        load_model(tmp_path)


def test_what_is_no_sheet_at_all(tmp_path: Path) -> None:
    for text, message in (("[1, 2]", "no saved filter"), ('{"limit": NaN}', "no saved filter"), ("{", "valid JSON")):
        (tmp_path / SHEET).write_text(text)
        with pytest.raises(InputError, match=message):
            load_model(tmp_path)


def forge(folder: Path, arrays: dict[str, np.ndarray]) -> None:
    """Put other arrays into a saved model, with their right digest."""
    import hashlib

    data = save(arrays)
    (folder / ARRAYS).write_bytes(data)
    sheet = json.loads((folder / SHEET).read_text())
    write_json(folder / SHEET, {**sheet, "arrays_sha256": hashlib.sha256(data).hexdigest()})


@pytest.mark.parametrize(
    ("name", "array", "message"),
    [
        ("K", np.zeros((4, 2)), r"K: found shape \(4, 2\), expected \(3, any\)"),
        ("d", np.zeros((2, 1)), r"d: found shape \(2, 1\), expected \(2\)"),
        ("c", np.array([0.0, np.nan, 0.0]), "c: found a number that is not finite"),
        ("c", np.zeros(3, np.float32), "c: found float32, expected float64"),
        ("scale", np.zeros(2), "scale: expected numbers above 0"),
        ("S", None, "S: missing"),
        ("extra", np.zeros(2), "extra: not an array of a linear filter"),
    ],
)
def test_wrong_arrays_are_named(
    tmp_path: Path, linear: LinearFilter, name: str, array: np.ndarray | None, message: str
) -> None:
    save_model(tmp_path, linear)
    arrays = load_file(tmp_path / ARRAYS)
    if array is None:
        del arrays[name]
    else:
        arrays[name] = array
    forge(tmp_path, arrays)
    with pytest.raises(InputError, match=message):
        load_model(tmp_path)


def test_what_could_not_be_read_is_not_written(tmp_path: Path) -> None:
    model = exact_filter(example())
    save_model(tmp_path, model)
    with pytest.raises(InputError, match="model: A: found a number that is not finite"):
        save_model(tmp_path, replace(model, A=np.full((3, 3), np.nan)))
    with pytest.raises(InputError, match="model: limit: found inf"):
        save_model(tmp_path, replace(model, limit=np.inf))
    load_model(tmp_path)
