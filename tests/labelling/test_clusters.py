"""Word clusters: prefixes of paths, and the file's own names for mentions and URLs."""

from pathlib import Path

import pytest

from predplan.errors import InputError
from predplan.labelling.clusters import read_clusters


def test_prefixes_run_from_coarse_to_fine(tmp_path: Path) -> None:
    path = tmp_path / "paths"
    path.write_text("00101\tthe\t9\n0010\t<@MENTION>\t5\n111\t<URL-a.b>\t1\n000\t<URL-t.co>\t7\n110\t<URL-c.d>\t2\n")
    clusters = read_clusters(path)
    assert clusters["the"] == ("00", "0010", "00101")
    assert clusters["@USER"] == ("00", "0010")
    assert clusters["http://url"] == ("00", "000")
    assert set(clusters) == {"the", "@USER", "http://url"}


@pytest.mark.parametrize("line", ["01\tword", "0x\tword\t1", "01\tword\tmany"])
def test_bad_lines_are_named(tmp_path: Path, line: str) -> None:
    (tmp_path / "paths").write_text(f"01\tok\t1\n{line}\n")
    with pytest.raises(InputError, match=r"paths:2: found .*expected bits<TAB>word<TAB>count"):
        read_clusters(tmp_path / "paths")
