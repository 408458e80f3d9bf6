"""A report as Markdown with its figures in files beside it."""

from __future__ import annotations

from collections.abc import Iterator

from predplan.reporting.document import Block, Cell, Figure, Items, Section, Table, Tagged, TaggedWord, Text


def to_markdown(section: Section, figures: str) -> str:
    """The section as Markdown; figures are linked as `figures`/NAME.svg."""
    return "\n\n".join(_section(section, figures, 1)) + "\n"


def all_figures(section: Section) -> Iterator[Figure]:
    """The figures of a section and of those in it, in order."""
    for block in section.blocks:
        if isinstance(block, Figure):
            yield block
    for inner in section.sections:
        yield from all_figures(inner)


def _section(section: Section, figures: str, level: int) -> Iterator[str]:
    yield f"{'#' * level} {section.title}"
    for block in section.blocks:
        yield _block(block, figures)
    for inner in section.sections:
        yield from _section(inner, figures, level + 1)


def _block(block: Block, figures: str) -> str:
    match block:
        case Text(text):
            return text
        case Items(items):
            return "\n".join(f"{number}. **{name}** {text}" for number, (name, text) in enumerate(items, start=1))
        case Table():
            return _table(block)
        case Figure(name, _, caption):
            return f"![{caption.split('. ')[0]}]({figures}/{name}.svg)\n\n*{caption}*"
        case Tagged(sentences, caption):
            shown = "\n\n".join("\n".join(f"- {by}: {_words(words)}" for by, words in each) for each in sentences)
            return f"*{caption}*\n\n{shown}"


def _table(table: Table) -> str:
    width = len(table.header)
    lines = [table.header, ("---", *["---:"] * (width - 1))]
    for row in table.rows:
        cells = [_cell(cell) for cell in row]
        lines.append((f"*{cells[0]}*", *[""] * (width - 1)) if len(row) == 1 else tuple(cells))
    body = "\n".join("| " + " | ".join(cells) + " |" for cells in lines)
    return f"{body}\n\n*{table.caption}*"


def _cell(cell: str | Cell) -> str:
    if isinstance(cell, str):
        return cell.replace("|", "\\|")
    value = f"**{cell.value}**" if cell.best else cell.value
    spread = f" ({cell.spread})" if cell.spread else ""
    return value + spread + (f" [thesis {cell.published}]" if cell.published else "")


def _words(words: tuple[TaggedWord, ...]) -> str:
    return " ".join(_word(each) for each in words)


def _word(each: TaggedWord) -> str:
    word = "".join(f"\\{letter}" if letter in "\\`*_{}[]<>#+!|~" else letter for letter in each.word)
    return f"**{word}**/~~{each.predicted}~~ **{each.gold}**" if each.wrong else f"{word}/{each.predicted}"
