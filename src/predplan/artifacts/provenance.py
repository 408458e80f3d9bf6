"""Where an artifact came from: what was set, the seed, the version and the hashes of what it was made of."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from predplan import __version__


@dataclass(frozen=True)
class Provenance:
    """What made an artifact: the same provenance, the same bytes, so it holds no clock and no path of a machine.

    params are the settings the stage read, as plain data; upstream maps the name of each input to its `hash_file`.
    """

    params: Mapping[str, Any] = field(default_factory=dict)
    seed: int | None = None
    version: str = __version__
    upstream: Mapping[str, str] = field(default_factory=dict)

    def to_json(self) -> str:
        """One line of JSON, keys sorted. Raises TypeError where params are not plain data, ValueError on NaN."""
        fields = {
            "params": dict(self.params),
            "seed": self.seed,
            "version": self.version,
            "upstream": dict(self.upstream),
        }
        return json.dumps(fields, sort_keys=True, ensure_ascii=False, allow_nan=False)

    @classmethod
    def from_json(cls, text: str | bytes) -> Provenance:
        """The provenance that `to_json` wrote. Raises ValueError for anything else."""
        fields = json.loads(text)
        if not isinstance(fields, dict) or fields.keys() != {"params", "seed", "version", "upstream"}:
            raise ValueError("not a provenance")
        return cls(**fields)


def hash_file(path: Path) -> str:
    """SHA-256 of the file's bytes, in hexadecimal."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()
