"""Reading the formats labelled text comes in, and what is said of bad input."""

import gzip
from collections.abc import Callable
from pathlib import Path

import pytest
import zstandard
from hypothesis import given
from hypothesis import strategies as st

from predplan.errors import InputError
from predplan.labelling.readers import (
    read_brown,
    read_dictionary,
    read_labelled,
    read_letter_dictionary,
    read_pairs,
    read_raw,
    read_tokenised,
    read_word_groups,
)

COLUMNS = "#hash\t#\nTsy\tNEG\r\nmanao\t_\n\n\n.\t.\n"
CONLLU = """# sent_id = 1
# text = vámonos al mar
1-2\tvámonos\t_\t_\t_\t_\t_\t_\t_\t_
1\tvamos\tir\tVERB\t_\t_\t0\troot\t_\t_
2\tnos\tnosotros\tPRON\t_\t_\t1\tobj\t_\t_
2.1\tghost\t_\tVERB\t_\t_\t_\t_\t_\t_
3\tmar\tmar\t_\t_\t_\t1\tobl\t_\t_

1\tfin\tfin\tNOUN\t_\t_\t0\troot\t_\t_
"""


def write(folder: Path, content: str | bytes, name: str = "file.txt") -> Path:
    path = folder / name
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    return path


def test_two_columns_keep_hashtags_and_unlabelled_words(tmp_path: Path) -> None:
    corpus = read_labelled(write(tmp_path, COLUMNS))
    assert corpus.words == (("#hash", "Tsy", "manao"), (".",))
    assert corpus.tags == (("#", "NEG", None), (".",))


def test_conllu_passes_over_comments_multiword_tokens_and_empty_nodes(tmp_path: Path) -> None:
    corpus = read_labelled(write(tmp_path, CONLLU))
    assert corpus.words == (("vamos", "nos", "mar"), ("fin",))
    assert corpus.tags == (("VERB", "PRON", None), ("NOUN",))


@pytest.mark.parametrize("compress", [gzip.compress, zstandard.compress])
def test_compressed_files_read_as_plain_ones(tmp_path: Path, compress: Callable[[bytes], bytes]) -> None:
    assert read_labelled(write(tmp_path, compress(CONLLU.encode()))) == read_labelled(write(tmp_path, CONLLU, "plain"))


@given(
    sentences=st.lists(
        st.lists(
            st.tuples(st.text("ab#|é/_", min_size=1), st.one_of(st.none(), st.text("NV#-", min_size=1))), min_size=1
        ),
        min_size=1,
    )
)
def test_two_columns_give_back_what_was_written(
    tmp_path_factory: pytest.TempPathFactory, sentences: list[list[tuple[str, str | None]]]
) -> None:
    text = "\n\n".join("\n".join(f"{word}\t{tag or '_'}" for word, tag in sentence) for sentence in sentences)
    corpus = read_labelled(write(tmp_path_factory.mktemp("columns"), text))
    assert [list(zip(w, t, strict=True)) for w, t in zip(corpus.words, corpus.tags, strict=True)] == sentences


def test_pairs_split_at_the_last_separator(tmp_path: Path) -> None:
    corpus = read_pairs(write(tmp_path, "Siria|PN @:|: ||.\n\n@-@|@-@\n"))
    assert corpus.words == (("Siria", "@:", "|"), ("@-@",))
    assert corpus.tags == (("PN", ":", "."), ("@-@",))


def test_brown_reads_its_files_in_order_with_tags_in_upper_case(tmp_path: Path) -> None:
    write(tmp_path, "\n\n\ta/at 1/2/cd\n\n", "cb01")
    write(tmp_path, "The/at Jury/nn-tl\n", "ca44")
    write(tmp_path, "not a corpus file\n", "cats.txt")
    corpus = read_brown(tmp_path)
    assert corpus.words == (("The", "Jury"), ("a", "1/2"))
    assert corpus.tags == (("AT", "NN-TL"), ("AT", "CD"))


