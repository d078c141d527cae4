"""The reproduction's report, as HTML with everything inside and as Markdown."""

import base64
import html
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from drake_pregrasp.studies.claims import Claim
from drake_pregrasp.studies.published import SCENARIOS
from drake_pregrasp.studies.tables import Row

_STYLE = """
body { font: 16px/1.5 system-ui, sans-serif; max-width: 70rem; margin: 2rem auto; padding: 0 1rem;
       color: #222; }
h1, h2 { line-height: 1.2; } h2 { margin-top: 2.5rem; }
table { border-collapse: collapse; margin: 1rem 0; font-variant-numeric: tabular-nums; }
th, td { padding: .3rem .7rem; border-bottom: 1px solid #ddd; text-align: right; }
th:first-child, td:first-child { text-align: left; }
thead th { border-bottom: 2px solid #888; }
td small { color: #666; display: block; }
img { max-width: 100%; } figure { margin: 1.5rem 0; } figcaption { color: #555; }
td.holds, td.fails, table.numbers td { white-space: nowrap; }
.holds { color: #00664b; font-weight: 600; } .fails { color: #a34700; font-weight: 600; }
pre { background: #f5f5f5; padding: .6rem; overflow-x: auto; font-size: .85rem; }
"""

_TITLES = {
    "table2": "Table II: position tracking",
    "table3": "Table III: the four strategies",
}

_MEASURES = ("Q_MSV", "Q_GII", "Q_VEW")

Figures = Sequence[tuple[str, str]]
"""Pairs of a figure's file name without its ending, and its caption."""


def write_report(
    out: Path,
    tables: dict[str, dict[str, Row]],
    claims: Sequence[Claim],
    figures: Figures,
    notes: Sequence[str],
) -> None:
    """Writes `report.html` and `report.md`.

    Args:
        out: Folder of the report, which holds the figures as PNG.
        tables: From `make_tables`.
        claims: From `judge_claims`.
        figures: What to show.
        notes: Sentences on how it was made.
    """
    (out / "report.html").write_text(_html(out, tables, claims, figures, notes), encoding="utf-8")
    (out / "report.md").write_text(_markdown(tables, claims, figures, notes), encoding="utf-8")


def _cells(row: Row) -> list[tuple[str, ...]]:
    """Returns the cells after the first two of `_HEAD` for each measure."""
    keys = ("static_published", "static_ours", "published", "ours")
    columns = zip(
        *(row[key] for key in (*keys, "ours_min", "ours_max", "ours_settled")), strict=True
    )
    return [
        (
            _number(static_published),
            _number(static),
            _number(published),
            f"{_number(best)} [{_number(low)}, {_number(high)}]",
            f"{100 * (best / published - 1):+.2f} %",
            _number(settled),
        )
        for static_published, static, published, best, low, high, settled in columns
    ]


def _number(value: float | None) -> str:
    return "not printed" if value is None else f"{value:.4f}"


_HEAD = (
    "case",
    "measure",
    "static, paper",
    "static, ours",
    "best, paper",
    "best, ours [range]",
    "difference",
    "settled, ours",
)


def _table_rows(table: dict[str, Row]) -> list[tuple[str, ...]]:
    rows: list[tuple[str, ...]] = []
    for case, row in table.items():
        for measure, cells in zip(_MEASURES, _cells(row), strict=True):
            first = f"{case}) {SCENARIOS[case]}" if measure == _MEASURES[0] else ""
            rows.append((first, measure, *cells))
    return rows


def _remarks(table: dict[str, Row]) -> list[str]:
    return [f"{case}) {remark}" for case, row in table.items() for remark in row["remarks"]]


def _html(
    out: Path,
    tables: dict[str, dict[str, Row]],
    claims: Sequence[Claim],
    figures: Figures,
    notes: Sequence[str],
) -> str:
    text = html.escape
    shown = {key: table for key, table in tables.items() if table}
    parts = [
        "<!DOCTYPE html><html lang='en'><head><meta charset='utf-8'>",
        f"<title>The paper, reproduced</title><style>{_STYLE}</style></head><body>",
        "<h1>Dynamic pre-grasp planning: the paper, reproduced</h1>",
        *(f"<p>{text(note)}</p>" for note in notes),
        "<h2>Claims</h2><table><thead><tr><th>claim</th><th>verdict</th></tr></thead><tbody>",
    ]
    for claim in claims:
        kind = "holds" if claim.holds else "fails"
        remark = f"<small>{text(claim.remark)}</small>" if claim.remark else ""
        parts.append(
            f"<tr><td>{text(claim.claim)}{remark}</td><td class='{kind}'>{claim.verdict}</td></tr>"
        )
    parts.append("</tbody></table>")
    for key, table in shown.items():
        head = "".join(f"<th>{text(cell)}</th>" for cell in _HEAD)
        parts.append(f"<h2>{text(_TITLES[key])}</h2>")
        parts.append(f"<table class='numbers'><thead><tr>{head}</tr></thead><tbody>")
        for row in _table_rows(table):
            parts.append("<tr>" + "".join(f"<td>{text(cell)}</td>" for cell in row) + "</tr>")
        parts.append("</tbody></table>")
        parts += [f"<p>{text(remark)}</p>" for remark in _remarks(table)]
    parts.append("<h2>Figures</h2>")
    for name, caption in figures:
        data = base64.b64encode((out / f"{name}.png").read_bytes()).decode()
        parts.append(
            f"<figure><img alt='{text(caption, quote=True)}' src='data:image/png;base64,{data}'>"
            f"<figcaption>{text(caption)}</figcaption></figure>"
        )
    parts.append("<h2>The numbers behind the verdicts</h2>")
    for claim in claims:
        numbers = text(json.dumps(claim.numbers, indent=2))
        parts.append(
            f"<details><summary>{text(claim.claim)}</summary><pre>{numbers}</pre></details>"
        )
    return "\n".join([*parts, "</body></html>\n"])


def _markdown(
    tables: dict[str, dict[str, Row]],
    claims: Sequence[Claim],
    figures: Figures,
    notes: Sequence[str],
) -> str:
    shown = {key: table for key, table in tables.items() if table}
    lines = ["# Dynamic pre-grasp planning: the paper, reproduced", ""]
    lines += [*(f"{note}\n" for note in notes), "## Claims", ""]
    lines += _markdown_table(
        ("claim", "verdict", "remark"),
        [(claim.claim, claim.verdict, claim.remark) for claim in claims],
    )
    for key, table in shown.items():
        lines += ["", f"## {_TITLES[key]}", "", *_markdown_table(_HEAD, _table_rows(table)), ""]
        lines += [f"{remark}\n" for remark in _remarks(table)]
    lines += ["", "## Figures", ""]
    lines += [f"![{caption}]({name}.png)\n\n{caption}\n" for name, caption in figures]
    lines += ["## The numbers behind the verdicts", ""]
    for claim in claims:
        numbers: Any = json.dumps(claim.numbers)
        lines.append(f"- {claim.claim}: `{numbers}`")
    return "\n".join(lines) + "\n"


def _markdown_table(head: tuple[str, ...], rows: Sequence[tuple[str, ...]]) -> list[str]:
    return [
        "| " + " | ".join(cells) + " |"
        for cells in (head, tuple("---" for _ in head), *(tuple(row) for row in rows))
    ]
