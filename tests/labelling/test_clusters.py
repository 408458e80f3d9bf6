from pathlib import Path

import numpy as np
import pytest
from scipy import sparse

from predplan.errors import InputError
from predplan.labelling.clusters import learn_clusters, read_cluster_paths
from predplan.labelling.moments import ContextMoments
from predplan.labelling.training import RawStatistics


def statistics(dimension: int = 3) -> RawStatistics:
    """Words in four tight groups of ten; the last word is rare."""
    rng = np.random.default_rng(0)
    centres = np.repeat(np.eye(4, 3) * 5 + np.arange(4)[:, None], 10, axis=0)
    vectors = centres + 0.01 * rng.normal(size=centres.shape)
    words = tuple(f"w{number}" for number in range(40))
    count = np.array([100] * 39 + [1])
    moments = ContextMoments(words, count, ("a", "b", "c"), sparse.csr_array(np.hstack([vectors, vectors])))
    projection = np.vstack([np.eye(3, dimension), np.zeros((3, dimension))])
    return RawStatistics(moments, projection)


def test_clusters_are_the_groups_at_each_size() -> None:
    clusters = learn_clusters(statistics(), sizes=(4, 8), least_count=10)
    assert len(clusters) == 39
    assert "w39" not in clusters
    groups = [{clusters[f"w{number}"][0] for number in range(first, min(first + 10, 39))} for first in (0, 10, 20, 30)]
    assert all(len(group) == 1 for group in groups)
    assert len(set.union(*groups)) == 4
    assert all(names[0].startswith("k4=") and names[1].startswith("k8=") for names in clusters.values())


def test_the_same_seed_gives_the_same_clusters() -> None:
    assert learn_clusters(statistics(), (4, 8), seed=3) == learn_clusters(statistics(), (4, 8), seed=3)


def test_sizes_beyond_the_words_are_left_out() -> None:
    assert {len(names) for names in learn_clusters(statistics(), (4, 512)).values()} == {1}
    assert learn_clusters(statistics(), (512,)) == {}


def test_words_without_vectors_are_refused() -> None:
    with pytest.raises(InputError, match=r"moments\.vectors"):
        learn_clusters(statistics(dimension=0))


def test_paths_are_cut_to_prefixes(tmp_path: Path) -> None:
    path = tmp_path / "paths"
    path.write_text("0110101\tthe\t12\n01\tof\t7\n")
    clusters = read_cluster_paths(path)
    assert clusters["the"][:4] == ("path2=01", "path4=0110", "path6=011010", "path8=0110101")
    assert set(clusters["of"]) == {f"path{length}=01" for length in (2, 4, 6, 8, 10, 12, 16)}


@pytest.mark.parametrize("line", ["0110 the 12", "012\tthe\t12", "0110\tthe", "0110\tthe\tmany", "\tthe\t1"])
def test_lines_of_another_form_are_named(tmp_path: Path, line: str) -> None:
    path = tmp_path / "paths"
    path.write_text(f"01\ta\t1\n{line}\n")
    with pytest.raises(InputError, match=r"paths:2: .*expected bit path"):
        read_cluster_paths(path)
