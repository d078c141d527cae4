"""The notebooks run, and are stored without outputs."""

import os
import re

import pytest
import trimesh
from pages import DOCS

import drake_pregrasp as dp

nbformat = pytest.importorskip("nbformat", reason="needs the extra docs")
NOTEBOOK = DOCS / "notebooks" / "tour.ipynb"


def test_no_outputs_are_stored():
    (path,) = (DOCS / "notebooks").glob("*.ipynb")
    assert path == NOTEBOOK
    code = [cell for cell in read_notebook().cells if cell.cell_type == "code"]
    assert code
    assert all(not cell.outputs and cell.execution_count is None for cell in code)


def read_notebook(path=NOTEBOOK):
    return nbformat.read(path, as_version=4)


@pytest.mark.slow
def test_the_notebook_runs_from_a_cube_to_a_hand_that_lifts(monkeypatch):
    if executed := os.environ.get("EXECUTED_NOTEBOOK"):  # By `.ci/run`, where nothing else is.
        notebook = read_notebook(executed)
    else:
        client = pytest.importorskip("nbclient", reason="needs the extra docs")
        monkeypatch.setenv("PYDEVD_DISABLE_FILE_VALIDATION", "1")
        notebook, folder = read_notebook(), str(NOTEBOOK.parent)
        client.NotebookClient(notebook, resources={"metadata": {"path": folder}}).execute()
    outputs = "".join(str(cell.get("outputs", "")) for cell in notebook.cells)
    assert outputs.count("<iframe srcdoc=") == 4
    assert "'image/png'" in outputs
    late, ahead = map(float, re.findall(r"are up to ([\d.]+) mm off", outputs))
    assert late > 3 > 1 > ahead
    assert "'phase': 'hold', 'gave_up': None" in outputs


@pytest.mark.slow
def test_the_exercise_has_the_solution_that_the_notebook_gives(monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    (lift,) = [cell.source for cell in read_notebook().cells if "def lift(" in cell.source]
    trimesh.creation.cylinder(radius=40, height=105, sections=6).export("mine.stl")
    names = {"folder": tmp_path, "dp": dp}
    exec(lift.partition("\n\n\nresult =")[0], names)
    with pytest.raises(
        dp.ScenarioError, match=r"torques of the hand's joints hold .* 2 kg weigh 19.6 N"
    ):
        names["lift"](2.0)
    with pytest.raises(dp.ScenarioError, match=r"hold 30 N with friction 0.5; .* weighs 39.2 N"):
        names["lift"](4.0)
