"""Sentences drawn from a small hidden Markov model whose words show their tag by their endings, some of them."""

from pathlib import Path

import numpy as np

from predplan.labelling.sentences import LabelledCorpus

TAGS = ("NOUN", "VERB", "DET", "odd")
START = np.array([0.1, 0.1, 0.7, 0.1])
BETWEEN = np.array([[0.1, 0.6, 0.1, 0.2], [0.2, 0.05, 0.6, 0.15], [0.9, 0.04, 0.01, 0.05], [0.1, 0.3, 0.5, 0.1]])
STOP = 0.12
SHARED = ("light", "run", "cut")
FORMS = (
    (*(f"{consonant}{vowel}tion" for consonant in "bd" for vowel in "aeiou"), *SHARED, "cat", "dog", "sun"),
    (*(f"{consonant}{vowel}ing" for consonant in "gm" for vowel in "aeiou"), *SHARED, "is", "has"),
    ("the", "a", "this"),
    ("!", "?", ","),
)


def draw_corpus(sentences: int, seed: int) -> LabelledCorpus:
    """Sentences with the tags they were drawn from."""
    rng = np.random.default_rng(seed)
    emissions = [1.0 / (1.0 + np.arange(len(forms))) for forms in FORMS]
    words, tags = [], []
    for _ in range(sentences):
        tag = int(rng.choice(len(TAGS), p=START))
        path = [tag]
        while rng.random() > STOP and len(path) < 20:
            tag = int(rng.choice(len(TAGS), p=BETWEEN[tag]))
            path.append(tag)
        words.append(tuple(FORMS[of][rng.choice(len(FORMS[of]), p=emissions[of] / emissions[of].sum())] for of in path))
        tags.append(tuple(TAGS[of] for of in path))
    return LabelledCorpus(tuple(words), tuple(tags))


def write_raw(path: Path, corpus: LabelledCorpus) -> Path:
    """One sentence a line."""
    path.write_text("".join(" ".join(words) + "\n" for words in corpus.words), encoding="utf-8")
    return path


def write_labelled(path: Path, corpus: LabelledCorpus) -> Path:
    """Two columns."""
    sentences = (
        "".join(f"{word}\t{tag or '_'}\n" for word, tag in zip(words, tags, strict=True))
        for words, tags in zip(corpus.words, corpus.tags, strict=True)
    )
    path.write_text("\n".join(sentences), encoding="utf-8")
    return path
