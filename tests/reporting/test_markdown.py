from predplan.reporting.document import Cell, Figure, Items, Section, Table, Tagged, TaggedWord, Text
from predplan.reporting.markdown import all_figures, to_markdown

WORDS = (TaggedWord("a_b", "NOUN", "VERB"), TaggedWord("c", "_", "X"), TaggedWord("d", "DET", "DET"))
SECTION = Section(
    "Top",
    (
        Text("Words."),
        Items((("One.", "first"), ("Two.", "second"))),
        Table(("Method", "150"), (("Group",), ("a|b", Cell("84.3", "84–85", "84.0", best=True))), "Caption."),
    ),
    (
        Section(
            "Inner", (Figure("drawing", "<svg/>", "What it shows. And how."), Tagged(((("HMM", WORDS),),), "Seen."))
        ),
    ),
)


def test_whole_document() -> None:
    assert to_markdown(SECTION, "figures") == (
        "# Top\n\nWords.\n\n1. **One.** first\n2. **Two.** second\n\n"
        "| Method | 150 |\n| --- | ---: |\n| *Group* |  |\n| a\\|b | **84.3** (84–85) [thesis 84.0] |\n\n*Caption.*\n\n"
        "## Inner\n\n![What it shows](figures/drawing.svg)\n\n*What it shows. And how.*\n\n"
        "*Seen.*\n\n- HMM: **a\\_b**/~~VERB~~ **NOUN** c/X d/DET\n"
    )


def test_figures_of_all_sections() -> None:
    assert [figure.name for figure in all_figures(SECTION)] == ["drawing"]
