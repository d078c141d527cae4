"""Short runs of shipped scenarios, and their logs."""

from contextlib import nullcontext
from unittest.mock import patch

import numpy as np
from conftest import read_log
from pydrake.common.eigen_geometry import Quaternion
from pydrake.math import RigidTransform
from scipy.spatial.transform import Rotation

from drake_pregrasp import BoxSolid, load_scenario, run
from drake_pregrasp.cli.run_command import print_result
from drake_pregrasp.grasping.grasp_state import GraspPhase


def run_text(name, text, folder, *, plots=False, **options):
    """Runs a shipped scenario with the overrides of a text, without a recording."""
    scenario = load_scenario(name, text=f"{{{text}}}")
    with nullcontext() if plots else patch("drake_pregrasp.simulation.run.plot_metrics"):
        return run(scenario, name=name, out=folder, recording=False, **options)


def closing_words(result, capsys):
    """Returns what a command says of a run at its end, by the first word of each line."""
    print_result(result, recorded=False)
    return dict(line.split(maxsplit=1) for line in capsys.readouterr().out.splitlines())


def run_log(result, file="log.csv"):
    return read_log(result.folder / file)


def points(log, name):
    """Returns the columns of a point such as `tip0` or of an origin such as `wo`, shape (k, 3)."""
    form = "{1}_{0}" if name.startswith("w") else "{0}_{1}"
    return np.stack([log[form.format(name, axis)] for axis in "xyz"], axis=-1)


def contacts(log, row):
    return np.array([points(log, f"c{i}")[row] for i in range(5)])


def pose(log, row, frames):
    q = Quaternion(*(log[f"q{c}_{frames}"][row] for c in "wxyz"))
    return RigidTransform(q, points(log, frames)[row])


def check_gaps(result, size, radius, fingers):
    """Checks that tips keep 7 mm off a cube before they close, and touch it when they hold it."""
    log, cube = run_log(result, "grasp.csv"), BoxSolid(np.zeros(3), np.eye(3), np.full(3, size))
    R_OW = Rotation.from_quat(np.stack([log[f"q{axis}_wo"] for axis in "xyzw"], axis=-1)).inv()
    for finger in range(fingers):
        p_OT = R_OW.apply(points(log, f"tip{finger}") - points(log, "wo"))
        gaps = cube.distance(p_OT) - radius
        assert np.min(gaps[log["phase"] < GraspPhase.CLOSE]) > 0.007
        assert np.max(np.abs(gaps[log["phase"] == GraspPhase.HOLD])) < 1e-3
