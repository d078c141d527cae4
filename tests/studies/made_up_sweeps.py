"""Runs of sweeps that simulate nothing, and a study to make them of."""

import os
from pathlib import Path

import yaml

from drake_pregrasp.studies.sweep.plan import SweepRun

STUDY = {
    "scenario": "a_base",
    "overrides": {"simulation_duration": 0.2, "planner": {"static_duration": 0.0}},
    "grid": {
        "motion.linear_velocity": [0.0, 0.02],
        "rate [Hz]": {
            10: {"planner.period": 0.1, "plant_config.time_step": 0.05},
            20: {"planner.period": 0.05, "plant_config.time_step": 0.025},
        },
    },
    "seeds": 2,
}
"""Eight runs, of two or four ticks each."""


def write_study(folder: Path, name: str = "mine", **changes: object) -> str:
    """Writes a study's file and returns its path."""
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / f"{name}.yaml"
    path.write_text(yaml.safe_dump({**STUDY, **changes}, sort_keys=False), encoding="utf-8")
    return str(path)


def made_up_run(run: SweepRun) -> list[float] | str:
    """Returns two numbers that follow from the run."""
    if run.index == 3 and os.environ.get("FAIL_RUN_3"):
        return "ScenarioError: doesn't fit, <b>not at all"
    return [run.seed + 0.1 * run.index, 1 / 3 if run.index else float("nan")]


class DiesOnce:
    """Makes runs, but ends its process at the first attempt at one of them."""

    def __init__(self, folder: Path, index: int) -> None:
        self._folder = folder
        self._index = index

    def __call__(self, run: SweepRun) -> list[float] | str:
        """Makes one."""
        note = self._folder / "was_here"
        if run.index == self._index and not note.exists():
            note.touch()
            os._exit(7)
        return made_up_run(run)


def one_by_one(make, runs):
    """Is an engine without processes, in reverse order."""
    for run in reversed(runs):
        yield run, make(run)
