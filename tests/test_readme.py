"""The README is true."""

import re

import numpy as np
import pytest
from pages import ROOT, blocks, executed

from drake_pregrasp import load_scenario, shipped_scenarios
from drake_pregrasp.simulation.summary import MEASURES
from drake_pregrasp.studies.paper.paper_cases import TABLE_2, TABLE_3, case_job, run_cases
from drake_pregrasp.studies.paper.reproduce import DURATION

README = (ROOT / "README.md").read_text(encoding="utf-8")


def table_rows(head: str) -> list[list[str]]:
    """Returns the cells of the rows of the table whose first head cell is that."""
    (table,) = re.findall(rf"^\| {head} \|.*\n\|---.*\n((?:\|.*\n)+)", README, flags=re.MULTILINE)
    return [[cell.strip() for cell in row.strip("|").split("|")] for row in table.splitlines()]


def numbers(cell: str) -> list[float | None]:
    return [None if word == "—" else float(word) for word in cell.split()]


@pytest.mark.slow
def test_the_python_lines_run(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (code,) = blocks("../README.md", "python")
    names = executed("README.md", code)
    assert (tmp_path / "runs" / "short" / "log.csv").exists()
    assert names["diagram"].HasOutputPort("fingertip_targets")


def test_there_are_two_commands():
    assert [block.count("\n") for block in blocks("../README.md", "sh")] == [1, 1]


def test_all_scenarios_are_in_the_table_or_in_the_gallery():
    rows = [row for head in ("name", "hand", "fault") for row in table_rows(head)]
    in_table = [row[0].strip("`") for row in rows]
    gallery = (ROOT / "docs" / "gallery.md").read_text(encoding="utf-8")
    in_gallery = re.findall(r"^### `(\w+)`", gallery, flags=re.MULTILINE)
    assert sorted(in_table + in_gallery) == sorted(shipped_scenarios())
    for name in in_gallery:
        assert (ROOT / "docs" / "gallery" / f"{name}.png").exists()


def test_the_scenario_in_yaml_loads(tmp_path):
    (text,) = blocks("../README.md", "yaml")
    file = tmp_path / "mine.yaml"
    file.write_text(text)
    assert load_scenario("fast", file=file).planner.period == 0.02


@pytest.mark.slow
@pytest.mark.parametrize(("head", "table"), [("Table II", TABLE_2), ("Table III", TABLE_3)])
def test_tables_hold_what_is_published_and_what_runs_give(head, table, tmp_path):
    rows = {row[0].split()[0]: row for row in table_rows(head)}
    assert list(rows) == list(table)
    jobs = [case_job(case, 0, DURATION) for case in table]
    for run in run_cases(jobs, tmp_path).to_dict("records"):
        _, static_published, static_ours, published, ours = rows[run["case"]]
        assert numbers(static_published) == list(table[run["case"]].static)
        assert numbers(published) == list(table[run["case"]].dynamic)
        # The README has medians of ten seeds, this is one of them.
        for cell, kind in ((static_ours, "static"), (ours, "best")):
            values = [run[f"{kind} {measure}"] for measure in MEASURES]
            np.testing.assert_allclose(numbers(cell), values, atol=1e-3)
