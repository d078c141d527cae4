"""The README is true, and so are the pages of scenarios and of the paper."""

import re

import pytest
from pages import ROOT, block, blocks, executed, table_rows

from drake_pregrasp import load_scenario, shipped_scenarios


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


def test_all_scenarios_are_on_their_page_or_in_the_gallery():
    rows = [row for head in ("name", "hand") for row in table_rows("scenarios.md", head)]
    in_table = [row[0].strip("`") for row in rows]
    text = (ROOT / "docs" / "scenarios.md").read_text(encoding="utf-8")
    in_table += re.findall(r"`((?:catch|fault)_\w+)`", text)
    of_extensions = [row[2] for row in table_rows("extensions.md", "section")]
    in_table += set(re.findall(r"`(\w+)`", " ".join(of_extensions)))
    gallery = (ROOT / "docs" / "gallery" / "gallery.md").read_text(encoding="utf-8")
    in_gallery = re.findall(r"^### `(\w+)`", gallery, flags=re.MULTILINE)
    assert {*in_table, *in_gallery} == {*shipped_scenarios()}
    for name in in_gallery:
        assert (ROOT / "docs" / "gallery" / f"{name}.png").exists()


def test_the_scenario_in_yaml_loads(tmp_path):
    (text,) = blocks("scenarios.md", "yaml")
    file = tmp_path / "mine.yaml"
    file.write_text(text)
    assert load_scenario("fast", file=file).planner.period == 0.02
