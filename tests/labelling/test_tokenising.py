"""Tokenising: hand-written tweets, laws of blocks, malformed lines, and Oct27's gold tokens where they are at hand."""

import gzip
import os
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from predplan.errors import InputError
from predplan.labelling import chunks, tweets
from predplan.labelling.chunks import Spans, split_chunks
from predplan.labelling.languages import keep_language
from predplan.labelling.readers import Style, read_labelled, read_raw
from predplan.labelling.sentences import LabelledCorpus, TokenBatch
from predplan.labelling.tokenising import LONGEST_LINE, LineReport, normalise, read_blocks, tokenise, tokenise_block

TWEETS = [
    ("hello (@jo_1)! see http://t.co/a,b?c=1.", "hello ( @USER ) ! see http://url ."),
    ("don't you're rock'n'roll 'quoted' dogs'", "don't you're rock'n'roll ' quoted ' dogs '"),
    ("#tag: (#other) #été...wow", "#tag : ( #other ) #été ... wow"),
    ("RT @USER: I'm @work 12:30, U.S. 3.5% $2,000 10,000.", "RT @USER : I'm @USER 12:30 , U.S. 3.5% $ 2,000 10,000 ."),
    (":) :-) =D ;-P :'( <3 <33 o_O -__- ^_^ (: xD", ":) :) :D ;P :( <3 <33 o_O -__- ^_^ (: xD"),
    ("haha!!! what?!.. no... Mr. Smith vs. e.g.", "haha !!! what ?!.. no ... Mr. Smith vs . e.g."),
    ("me@mail.example.com google.com www.x.org/y bit.ly/ab", "email@example.com http://url http://url http://url"),
    ("&lt;3 you &amp; me -- A&B ♥♥ → ~ well-known", "<3 you & me -- A&B ♥♥ → ~ well-known"),
    ("“smart quotes” ‘here’ [sic] *bold*", "“ smart quotes ” ‘ here ’ [ sic ] * bold *"),
    ("Mrs. Jones DDDD: word: (aside):", "Mrs. Jones DDDD: word : ( aside ):"),
]
MIRROR = Path(os.environ.get("PREDPLAN_MIRROR", Path(__file__).parents[3] / "shared" / "data"))
OCT27 = MIRROR / "twitter-pos" / "oct27.conll"

LINES = st.text(st.sampled_from("abcXY019'.,:;!?()@#/-_=&<>*\"“é♥ツ \t\r\v\x1c\x85\xa0\u2003"), max_size=30)
STYLES = st.sampled_from(("spaces", "tweets"))
UNHURRIED = settings(deadline=None)  # the first example compiles


def sentences(batch: TokenBatch) -> list[list[str]]:
    bounds = zip(batch.offsets[:-1], batch.offsets[1:], strict=True)
    return [[batch.vocabulary[i] for i in batch.ids[start:end]] for start, end in bounds]


@pytest.mark.parametrize(("text", "tokens"), TWEETS)
def test_tweets_as_the_cmu_tokeniser_parts_them(text: str, tokens: str) -> None:
    assert tokenise(text, "tweets") == tokens.split(" ")


def test_gold_tokens_joined_by_spaces_are_found_again() -> None:
    gold = [word for _, tokens in TWEETS for word in tokens.split()]
    corpora = [gold] + ([[w for words in read_labelled(OCT27).words for w in words]] if OCT27.exists() else [])
    for words in corpora:
        found = sum(tokenise(word, "tweets") == [tweets.normalise(word)] for word in words)
        assert found / len(words) >= 0.99


def test_labelled_words_take_the_form_of_raw_ones() -> None:
    corpus = LabelledCorpus((("@jo", "http://t.co/a", ":-))", "AT&amp;T", "word", "to.be"),), ((None,) * 6,))
    assert normalise(corpus, "tweets").words == (("@USER", "http://url", ":)", "AT&T", "word", "to.be"),)
    assert normalise(corpus, "spaces") == corpus


@UNHURRIED
@given(st.lists(LINES, max_size=8), STYLES)
def test_a_block_is_its_lines_tokenised_one_by_one(lines: list[str], style: Style) -> None:
    batch, report = tokenise_block("\n".join(lines).encode(), style)
    expected = [tokens for tokens in (tokenise(line, style) for line in lines) if tokens]
    assert sentences(batch) == expected
    assert (report.tokens, report.malformed) == (sum(map(len, expected)), 0)
    assert (batch.ids.dtype.name, batch.offsets.dtype.name) == ("int32", "int64")
    assert len(set(batch.vocabulary)) == len(batch.vocabulary) == len(set(batch.ids.tolist()))


@UNHURRIED
@given(st.text(st.sampled_from("aDoOsV9#.,!:;'…é"), min_size=1, max_size=8))
def test_a_plain_chunk_is_cut_where_the_rules_part_it(chunk: str) -> None:
    spans = Spans.of([chunk])
    (end,) = tweets.plain_ends(spans.text, spans.starts, spans.ends).tolist()
    if end >= 0:
        assert tweets.tokenise_chunk(chunk) == tuple(filter(None, (chunk[:end], chunk[end:])))


@pytest.mark.parametrize("chunk", ["word", "a", "1st", "#tag", "#1", "word!?..", "word,", "word:", "#OO;", "#1,"])
def test_common_chunks_are_plain(chunk: str) -> None:
    spans = Spans.of([chunk])
    assert tweets.plain_ends(spans.text, spans.starts, spans.ends).tolist() == [len(chunk.rstrip(".,!?:;"))]


