"""The project's pages: their text, and the code that they show."""

import re
from pathlib import Path

ROOT = Path(__file__).parent.parent
DOCS = ROOT / "docs"


def blocks(page, language):
    """Returns the blocks of a language on a page, which is named from the folder docs."""
    text = (DOCS / page).read_text(encoding="utf-8")
    return re.findall(rf"```{language}\n(.*?)```", text, flags=re.DOTALL)


def block(page, language):
    return "".join(blocks(page, language))


def executed(page, code):
    names: dict[str, object] = {}
    exec(compile(code, page, "exec"), names)
    return names


def table_rows(page: str, head: str) -> list[list[str]]:
    """Returns the cells of the rows of a page's table whose first head cell is that."""
    text = (DOCS / page).read_text(encoding="utf-8")
    (table,) = re.findall(rf"^\| {head} \|.*\n\|---.*\n((?:\|.*\n)+)", text, flags=re.MULTILINE)
    return [[cell.strip() for cell in row.strip("|").split("|")] for row in table.splitlines()]


def numbers(cell: str) -> list[float | None]:
    return [None if word == "–" else float(word) for word in cell.split()]
