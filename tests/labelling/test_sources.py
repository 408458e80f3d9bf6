"""Fetching a corpus: places in order, checked sums, and what is said when all fail."""

import hashlib
import zipfile
from collections.abc import Mapping
from pathlib import Path

import pytest

from predplan.errors import InputError, PredplanError
from predplan.labelling import sources
from predplan.labelling.sources import Place, Source, fetch

CONTENT = {"c01": b"The/at\n", "c02": b"end/nn\n"}
SUMS = {"c[0-9][0-9]": hashlib.sha256(b"".join(CONTENT.values())).hexdigest()}


def fill(folder: Path, content: Mapping[str, bytes]) -> Path:
    for name, data in content.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_bytes(data)
    return folder


def declare(monkeypatch: pytest.MonkeyPatch, *places: Place) -> None:
    monkeypatch.setattr(sources, "sources", lambda: {"tiny": Source("tiny", "", "", places)})


def test_the_mirror_comes_first_and_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    mirror = fill(tmp_path / "mirror", {f"tiny/{name}": data for name, data in CONTENT.items()})
    declare(monkeypatch, Place("mirror", "tiny", SUMS))
    fetched = fetch("tiny", mirror, tmp_path / "out")
    assert fetched.place == "mirror tiny"
    assert [path.read_bytes() for path in fetched.paths] == list(CONTENT.values())
    assert sorted(path.name for path in (tmp_path / "out").iterdir()) == sorted(CONTENT)
    assert fetched.sha256["c01"] == hashlib.sha256(CONTENT["c01"]).hexdigest()


def test_without_npm_the_archive_is_taken(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with zipfile.ZipFile(tmp_path / "tiny.zip", "w") as archive:
        for name, data in CONTENT.items():
            archive.writestr(f"inside/{name}", data)
    monkeypatch.setenv("PATH", str(tmp_path))
    npm = Place("npm", "tiny@1", SUMS, "package")
    declare(monkeypatch, npm, Place("zip", (tmp_path / "tiny.zip").as_uri(), SUMS, "inside"))
    assert fetch("tiny", None, tmp_path / "out").place.startswith("zip ")


def test_files_of_an_address_may_lie_under_other_names(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    origin = fill(tmp_path / "web", {"deep/c01": CONTENT["c01"], "c02": CONTENT["c02"]})
    declare(monkeypatch, Place("url", origin.as_uri(), {"c01": "", "c02": ""}, paths={"c01": "deep/c01"}))
    fetched = fetch("tiny", None, tmp_path / "out")
    assert [path.read_bytes() for path in fetched.paths] == list(CONTENT.values())


def test_the_error_says_what_was_tried_and_why_each_failed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    mirror = fill(tmp_path / "mirror", {"tiny/c01": b"changed", "bare/other": b""})
    places = (Place("mirror", "tiny", SUMS), Place("mirror", "bare", SUMS))
    declare(monkeypatch, *places, Place("url", (tmp_path / "gone").as_uri(), {"c01": ""}))
    with pytest.raises(PredplanError) as caught:
        fetch("tiny", mirror, tmp_path / "out")
    message = str(caught.value)
    changed = hashlib.sha256(b"changed").hexdigest()
    assert f"mirror tiny: c[0-9][0-9] has SHA-256 {changed}, expected {SUMS['c[0-9][0-9]']}" in message
    assert "mirror bare: it has no file c[0-9][0-9]" in message
    assert "gone/c01: " in message
    assert list((tmp_path / "out").iterdir()) == []


def test_an_unknown_corpus_and_an_unset_mirror(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(InputError, match="'tiny' is not declared; expected one of brown, turkish, twitter"):
        fetch("tiny", None, tmp_path)
    declare(monkeypatch, Place("mirror", "tiny", SUMS))
    with pytest.raises(PredplanError, match="no mirror folder is set"):
        fetch("tiny", None, tmp_path)


def test_every_declared_place_is_well_formed() -> None:
    for source in sources.sources().values():
        assert source.places
        assert source.citation
        assert source.licence
        for place in source.places:
            assert place.kind in {"mirror", "npm", "wheel", "zip", "url"}
            assert place.files
            assert set(place.paths) <= set(place.files)
            pinned = "4fbd22cd78421f05b1ecdb4fc5725bc7a7bd8f66" in place.origin
            assert all(len(digest) == 64 or pinned for digest in place.files.values())
