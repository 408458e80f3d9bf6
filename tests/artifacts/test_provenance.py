import hashlib
from pathlib import Path

import pytest

from predplan import __version__
from predplan.artifacts.provenance import Provenance, hash_file


def test_it_comes_back_from_json() -> None:
    provenance = Provenance({"b": [1, 0.5], "a": {"x": None}}, seed=3, upstream={"tokens": "ab" * 32})
    assert Provenance.from_json(provenance.to_json()) == provenance
    assert provenance.version == __version__


def test_the_order_of_keys_does_not_show() -> None:
    assert Provenance({"a": 1, "b": 2}).to_json() == Provenance({"b": 2, "a": 1}).to_json()


@pytest.mark.parametrize("text", ["[]", "{}", '{"params": {}}', "no"])
def test_anything_else_is_refused(text: str) -> None:
    with pytest.raises(ValueError, match=r".+"):
        Provenance.from_json(text)


def test_hash_is_sha256_of_the_bytes(tmp_path: Path) -> None:
    path = tmp_path / "a"
    path.write_bytes(b"abc")
    assert hash_file(path) == hashlib.sha256(b"abc").hexdigest()
