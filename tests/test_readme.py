"""The README is true."""

import re
from pathlib import Path

import pytest

from drake_pregrasp import load_scenario, run, shipped_scenarios

ROOT = Path(__file__).parent.parent
README = (ROOT / "README.md").read_text(encoding="utf-8")


def blocks(language: str) -> list[str]:
    return re.findall(rf"```{language}\n(.*?)```", README, flags=re.DOTALL)


def table_rows() -> dict[str, list[str]]:
    rows = re.findall(r"^\| `([a-j]_\w+)` \|(.*)\|$", README, flags=re.MULTILINE)
    return {name: [cell.strip() for cell in cells.split("|")] for name, cells in rows}


def test_the_python_lines_run(tmp_path, monkeypatch):
    (code,) = blocks("python")
    monkeypatch.chdir(tmp_path)
    names: dict[str, object] = {}
    exec(compile(code, "README.md", "exec"), names)
    assert (tmp_path / "runs" / "short" / "log.csv").exists()
    assert names["diagram"].HasOutputPort("fingertip_targets")


def test_there_are_two_commands():
    assert [block.count("\n") for block in blocks("sh")] == [1, 1]


def test_all_scenarios_are_in_the_table():
    assert list(table_rows()) == list(shipped_scenarios())


@pytest.mark.parametrize("name", shipped_scenarios())
def test_the_table_holds_what_runs_give(name, tmp_path):
    summary = run(load_scenario(name), name=name, out=tmp_path, recording=False).summary
    cells = table_rows()[name]
    for cell, phase in ((cells[1], "static"), (cells[2], "max")):
        assert cell == " ".join(f"{value:.4f}" for value in summary[phase].values())


def test_links_lead_somewhere():
    for target in re.findall(r"\]\((?!https)([^)]+)\)", README):
        assert (ROOT / target).exists()
