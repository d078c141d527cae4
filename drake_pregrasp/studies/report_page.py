"""Reports as a self-contained HTML page with embedded figures, and as Markdown."""

import base64
import io
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import jinja2
import matplotlib.figure
import pandas as pd
from markupsafe import Markup
from pandas.io.formats.style import Styler

from drake_pregrasp.simulation.output import reading_back, write_text

NO_VALUE = "–"
"""Text of a table cell without a value."""


@dataclass(frozen=True)
class Heading:
    """A heading of a report.

    Attributes:
        text: Text of the heading.
        level: Level of the heading: 2 for a section, 3 for a subsection.
    """

    text: str
    level: int = 2


@dataclass(frozen=True)
class Table:
    """A table of a report.

    Attributes:
        data: Columns of the table, with numbers as texts where the digits matter; or a `Styler` of
            such columns, whose classes and colours only the HTML page shows.
        caption: Caption above the table.
    """

    data: "pd.DataFrame | Styler"
    caption: str = ""


@dataclass(frozen=True)
class Picture:
    """A figure of a report.

    Attributes:
        image: Path of a PNG in the report's folder, or a Matplotlib figure, which only the HTML
            page shows.
        caption: Caption below the figure.
    """

    image: Path | matplotlib.figure.Figure
    caption: str


@dataclass(frozen=True)
class Details:
    """Preformatted text that the HTML page folds away below a title.

    Attributes:
        title: Title of the text, always visible.
        text: Preformatted text, visible when the title is clicked.
    """

    title: str
    text: str


Part = str | Heading | Table | Picture | Details
"""A part of a report; a string is a paragraph."""


def write_report(
    folder: Path,
    title: str,
    parts: Sequence[Part],
    *,
    name: str = "report",
    formats: Sequence[str] = ("html", "md"),
) -> Path:
    """Writes a report and returns the path of its first format.

    Args:
        folder: Folder that the report is written to.
        title: Main heading of the report; if empty, the Markdown has no main heading.
        parts: Parts of the report, in their order.
        name: Name of the report's files, without extension.
        formats: Formats to write: "html", "md" or both.

    Raises:
        OutputError: If a file cannot be written, or a PNG cannot be read.
    """
    writers = {"html": to_html, "md": to_markdown}
    for ending in formats:
        write_text(folder / f"{name}.{ending}", writers[ending](title, parts))
    return folder / f"{name}.{formats[0]}"


def to_html(title: str, parts: Sequence[Part]) -> str:
    """Returns a report as a self-contained HTML page with all texts escaped."""
    loader = jinja2.FileSystemLoader(Path(__file__).parent)
    template = jinja2.Environment(loader=loader, autoescape=True).get_template("report_page.html")
    shown = [(type(part).__name__, part, _content(part, k)) for k, part in enumerate(parts)]
    return template.render(title=title, parts=shown)


def to_markdown(title: str, parts: Sequence[Part]) -> str:
    """Returns a report as Markdown with aligned tables and links to its figures."""
    blocks = [f"# {title}"] if title else []
    for part in parts:
        match part:
            case str():
                blocks.append(part)
            case Heading():
                blocks.append(f"{'#' * part.level} {part.text}")
            case Table():
                cells = _texts(part.data).map(lambda text: text.replace("|", r"\|"))
                text = cells.to_markdown(index=False, disable_numparse=True)
                blocks += [part.caption, text] if part.caption else [text]
            case Picture(image=Path() as path):
                blocks += [f"![{part.caption}]({path.name})", part.caption]
            case Details():
                blocks.append(f"## {part.title}\n\n```\n{part.text}\n```")
    return "\n\n".join(blocks) + "\n"


def _content(part: Part, place: int) -> str:
    """Returns a table's HTML or a figure's base64 data; the template writes all other parts."""
    match part:
        case Table(data=Styler() as styler):
            styler = styler.hide(axis="index").format(escape="html", na_rep=NO_VALUE)
            return Markup(styler.to_html(table_uuid=f"table{place}"))
        case Table():
            return Markup(_texts(part.data).to_html(index=False, border=0))
        case Picture(image=Path() as path):
            with reading_back(path):
                return base64.b64encode(path.read_bytes()).decode()
        case Picture(image=matplotlib.figure.Figure() as figure):
            png = io.BytesIO()
            figure.savefig(png, format="png", dpi=130, bbox_inches="tight")
            return base64.b64encode(png.getvalue()).decode()
    return ""


def _texts(data: "pd.DataFrame | Styler") -> pd.DataFrame:
    frame = data.data if isinstance(data, Styler) else data
    return frame.map(lambda value: NO_VALUE if pd.isna(value) else str(value))
