"""Tokens of tweets by the rules of the CMU tokeniser, one run of non-space characters (a chunk) at a time.

The rules are those of Owoputi et al. 2013 (Twokenize). First, quotes and brackets at the edge of a word are parted from
it. Then these are kept whole: hearts, URLs, e-mail addresses, times, numbers, emoticons, arrows, runs of punctuation,
abbreviations, dashes, symbols, words with an apostrophe within, hashtags and mentions. What lies between is a token.
"""

from __future__ import annotations

import html
import re
import string
from functools import lru_cache

import numpy as np

from predplan.labelling.chunks import Bytes, Places, compiled

MENTION, URL, EMAIL = "@USER", "http://url", "email@example.com"

_EDGE = r"['\"“”‘’«»{}()\[\]*&]+"
_EDGES = re.compile(rf"(?<![^:;.,])({_EDGE})(?=[a-zA-Z0-9])|(?<=[a-zA-Z0-9])({_EDGE})(?![^:;.,])")

_HEART = r"(?:<+/?3+)+"
_GENERIC = "com|org|edu|gov|net|mil|info|biz|name|mobi|asia|jobs|museum|travel|xxx|pro|tel|int|cat|coop|aero"
_COUNTRY = (
    "ar|at|au|be|br|ca|cc|ch|cl|cn|co|cz|de|dk|es|eu|fi|fm|fr|gd|gl|gr|hk|hu|id|ie|il|im|in|io|ir|is|it|jp|kr|ly|me|"
    "mp|mx|my|nl|no|nu|nz|ph|pk|pl|pt|ro|ru|se|sg|sh|sk|st|tk|to|tr|tv|tw|ua|uk|us|vn|ws|za"
)
_DOMAIN = rf"[A-Za-z\d-]+(?:\.[A-Za-z0-9]+){{0,3}}\.(?:{_GENERIC}|{_COUNTRY})(?:\.(?:{_COUNTRY}))?(?!\w)"
_URL = rf"(?:https?://|\bwww\.|\b{_DOMAIN})(?:[^.<>][^<>]*?)?(?=['\"“”‘’.?!…,:;]*(?:\.\.|[<>]|$))"
_EMAIL = r"(?:(?<=\W)|^)[\w.%+-]+@[a-zA-Z0-9.-]+\.[a-zA-Z]{2,4}(?!\w)"
_TIME = r"\d+(?::\d+){1,2}"
_NUMBER = r"(?<!\d)\d{1,3}(?:,\d{3})+(?![,\d])|[$£€¥¢₹]?\d+(?:\.\d+)+%?"

_MOUTH = r"(?:(?:[pPd3]+|[oO]+|[/\\]+|[vV]+|[sS]+|\|+)(?=\W|$|[Rr][Tt])|[(\[{]+|[D)\]}]+)"
_FACE = rf">?[:=;](?:[oO]|[^a-zA-Z0-9 ])??{_MOUTH}"
_MIRRORED = r"^(?:[(\[{]+|[D)\]}]+|[oO]+|[/\\]+|[vV]+|[sS]+|\|+)[^a-zA-Z0-9]?[:=;]<?"
_EYES = "|".join(rf"{re.escape(eye)}(?:\.|[_-]+){re.escape(eye)}" for eye in "♥0°$;ಠ@ʘ•・◕^¬*oOvVtTxX")
_WIDE = rf"(?:{_EYES}|[oO](?:\.|[_-]+)[oO]|--['\"]|[<>][._-]+[<>]|\._+\.)"
_EASTERN = rf"[＼\\ƪԄ(（<>;ヽ=~*-]+(?:{_WIDE}|[^A-Za-z0-9()*:=-])+[-=);'\"<>ʃ）/／ノﾉ丿╯σっµ~*]+"
_EMOTICON = rf"{_FACE}|{_MIRRORED}|{_EASTERN}|{_WIDE}"

_ARROW = r"<*[-―—=]*>+|<+[-―—=]*>*|[\u2190-\u21ff]+"
_PUNCTUATION = r"['\"“”‘’]+|[.?!,…]+|[:;]+"
_INITIALS = r"(?:(?:[A-Za-z]\.){2,}|(?:^|[^A-Za-z])(?:[A-Za-z]\.)+[A-Za-z])(?=[“\"?!,:;]|$)"
_TITLE = r"\b(?:[MDSJmdsj]r|[Mm]rs|[Mm]s|[Rr]ep|[Ss]en|[Ss]t)\."
_DASH = "--+|[―—~–=]"
_SYMBOL = r"[♫♪]+|[★☆]+|[♥❤♡]+|[\u2639-\u263b]+|[\ue001-\uebbb]+"
_WITHIN = r"[^.,?\"][^.,?\"'’′]*+['’′][^.,?\"]*+"
_NAME = r"#\w+|[@＠][a-zA-Z0-9_]+"

