"""Commands of studies exist without the studies' libraries, and then ask to install them."""

import subprocess
import sys

import pytest

from drake_pregrasp.cli import main

LIBRARIES = ("dask", "jinja2", "pandas", "seaborn", "statsmodels")
LIST_AND_RUN = f"""
import sys
from drake_pregrasp.cli import main
assert main(["list"]) == 0
assert main(["run", "a_base", "--simulation_duration", "0.1", "--no-recording", "--out", "."]) == 0
imported = [m for m in sys.modules if m.startswith("drake_pregrasp.studies") or m in {LIBRARIES}]
assert imported == [], imported
"""


@pytest.mark.slow
def test_list_and_run_import_no_study(tmp_path):
    subprocess.run([sys.executable, "-c", LIST_AND_RUN], cwd=tmp_path, check=True, timeout=120)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("command", "library"),
    [(["study", "shapes"], "seaborn"), (["gallery"], "jinja2"), (["bench"], "pandas")],
)
def test_without_the_extra_one_line_names_the_command_that_installs_it(
    command, library, tmp_path, capfd
):
    code = f"""
import sys
sys.modules[{library!r}] = None
from drake_pregrasp.cli import main
sys.exit(main({command}))
"""
    run = subprocess.run([sys.executable, "-c", code], cwd=tmp_path, timeout=120, check=False)
    said = capfd.readouterr().err
    assert run.returncode == 2
    problem = f"{command[0]} needs {library}; pip install 'drake_pregrasp[studies]' brings it"
    assert said.endswith(f"{problem}\n")
    assert said.count("\n") == 1


@pytest.mark.parametrize("command", ["study", "gallery", "grasps", "reproduce", "bench"])
def test_help_of_a_command_lists_its_options(command, capsys):
    with pytest.raises(SystemExit) as ended:
        main([command, "--help"])
    assert ended.value.code == 0
    assert "--out" in capsys.readouterr().out
