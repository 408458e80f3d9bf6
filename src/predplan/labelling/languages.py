"""Keeping the lines of one language, by py3langid (a naive Bayes over byte n-grams)."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

from py3langid.langid import MODEL_FILE, LanguageIdentifier

from predplan.errors import InputError

ENGLISH = ("en", "pcm")  # Nigerian Pidgin too: short English tweets are often taken for it
DOUBTFUL = 0.25


def keep_language(
    lines: Iterable[str], languages: tuple[str, ...] = ENGLISH, doubtful: float = DOUBTFUL
) -> Iterator[str]:
    """The lines labelled with one of `languages` (ISO 639 codes), or with any under the probability `doubtful`.

    Short lines are seldom certain, so a doubtful label does not condemn them. Raises InputError for an unknown code.
    """
    identifier = LanguageIdentifier.from_model_file(MODEL_FILE, norm_probs=True)
    unknown = sorted(set(languages) - set(identifier.labels))
    if unknown:
        known = ", ".join(sorted(identifier.labels))
        raise InputError(f"languages: {', '.join(unknown)} not known; expected codes among {known}")
    return (line for line in lines if _kept(identifier.classify(line), languages, doubtful))


def _kept(label: tuple[str, float], languages: tuple[str, ...], doubtful: float) -> bool:
    language, probability = label
    return language in languages or probability < doubtful
