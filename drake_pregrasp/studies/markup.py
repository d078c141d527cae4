"""Pieces of an HTML page; all text is escaped here and nowhere else."""

import base64
import html
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import NamedTuple

from drake_pregrasp.simulation.output import reading_back

NONE = "–"
"""What a cell says where there is no value."""


class Cell(NamedTuple):
    """A cell of a table.

    Attributes:
        text: What it says.
        small: What it says below that, smaller.
        kind: Its CSS class, or several.
        share: Length of a bar behind the text, from 0 to 1; none if not set.
        swatch: Colour of a mark before the text, as hexadecimal RGB; none if empty.
        rows: How many rows it spans.
    """

    text: str
    small: str = ""
    kind: str = ""
    share: float | None = None
    swatch: str = ""
    rows: int = 1


def paragraph(text: str, kind: str = "") -> str:
    """Returns a paragraph."""
    return f"<p{_class(kind)}>{html.escape(text)}</p>"


def heading(text: str, level: int, anchor: str = "") -> str:
    """Returns a heading, which links can lead to if it has an anchor."""
    name = f' id="{html.escape(anchor)}"' if anchor else ""
    return f"<h{level}{name}>{html.escape(text)}</h{level}>"


def bullets(texts: Iterable[str]) -> str:
    """Returns a list."""
    return "<ul>" + "".join(f"<li>{html.escape(text)}</li>" for text in texts) + "</ul>"


def table(head: Sequence[Cell], rows: Iterable[Sequence[Cell]], caption: str) -> str:
    """Returns a table that scrolls by itself where the page is narrow."""
    lines = [
        f'<div class="scroll"><table><caption>{html.escape(caption)}</caption>',
        f"<thead><tr>{''.join(_cell(cell, 'th') for cell in head)}</tr></thead><tbody>",
        *(f"<tr>{''.join(_cell(cell, 'td') for cell in row)}</tr>" for row in rows),
        "</tbody></table></div>",
    ]
    return "\n".join(lines)


def figure(path: Path, caption: str) -> str:
    """Returns a PNG with its caption, inside the page.

    Raises:
        OutputError: If the file can't be read.
    """
    with reading_back(path):
        data = base64.b64encode(path.read_bytes()).decode()
    text = html.escape(caption)
    return (
        f'<figure><img alt="{text}" src="data:image/png;base64,{data}">'
        f"<figcaption>{text}</figcaption></figure>"
    )


def details(summary: str, text: str) -> str:
    """Returns preformatted text that is shown on demand."""
    return (
        f"<details><summary>{html.escape(summary)}</summary>"
        f"<pre>{html.escape(text)}</pre></details>"
    )


def page(title: str, style: str, parts: Iterable[str]) -> str:
    """Returns the page."""
    head = (
        '<!DOCTYPE html><html lang="en"><head><meta charset="utf-8">'
        '<meta name="viewport" content="width=device-width, initial-scale=1">'
        f"<title>{html.escape(title)}</title><style>{style}</style></head><body>"
    )
    return "\n".join([head, *parts, "</body></html>\n"])


def _cell(cell: Cell, tag: str) -> str:
    text = html.escape(cell.text)
    if cell.swatch:
        text = f'<i class="swatch" style="background:{html.escape(cell.swatch)}"></i>{text}'
    if cell.small:
        text += f"<small>{html.escape(cell.small)}</small>"
    span = f' rowspan="{cell.rows}"' if cell.rows > 1 else ""
    kind, style = cell.kind, ""
    if cell.share is not None:
        kind, style = f"{kind} bar".strip(), f' style="--share:{100 * cell.share:.1f}%"'
    return f"<{tag}{_class(kind)}{span}{style}>{text}</{tag}>"


def _class(kind: str) -> str:
    return f' class="{html.escape(kind)}"' if kind else ""
