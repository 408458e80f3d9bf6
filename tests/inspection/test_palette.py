from itertools import combinations

import pytest

from predplan.inspection.palette import BACKGROUND, method_colour, rgb

CURVES = ("supervised", "supervised-fhmm", "crf", "anchor", "anchor-fhmm", "crf-posteriors", "crf-clusters", "em")


def test_a_colour_follows_from_the_name() -> None:
    assert method_colour("anchor") == method_colour("anchor HMM")
    assert method_colour("crf-clusters-posteriors") == method_colour("CRF + posteriors + clusters")
    assert method_colour("anchor-lambda0") != method_colour("anchor")


def test_methods_of_one_plot_stay_apart() -> None:
    for first, second in combinations(CURVES, 2):
        assert distance(method_colour(first), method_colour(second)) > 40


@pytest.mark.parametrize("name", [*CURVES, "nearest neighbour", ""])
def test_a_colour_is_seen_on_dark_and_on_white(name: str) -> None:
    assert distance(method_colour(name), BACKGROUND) > 100
    assert distance(method_colour(name), "#ffffff") > 60


def distance(first: str, second: str) -> float:
    return float(sum((a - b) ** 2 for a, b in zip(rgb(first), rgb(second), strict=True)) ** 0.5)
