"""The log of a hand: one row of `grasp.csv` a control tick."""

from pathlib import Path

import numpy as np

from drake_pregrasp.planning.arrays import FloatArray
from drake_pregrasp.simulation.csv_log import CsvLog
from drake_pregrasp.simulation.run_log import pose_columns, pose_values
from drake_pregrasp.systems.grasp_logger import GraspRecord


class GraspLog(CsvLog):
    """Writes what a hand does to `grasp.csv`.

    Args:
        path: The file to write; what was there is replaced.
        num_fingers: n.

    Raises:
        OutputError: If the file can't be written.
    """

    def __init__(self, path: Path, num_fingers: int) -> None:
        super().__init__(path, grasp_columns(num_fingers))
        self._num_fingers = num_fingers

    def append(self, record: GraspRecord) -> None:
        """Adds a tick."""
        self.write(
            np.concatenate(
                [
                    [record.time],
                    record.report,
                    record.p_WT.ravel(),
                    record.p_GT.ravel(),
                    record.f_T_W.ravel(),
                    *pose_values(record.X_WG),
                    *pose_values(record.X_WO),
                    *pose_values(record.X_WD),
                ]
            )
        )

    def read_points(self, kind: str) -> FloatArray:
        """Reads the tips' `tip` in W, `goal` in G or `force` in W back, shape (ticks, n, 3)."""
        names = _point_columns(kind, self._num_fingers)
        return np.stack(self.read(*names), axis=-1).reshape(-1, self._num_fingers, 3)

    def read_pose(self, frames: str) -> FloatArray:
        """Reads poses back, as `wo`, shape (ticks, 7)."""
        return np.stack(self.read(*pose_columns(frames)), axis=-1)


def grasp_columns(num_fingers: int) -> list[str]:
    """Returns the names of the columns of `grasp.csv`, in their order."""
    return [
        "time",
        "phase",
        "phase_since",
        "gave_up",
        "gave_up_detail",
        *_point_columns("tip", num_fingers),
        *_point_columns("goal", num_fingers),
        *_point_columns("force", num_fingers),
        *pose_columns("wg"),
        *pose_columns("wo"),
        *pose_columns("wd"),
    ]


def _point_columns(kind: str, num_fingers: int) -> list[str]:
    return [f"{kind}{i}_{axis}" for i in range(num_fingers) for axis in "xyz"]
