"""Short runs of shipped scenarios, and what their logs hold."""

import numpy as np
from conftest import read_log
from pydrake.common.eigen_geometry import Quaternion
from pydrake.math import RigidTransform

from drake_pregrasp import load_scenario, run


def run_text(name, text, folder, **options):
    """Runs a shipped scenario with the overrides of a text, without a recording."""
    scenario = load_scenario(name, text=f"{{{text}}}")
    return run(scenario, name=name, out=folder, recording=False, **options)


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