@UNHURRIED
@given(LINES)
def test_normal_forms_and_tokens_are_stable(line: str) -> None:
    tokens = tokenise(line, "tweets")
    assert "".join(tokens).split() == (["".join(tokens)] if tokens else [])
    assert [tweets.normalise(tweets.normalise(token)) for token in tokens] == list(map(tweets.normalise, tokens))


@UNHURRIED
@given(st.lists(st.tuples(LINES, st.sampled_from(["", "nul", "bad_utf8", "too_long"])), max_size=6), STYLES)
def test_malformed_lines_are_dropped_and_counted(lines: list[tuple[str, str]], style: Style) -> None:
    spoil = {"": b"", "nul": b"\0", "bad_utf8": b"\xff", "too_long": b"x" * (LONGEST_LINE + 1)}
    block = b"".join(line.encode() + spoil[kind] + b"\n" for line, kind in lines)
    batch, report = tokenise_block(block, style)
    kinds = [kind for _, kind in lines]
    counted = LineReport(len(lines), len(batch.ids), *(kinds.count(kind) for kind in ("bad_utf8", "nul", "too_long")))
    assert report == counted
    kept = [tokenise(line, style) for line, kind in lines if not kind]
    assert sentences(batch) == [tokens for tokens in kept if tokens]


@UNHURRIED
@given(st.lists(st.text(st.sampled_from("ab\n é😘"), max_size=12)), st.data())
def test_spans_are_found_by_their_bytes(words: list[str], data: st.DataObject) -> None:
    spans = Spans.of(words)
    assert (len(spans), spans.decode()) == (len(words), words)
    distinct, ids = spans.distinct()
    assert distinct.decode() == list(dict.fromkeys(words))
    assert [distinct.decode()[i] for i in ids] == words
    assert (spans + distinct).decode() == words + distinct.decode()
    some = np.array(data.draw(st.permutations(range(len(words)))), np.int64)
    assert spans[some].decode() == [words[i] for i in some]


def test_equal_keys_do_not_make_long_spans_equal(monkeypatch: pytest.MonkeyPatch) -> None:
    words = ["long enough 1", "long enough 2", "long enough 1", "longer than enough"]
    monkeypatch.setattr(chunks, "_keys", lambda text, starts, ends: np.full(len(starts), 1 << 63, np.uint64))
    distinct, ids = Spans.of(words).distinct()
    assert (distinct.decode(), ids.tolist()) == ([words[0], words[1], words[3]], [0, 1, 0, 2])


def test_many_distinct_chunks_survive_the_growth_of_their_table() -> None:
    words = [f"w{i % 70_000}" for i in range(100_000)]
    text = split_chunks(" ".join(words).encode())
    distinct = text.distinct.decode()
    assert [distinct[i] for i in text.ids] == words
    assert distinct == words[:70_000]


def test_blocks_end_with_lines_and_lose_nothing(tmp_path: Path) -> None:
    text = "".join(f"line {i} é\n" for i in range(500)) + "the last has no newline"
    (tmp_path / "a.gz").write_bytes(gzip.compress(text.encode()))
    (tmp_path / "b.txt").write_text("other file")
    blocks = list(read_blocks(read_raw(tmp_path / "a.gz", tmp_path / "b.txt"), block_bytes=100))
    assert b"".join(blocks) == text.encode() + b"other file"
    assert all(block.endswith(b"\n") for block in blocks[:-2])
    parts = [tokenise_block(block, "spaces") for block in blocks]
    whole, _ = tokenise_block(text.encode() + b"\nother file", "spaces")
    assert [sentence for batch, _ in parts for sentence in sentences(batch)] == sentences(whole)


def test_an_endless_line_is_cut_in_memory_and_counted(tmp_path: Path) -> None:
    (tmp_path / "raw.txt").write_bytes(b"fine\n" + b"x" * (12 * LONGEST_LINE) + b" tail\nalso fine\n")
    blocks = list(read_blocks(read_raw(tmp_path / "raw.txt"), block_bytes=LONGEST_LINE))
    assert max(map(len, blocks)) < 6 * LONGEST_LINE
    report = sum((tokenise_block(block, "spaces")[1] for block in blocks), LineReport())
    assert report == LineReport(lines=3, tokens=3, too_long=1)


def test_raw_text_that_is_cut_short_is_said_to_be(tmp_path: Path) -> None:
    (tmp_path / "raw.gz").write_bytes(gzip.compress(os.urandom(5000))[:-100])
    with pytest.raises(InputError, match=r"raw.gz: cannot be read .*cut short"):
        list(read_blocks(read_raw(tmp_path / "raw.gz")))


def test_entities_escaped_twice_may_leave_white_space_in_a_token() -> None:
    chunk = "a&amp;#32;b&amp;#10;"
    batch, _ = tokenise_block(f"{chunk} {chunk}".encode(), "tweets")
    assert sentences(batch) == [list(tweets.tokenise_chunk(chunk)) * 2]


def test_a_byte_order_mark_is_no_token() -> None:
    batch, _ = tokenise_block("\ufeffword\n".encode(), "spaces")
    assert batch.vocabulary == ("word",)


def test_lines_of_another_language_are_left_out() -> None:
    english = b"the weather is lovely this afternoon"
    french = "il fait très beau cet après-midi à la plage".encode()
    assert list(keep_language([english, french, b"ok"])) == [english, b"ok"]
    assert list(keep_language([english, french], ("fr",))) == [french]
    malformed = [b"b\xffd", b"a\0b", b"x" * (LONGEST_LINE + 1)]
    assert list(keep_language(malformed)) == malformed
    with pytest.raises(InputError, match="xx not known"):
        keep_language([], ("xx",))
