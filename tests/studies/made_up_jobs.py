"""Jobs that simulate nothing, and a study of a sweep to write."""

import os
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import yaml

JOBS = [{"name": name, "seed": seed} for seed in range(4) for name in ("b", "a")]

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


def row(job: Mapping[str, Any]) -> dict[str, Any]:
    """Returns numbers that follow from the job, or fails where the environment says so."""
    if os.environ.get("FAIL") == f"{job['name']}{job['seed']}":
        raise ZeroDivisionError("no <b>luck, none\nat all")
    return {"third": job["seed"] / 3, "nothing": float("nan"), "process": os.getpid()}


def constant_row(job: Mapping[str, Any]) -> dict[str, Any]:
    """Returns the same without what differs between processes."""
    return {**row(job), "process": 0}


@dataclass(frozen=True)
class Deadly:
    """Ends its process at the first attempts at one of the jobs.

    Attributes:
        folder: Where each attempt leaves a note.
        deadly: Of the jobs named `a`, the number of attempts that end their process by seed.
    """

    folder: Path
    deadly: Mapping[int, int]

    def __call__(self, job: Mapping[str, Any]) -> dict[str, Any]:
        """Returns a row, unless it ends its process."""
        if job["name"] == "a":
            attempts = len(list(self.folder.glob(f"{job['seed']}_*")))
            (self.folder / f"{job['seed']}_{attempts}").touch()
            if attempts < self.deadly.get(job["seed"], 0):
                os._exit(9)
        return constant_row(job)
