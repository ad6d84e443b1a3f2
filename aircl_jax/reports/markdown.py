"""Markdown: tables, lists and paragraphs, as every report writes them."""

import unicodedata
from collections.abc import Iterable, Sequence


def table(header: Sequence[object], rows: Iterable[Sequence[object]], aligned: bool = False) -> str:
    """Write a head and its rows; `aligned` pads every column to one width, for a terminal.

    Raises ValueError for a row of another length.
    """
    cells = [[_cell(item) for item in row] for row in (header, *rows)]
    for one in cells:
        if len(one) != len(header):
            raise ValueError(f"a row of {len(one)} cells under a head of {len(header)}: {' | '.join(one)}")
    dashes = ["---"] * len(header)
    if aligned:
        widths = [max(map(_width, column)) for column in zip(*cells, strict=True)]
        cells = [[cell + " " * (width - _width(cell)) for cell, width in zip(one, widths, strict=True)] for one in cells]
        dashes = ["-" * (width + 2) for width in widths]
    head, *body = map(_joined, cells)
    return "\n".join([head, f"|{'|'.join(dashes)}|", *body])


def row(items: Sequence[object]) -> str:
    """Write one line of a table: what a command adds to a table as it goes along."""
    return _joined([_cell(item) for item in items])


def bullets(lines: Iterable[str]) -> str:
    return "\n".join(f"- {line}" for line in lines)


def paragraphs(*parts: str) -> str:
    """Set the parts apart by empty lines, as a whole file."""
    return "\n\n".join(parts) + "\n"


def _cell(item: object) -> str:
    """A bar or a new line within a cell would end it, and a pair of dollars be a formula."""
    return " ".join(str(item).splitlines()).replace("|", "\\|").replace("$", "\\$")


def _joined(cells: Sequence[str]) -> str:
    return "|" + "".join(f" {cell} |" if cell else " |" for cell in cells)


def _width(text: str) -> int:
    """Columns on a terminal: the bar of δ̄ takes none."""
    return sum(not unicodedata.combining(letter) for letter in text)
