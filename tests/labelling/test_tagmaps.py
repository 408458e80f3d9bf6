"""Tag maps: the package's own, files of a user, and tags that no map has."""

from pathlib import Path

import pytest

from predplan.errors import InputError
from predplan.labelling.sentences import LabelledCorpus
from predplan.labelling.tagmaps import map_dictionary, map_tags, own_tagmap, read_tagmap, strip_tag_suffix

CORPUS = LabelledCorpus((("a", "b", "c"), ("d",)), (("N-H", None, "P"), ("N",)))


@pytest.mark.parametrize(
    ("name", "entries"),
    [
        *[("en-brown", 472), ("en-ptb", 68), ("en-tweet", 25), ("tu-metusbanci", 31), ("tr-treebanks", 14)],
        *[("mlg", 23), ("mlg-dev-extra", 9), ("mlg-dict", 15), ("ud", 18)],
    ],
)
def test_own_maps_are_whole(name: str, entries: int) -> None:
    assert len(own_tagmap(name)) == entries


def test_the_malagasy_dev_scheme_maps_by_both_files_without_its_suffix() -> None:
    mapped = map_tags(strip_tag_suffix(CORPUS, "-H"), own_tagmap("mlg", "mlg-dev-extra"), "dev")
    assert mapped.tags == (("NOUN", None, "ADP"), ("NOUN",))
    assert mapped.words == CORPUS.words


def test_unmapped_tags_are_all_listed_with_their_counts() -> None:
    corpus = LabelledCorpus((("a", "b", "c", "d"),), (("Q", "N", "N", "V"),))
    with pytest.raises(InputError, match=r"mine: the tag map lacks 2 of its tags, with their counts: N \(2\), Q \(1\)"):
        map_tags(corpus, {"V": "VERB"}, "mine")
    with pytest.raises(InputError, match=r"words: .* N \(1\)"):
        map_dictionary({"a": frozenset({"N", "V"})}, {"V": "VERB"}, "words")


def test_bad_maps_name_the_line(tmp_path: Path) -> None:
    path = tmp_path / "own.map"
    path.write_text("N\tNOUN\nV\tVERBS\n")
    with pytest.raises(InputError, match=r"own.map:2: found 'V\\tVERBS'; expected tag<TAB>universal tag, one of NOUN"):
        read_tagmap(path)
    path.write_text("N\tNOUN\nN\tVERB\n")
    with pytest.raises(InputError, match=r"own.map:2: N is mapped to VERB, but before to NOUN"):
        read_tagmap(path)
    with pytest.raises(InputError, match="no map is named 'nope'; expected one of en-brown"):
        own_tagmap("nope")