# At one place the first that matches wins. Parted by what may start with a letter or digit, for speed.
_WHOLE = re.compile(
    f"((?=[a-zA-Z0-9])(?:{_URL}|{_EMAIL}|{_TIME}|{_NUMBER}|{_MIRRORED}|{_WIDE}|{_INITIALS}|{_TITLE}|{_WITHIN})|"
    f"(?![a-zA-Z0-9])(?:{_HEART}|{_EMAIL}|{_NUMBER}|{_EMOTICON}|{_ARROW}|{_PUNCTUATION}|{_INITIALS}|{_DASH}|{_SYMBOL}|"
    f"{_WITHIN}|{_NAME}))"
)
# Kinds of bytes in plain chunks.
_EYE, _LETTER, _DIGIT, _PAUSE, _COLON, _OTHER = range(6)
_KINDS = np.full(256, _OTHER)
for _kind, _characters in (
    (_LETTER, string.ascii_letters), (_EYE, "DoOvVsS"), (_DIGIT, string.digits), (_PAUSE, ".!?,"), (_COLON, ":;"),
):  # fmt: skip
    _KINDS[list(_characters.encode())] = _kind
_HASH = ord("#")

_FORMS = re.compile(
    rf"(?P<mention>[@＠][a-zA-Z0-9_]+)|(?P<email>{_EMAIL})|"
    rf"(?P<url>(?:https?://|www\.)\S+|[A-Za-z\d.-]+\.(?:{_GENERIC})(?:\.\w\w)?(?:[/?:]\S*)?|{_DOMAIN}/\S*)|"
    r"(?P<eyes>[:=;])[-^'o]?(?P<mouth>[][(){}DPpdoOsS/\\|3])(?P=mouth)*"
)


@lru_cache(1 << 17)  # a fifth of a block's unusual chunks have been in one before
def tokenise_chunk(chunk: str) -> tuple[str, ...]:
    """The normalised tokens of one run of characters; white space within it (an odd Unicode one) parts tokens too."""
    if "&" in chunk:
        chunk = html.unescape(chunk)
    parted = " ".join(_EDGES.sub(_part_edge, run) for run in chunk.split())
    return tuple(normalise(token) for piece in parted.split() for token in _WHOLE.split(piece) if token)


@compiled
def plain_ends(text: Bytes, starts: Places, ends: Places) -> Places:
    """Where the word of each plain chunk text[starts[i]:ends[i]] ends; -1 for other chunks.

    Plain are a word and a hashtag of ASCII letters and digits, alone or before punctuation: then `tokenise_chunk` gives
    the word and the punctuation. Titles (Mrs.) have fewer than four letters, and OO: is a face.
    """
    found = np.full(starts.size, -1, np.int32)
    for i in range(starts.size):
        hashtag = text[starts[i]] == _HASH
        first = starts[i] + hashtag
        end, widest = first, 0
        while end < ends[i] and _KINDS[text[end]] <= _DIGIT:
            widest = max(widest, _KINDS[text[end]])
            end += 1
        after = end
        while after < ends[i] and _KINDS[text[after]] == _PAUSE:
            after += 1
        face = False
        if after == end and after + 1 == ends[i] and _KINDS[text[after]] == _COLON:
            after += 1
            face = widest == _EYE
        ends_well = after == end or (hashtag and end > first) or (end - first >= 4 and widest <= _LETTER and not face)
        if end > first and after == ends[i] and ends_well:
            found[i] = end
    return found


def normalise(word: str) -> str:
    """The form under which a token is counted: mentions, URLs and e-mail addresses become one form each.

    A sideways emoticon loses its nose and repeated mouths, and its eyes `=` become `:`; HTML entities become what they
    stand for. Labelled words pass through this too, so that they meet their raw counterparts.
    """
    if word.isalnum():
        return word
    if "&" in word:
        word = html.unescape(word)
    form = _FORMS.fullmatch(word)
    if form is None:
        return word
    if form["eyes"]:
        return form["eyes"].replace("=", ":") + form["mouth"]
    return MENTION if form["mention"] else EMAIL if form["email"] else URL


def _part_edge(edge: re.Match[str]) -> str:
    return f"{edge[1]} " if edge[1] else f" {edge[2]}"