def test_word_groups_join_to_words_tagged_by_their_last_group(tmp_path: Path) -> None:
    rows = [
        ("1", "Açık", "NOUN", "ig"),
        ("2", "la", "VERB", "ig"),
        ("3", "yan", "ADJ", "rcmod"),
        ("4", ".", "PUNCT", "p"),
    ]
    text = "".join(f"{n}\t{form}\t_\t{tag}\t_\t_\t0\t{relation}\t_\t_\n" for n, form, tag, relation in rows)
    corpus = read_word_groups(write(tmp_path, "# id\n" + text))
    assert corpus.words == (("Açıklayan", "."),)
    assert corpus.tags == (("ADJ", "PUNCT"),)
    with pytest.raises(InputError, match=r"file.txt:3: the sentence ends within the word 'Açıkla'"):
        read_word_groups(write(tmp_path, "".join(text.splitlines(keepends=True)[:2])))


def test_dictionaries(tmp_path: Path) -> None:
    tabbed = read_dictionary(write(tmp_path, "iray\tnoun\niray\tadjective\nny be\tarticle\n"))
    assert tabbed == {"iray": frozenset({"noun", "adjective"}), "ny be": frozenset({"article"})}
    assert read_dictionary(write(tmp_path, "@:|: Ary|CONJ\n\nAry|ADV")) == {"@:": {":"}, "Ary": {"CONJ", "ADV"}}
    letters = read_letter_dictionary(write(tmp_path, "**MP**RN\tV\nrun\tVN\nbooks\tNnot\nodd\tnull\n"))
    assert letters == {"run": {"V", "N"}, "books": {"N"}}


def test_tokenised_lines_and_raw_files(tmp_path: Path) -> None:
    path = write(tmp_path, "a b\n\n c\n")
    assert read_tokenised(path) == (("a", "b"), ("c",))
    assert read_raw(path, style="tweets").paths == (path,)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"", "file.txt: the file is empty"),
        (b"\n \n", "file.txt: the file is empty"),
        (b"a\tN\nb\n", "file.txt:2: found one column; expected token<TAB>tag"),
        (b"a N\n", "file.txt:1: found one column"),
        (b"a\tN\tx\n", "file.txt:1: found 3 columns"),
        (b"a\tN\n\tV\n", "file.txt:2: the label 'V' has no word"),
        (b"a\t\n", "file.txt:1: the word 'a' has no label"),
        (b"a\tN\ncaf\xe9\tN\n", "file.txt:2: byte 0xe9 is not UTF-8"),
        ("a\tN\n".encode("utf-16"), "file.txt:1: byte 0xff is not UTF-8"),
        (b"a\tN\nb\0\tN\n", "file.txt:2: found a NUL character"),
        (CONLLU.encode() + b"2\tb\tN\n", "file.txt:10: found 3 columns; expected the 10 of CoNLL-U"),
        (CONLLU.replace("3\tmar", "x\tmar").encode(), "file.txt:7: the first column is 'x'"),
        (gzip.compress(CONLLU.encode())[:-20], "file.txt: cannot be read .*cut short"),
    ],
)
def test_bad_labelled_input_is_named_by_file_and_line(tmp_path: Path, content: bytes, message: str) -> None:
    with pytest.raises(InputError, match=message):
        read_labelled(write(tmp_path, content))


def test_other_bad_input(tmp_path: Path) -> None:
    path = write(tmp_path, "a|N b\n")
    with pytest.raises(InputError, match=r"file.txt:1: 'b' has no tag; expected word\|tag"):
        read_pairs(path)
    with pytest.raises(InputError, match=r"file.txt:1: the label 'N' has no word"):
        read_dictionary(write(tmp_path, "|N"))
    with pytest.raises(InputError, match="nowhere: no such file"):
        read_labelled(tmp_path / "nowhere")
    with pytest.raises(InputError, match="expected ca01 to cr09"):
        read_brown(tmp_path)
    with pytest.raises(InputError, match="no file named"):
        read_raw()
    with pytest.raises(InputError, match="the file is empty"):
        read_raw(write(tmp_path, b""))
