import re

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from predplan.control.methods import METHODS as CONTROL_METHODS
from predplan.labelling.methods import METHODS
from predplan.palette import METHOD_COLOURS
from predplan.planning.kinds import KINDS
from predplan.planning.methods import methods_of
from predplan.reporting.drawing import drawing_look, inlined, label_ends, new_canvas, spread_out, to_svg


def draw() -> str:
    with drawing_look():
        canvas = new_canvas(2.0)
        axes = canvas.add_subplot()
        axes.plot([0, 1], [0, 1], color="#d55e00")
        axes.fill_between([0, 1], [0, 1], [1, 2], alpha=0.2)
        label_ends(canvas, axes, [(1.0, 1.0, "one", "#d55e00"), (1.0, 1.001, "two", "#d55e00")])
        return to_svg(canvas)


def test_same_drawing_same_bytes() -> None:
    assert draw() == draw()


def test_ink_follows_the_page() -> None:
    svg = draw()
    assert "var(--ink)" in svg
    assert "#010203" not in svg
    assert "prefers-color-scheme:dark" in svg
    assert "<metadata>" not in svg
    assert "DejaVu" not in svg
    assert not re.search(r"\d{4}-\d{2}-\d{2}T", svg)


def test_inlined_leaves_colours_to_the_page() -> None:
    svg = inlined(draw())
    assert svg.startswith("<svg ")
    assert "prefers-color-scheme" not in svg


def test_text_stays_text() -> None:
    assert ">one</text>" in draw()


@given(st.lists(st.floats(0, 100), min_size=1, max_size=9), st.floats(0.1, 10))
def test_places_are_apart_and_in_order(values: list[float], gap: float) -> None:
    rising = np.sort(values)
    places = spread_out(rising, gap, 0.0, 100.0)
    assert (np.diff(places) >= gap - 1e-9).all()
    assert places[0] >= -1e-9
    assert places[-1] <= 100 + 1e-9


def test_places_that_are_apart_stay() -> None:
    np.testing.assert_allclose(spread_out(np.array([1.0, 5.0, 9.0]), 2.0, 0.0, 10.0), [1, 5, 9])


def test_crowded_places_share_the_move() -> None:
    np.testing.assert_allclose(spread_out(np.array([5.0, 5.0, 5.0]), 1.0, 0.0, 10.0), [4, 5, 6])


def test_every_method_has_a_colour() -> None:
    planning = {method.name for kind in KINDS for method in methods_of(kind)}
    assert METHOD_COLOURS.keys() >= METHODS.keys() | planning | CONTROL_METHODS.keys()
