import pytest

from predplan.inspection.markdown import cell, escape, viewable


@pytest.mark.parametrize(
    ("text", "shown"),
    [("a|b", "a\\|b"), ("*x*", "\\*x\\*"), ("# 1.", "\\# 1\\."), ("two\nlines", "two lines"), ("işçi Ωж", "işçi Ωж")],
)
def test_words_are_shown_as_they_stand(text: str, shown: str) -> None:
    assert escape(text) == shown


def test_what_the_viewer_cannot_draw_is_a_code_point() -> None:
    assert viewable("a》😂\ufe0f日") == "a‹300B›‹1F602›‹FE0F›‹65E5›"


def test_values_are_short() -> None:
    assert [cell(value) for value in (None, True, 0.123456, 12345, [1, 2])] == ["–", "yes", "0.1235", "12,345", "1 2"]
    assert cell(list(range(100))).endswith("13 …")
