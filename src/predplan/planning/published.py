"""The whole published set of MotionBenchMaker's problems for the Panda, from VAMP's public repository, checked."""

from __future__ import annotations

import hashlib
import re
import shutil
import tarfile
import tempfile
import urllib.request
from http.client import HTTPException
from pathlib import Path, PurePosixPath

from predplan.errors import PredplanError
from predplan.planning.benchmarks import FOLDER, ROBOT, SUFFIX

ADDRESS = "https://raw.githubusercontent.com/KavrakiLab/vamp/main/resources/panda"
"""Apache-2.0; citation: Chamzas et al. 2022 (MotionBenchMaker), Thomason, Kingston and Kavraki 2024 (VAMP)."""
ARCHIVE = "problems.tar.bz2"
SHA256 = {
    ARCHIVE: "4e1509e99c53da769ee6a338cf1173ecf601e4ec16f24081d3894ef358243b69",
    ROBOT: "d7d891b892e805d399d506a5c3f3cfc698ac75e48ec55449bde025dc7403291c",
    "panda.srdf": "1150719ea9d81139418198a50faea17e155323547d056c4edcb7ecc82fd8d317",
}
TIMEOUT_S = 300
PROBLEMS = 700
_MEMBER = re.compile(rf"[^/]+/(?P<place>[a-z_]+{SUFFIX}/(scene|request)\d+\.yaml)")


def fetch_published(
    folder: Path, address: str = ADDRESS, sha256: dict[str, str] | None = None, problems: int = PROBLEMS
) -> Path:
    """The folder, filled as benchmarks.read_problems expects it; nothing is fetched where it is whole.

    Every file is checked against its SHA-256 and the archive for its number of problems before the folder appears.
    Raises PredplanError, which names the address and both sums, where something cannot be had or is another.
    """
    if folder.is_dir():
        return folder
    sha256 = sha256 or SHA256
    folder.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(prefix=".fetch-", dir=folder.parent) as name:
        scratch = Path(name) / folder.name
        scratch.mkdir()
        for file, expected in sha256.items():
            _download(f"{address}/{file}", scratch / file, expected)
        with tarfile.open(scratch / ARCHIVE) as archive:
            count = _extract(archive, scratch / FOLDER)
        if count != 2 * problems:
            raise PredplanError(f"{address}/{ARCHIVE}: {count} scenes and requests; expected {2 * problems}")
        (scratch / ARCHIVE).unlink()
        scratch.rename(folder)
    return folder


def _download(address: str, path: Path, expected: str) -> None:
    try:
        with urllib.request.urlopen(address, timeout=TIMEOUT_S) as response, path.open("wb") as file:
            shutil.copyfileobj(response, file)
    except (OSError, HTTPException) as error:
        raise PredplanError(f"{address}: {error}; put the folder in the mirror instead (PREDPLAN_MIRROR)") from error
    with path.open("rb") as file:
        found = hashlib.file_digest(file, "sha256").hexdigest()
    if found != expected:
        raise PredplanError(f"{address}: SHA-256 {found}, expected {expected}")


def _extract(archive: tarfile.TarFile, destination: Path) -> int:
    """Write scenes and requests, SOMETHING/SET_panda/sceneNNNN.yaml in the archive, as SET_panda/sceneNNNN.yaml."""
    count = 0
    for member in archive:
        match = _MEMBER.fullmatch(str(PurePosixPath(member.name)))
        content = archive.extractfile(member) if match and member.isfile() else None
        if match is None or content is None:
            continue
        place = destination / match["place"]
        place.parent.mkdir(parents=True, exist_ok=True)
        with content, place.open("wb") as file:
            shutil.copyfileobj(content, file)
        count += 1
    return count
