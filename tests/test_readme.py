"""The README is true, and so are the pages of scenarios and of the paper."""

import re

import numpy as np
import pytest
from pages import DOCS, ROOT, block, blocks, executed

from drake_pregrasp import load_scenario, shipped_scenarios
from drake_pregrasp.simulation.summary import MEASURES
from drake_pregrasp.studies.paper.paper_cases import LITERAL, TABLE_2, TABLE_3, case_job, run_cases
from drake_pregrasp.studies.paper.reproduce import DURATION


def table_rows(page: str, head: str) -> list[list[str]]:
    """Returns the cells of the rows of a page's table whose first head cell is that."""
    text = (DOCS / page).read_text(encoding="utf-8")
    (table,) = re.findall(rf"^\| {head} \|.*\n\|---.*\n((?:\|.*\n)+)", text, flags=re.MULTILINE)
    return [[cell.strip() for cell in row.strip("|").split("|")] for row in table.splitlines()]


def numbers(cell: str) -> list[float | None]:
    return [None if word == "—" else float(word) for word in cell.split()]


def test_the_python_lines_of_the_readme_run():
    names = executed("README.md", block("../README.md", "python"))
    assert names["diagram"].HasOutputPort("fingertip_targets")


@pytest.mark.slow
def test_the_python_lines_that_run_a_scenario_run(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    executed("scenarios.md", block("scenarios.md", "python"))
    assert (tmp_path / "runs" / "short" / "log.csv").exists()


def test_the_readme_is_short():
    assert len((ROOT / "README.md").read_text(encoding="utf-8").split()) <= 700


def test_there_are_two_commands():
    assert [block.count("\n") for block in blocks("../README.md", "sh")] == [1, 1]


def test_all_scenarios_are_in_the_table_or_in_the_gallery():
    rows = [row for head in ("name", "hand", "fault") for row in table_rows("scenarios.md", head)]
    in_table = [row[0].strip("`") for row in rows]
    of_extensions = [row[4] for row in table_rows("extensions.md", "section")]
    in_table += set(re.findall(r"`(\w+)`", " ".join(of_extensions)))
    gallery = (ROOT / "docs" / "gallery.md").read_text(encoding="utf-8")
    in_gallery = re.findall(r"^### `(\w+)`", gallery, flags=re.MULTILINE)
    assert {*in_table, *in_gallery} == {*shipped_scenarios()}
    for name in in_gallery:
        assert (ROOT / "docs" / "gallery" / f"{name}.png").exists()


def test_the_scenario_in_yaml_loads(tmp_path):
    (text,) = blocks("scenarios.md", "yaml")
    file = tmp_path / "mine.yaml"
    file.write_text(text)
    assert load_scenario("fast", file=file).planner.period == 0.02


WITH_LITERAL = TABLE_3 | {label: TABLE_3[case] for case, label in LITERAL.items()}


@pytest.mark.slow
@pytest.mark.parametrize(("head", "table"), [("Table II", TABLE_2), ("Table III", WITH_LITERAL)])
def test_tables_hold_what_is_published_and_what_runs_give(head, table, tmp_path):
    rows = {row[0].split(" `")[0]: row for row in table_rows("paper.md", head)}
    assert list(rows) == list(table)
    jobs = [case_job(case, 0, DURATION) for case in table]
    for run in run_cases(jobs, tmp_path).to_dict("records"):
        _, static_published, static_ours, published, ours = rows[run["case"]]
        assert numbers(static_published) == list(table[run["case"]].static)
        assert numbers(published) == list(table[run["case"]].dynamic)
        # The page has medians of ten seeds, this is one of them.
        for cell, kind in ((static_ours, "static"), (ours, "best")):
            values = [run[f"{kind} {measure}"] for measure in MEASURES]
            np.testing.assert_allclose(numbers(cell), values, atol=1e-3)
