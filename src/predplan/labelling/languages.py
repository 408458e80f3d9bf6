"""Keeping the lines of one language, by py3langid (a naive Bayes over byte n-grams)."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

from py3langid.langid import MODEL_FILE, LanguageIdentifier

from predplan.errors import InputError
from predplan.labelling.tokenising import is_malformed

ENGLISH = ("en", "pcm")  # Nigerian Pidgin too: short English tweets are often taken for it
DOUBTFUL = 0.25


def keep_language(
    lines: Iterable[bytes], languages: tuple[str, ...] = ENGLISH, doubtful: float = DOUBTFUL
) -> Iterator[bytes]:
    """The lines labelled with one of `languages` (ISO 639 codes), or with any under the probability `doubtful`.

    Short lines are seldom certain, so a doubtful label does not condemn them. Malformed lines stay, for the tokeniser
    to drop and count. Raises InputError for an unknown code.
    """
    identifier = LanguageIdentifier.from_model_file(MODEL_FILE, norm_probs=True)
    unknown = sorted(set(languages) - set(identifier.labels))
    if unknown:
        known = ", ".join(sorted(identifier.labels))
        raise InputError(f"languages: {', '.join(unknown)} not known; expected codes among {known}")

    def kept(line: bytes) -> bool:
        if is_malformed(line):
            return True
        language, probability = identifier.classify(line.decode())
        return language in languages or probability < doubtful

    return filter(kept, lines)
