"""Word clusters, as features for the conditional random field: from our own raw text, or from a file of bit paths."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from sklearn.cluster import MiniBatchKMeans

from predplan.errors import InputError
from predplan.labelling.models import Clusters
from predplan.labelling.readers import read_lines
from predplan.labelling.training import RawStatistics

PREFIX_LENGTHS = (2, 4, 6, 8, 10, 12, 16)
SIZES = (32, 128, 512)
BATCH = 4096


def learn_clusters(raw: RawStatistics, sizes: Sequence[int] = SIZES, least_count: int = 2, seed: int = 0) -> Clusters:
    """Clusters of words of at least `least_count` occurrences by k-means over their canonical vectors.

    One clustering for each of `sizes`, independent of the others (fine clusters need not lie within coarse ones);
    word -> names such as `k32=7`, in the order of `sizes`. Sizes at or above the number of words are left out.
    Raises InputError where the raw statistics have no vectors.
    """
    if raw.projection.shape[1] == 0:
        raise InputError("clusters: found words without vectors, expected canonical vectors (moments.vectors above 0)")
    rows = np.flatnonzero(raw.moments.word_count >= least_count)
    vectors = raw.vectors(rows)
    fitting = [size for size in sizes if size < len(rows)]
    labels = [
        MiniBatchKMeans(size, random_state=seed, n_init=3, batch_size=BATCH).fit_predict(vectors) for size in fitting
    ]
    words = [raw.moments.vocabulary[row] for row in rows]
    names = [[f"k{size}={label}" for label in found.tolist()] for size, found in zip(fitting, labels, strict=True)]
    return {word: tuple(own) for word, *own in zip(words, *names, strict=True)} if names else {}


def read_cluster_paths(path: Path | str) -> Clusters:
    """Hierarchical clusters from lines bit path<TAB>word<TAB>count, as the CMU Twitter clusters are published.

    word -> the path's prefixes of 2, 4, 6, 8, 10, 12 and 16 bits, as names such as `path4=0110`; a path shorter than
    that stands whole. Raises InputError with file and line for another form.
    """
    clusters: dict[str, tuple[str, ...]] = {}
    for number, line in enumerate(read_lines(path), 1):
        if not line.strip():
            continue
        bits, _, rest = line.partition("\t")
        word, tab, count = rest.rpartition("\t")
        if not (bits and word and tab and count.isdigit()) or set(bits) - {"0", "1"}:
            raise InputError(f"{path}:{number}: found {line[:80]!r}, expected bit path<TAB>word<TAB>count")
        clusters[word] = tuple(f"path{length}={bits[:length]}" for length in PREFIX_LENGTHS)
    if not clusters:
        raise InputError(f"{path}: no cluster found; expected lines bit path<TAB>word<TAB>count")
    return clusters
