"""The notebooks run, and are stored without outputs."""

import re

import pytest
from pages import DOCS

nbformat = pytest.importorskip("nbformat", reason="needs the extra docs")
NOTEBOOK = DOCS / "notebooks" / "tour.ipynb"


def test_no_outputs_are_stored():
    (path,) = (DOCS / "notebooks").glob("*.ipynb")
    assert path == NOTEBOOK
    code = [cell for cell in read_notebook().cells if cell.cell_type == "code"]
    assert code
    assert all(not cell.outputs and cell.execution_count is None for cell in code)


def read_notebook():
    return nbformat.read(NOTEBOOK, as_version=4)


@pytest.mark.slow
def test_the_notebook_runs_from_a_cube_to_ones_own_controller(monkeypatch):
    client = pytest.importorskip("nbclient", reason="needs the extra docs")
    monkeypatch.setenv("PYDEVD_DISABLE_FILE_VALIDATION", "1")
    notebook, folder = read_notebook(), str(NOTEBOOK.parent)
    client.NotebookClient(notebook, resources={"metadata": {"path": folder}}).execute()
    outputs = "".join(str(cell.get("outputs", "")) for cell in notebook.cells)
    assert outputs.count("<iframe srcdoc=") == 3
    assert "'image/png'" in outputs
    late, ahead = map(float, re.findall(r"are up to ([\d.]+) mm off", outputs))
    assert late > 3 > 1 > ahead
