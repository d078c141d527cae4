"""What a grasp has come to, read from what was seen of it."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from pydrake.math import RigidTransform
from scipy.spatial.transform import Rotation

from drake_pregrasp.arrays import BoolArray, FloatArray
from drake_pregrasp.geometry.solids import BoxSolid
from drake_pregrasp.grasping.grasp_state import GiveUp, GraspPhase, GraspState, describe_give_up
from drake_pregrasp.grasping.squeeze import squeeze_forces
from drake_pregrasp.quality.grasp_quality import grasp_quality
from drake_pregrasp.studies.static_versus_dynamic.outcome import (
    LEVEL_BELOW_DEG,
    LIFTED_ABOVE_MM,
    Outcome,
    TrialJob,
)
from drake_pregrasp.studies.static_versus_dynamic.scene import BOX, Scene
from drake_pregrasp.systems.grasp_sequencer import GRAVITY
from drake_pregrasp.systems.loggers import GraspRecord


class GoalLook(NamedTuple):
    """Goals at a tick.

    Attributes:
        time: In seconds.
        usable: How many fingers are active.
        withdrawn: How many others aren't lost.
        distance: Least distance of a fingertip, in contact or at its standoff, from the no-touch
            area, in metres, over all active goals; infinite without one.
    """

    time: float
    usable: int
    withdrawn: int
    distance: float


_SETTLED = 1.0  # From when on fingertips are to keep out of the area, in seconds.


def grasp_outcome(
    job: TrialJob,
    close_at: float,
    scene: Scene,
    records: Sequence[GraspRecord],
    looks: Sequence[GoalLook],
    *,
    state: GraspState,
    p_OCoM: FloatArray,
    tip_radii: FloatArray,
) -> Outcome:
    """Reads an outcome.

    Args:
        job: The trial.
        close_at: When the hand was told to close, in seconds.
        scene: What happened.
        records: Of all control ticks until the end of the grasp.
        looks: Goals while it tracked.
        state: What the hand remembers at the end.
        p_OCoM: The object's centre of mass in O, shape (3,), in metres.
        tip_radii: Of the fingertips, shape (n,), in metres.
    """
    told = [r.time >= close_at - 1e-9 for r in records].index(True)
    phases = np.array([r.report[0] for r in records])
    closing = _first(phases, told, GraspPhase.CLOSE)
    squeezing = _first(phases, told, GraspPhase.SQUEEZE)
    lifting = _first(phases, told, GraspPhase.LIFT)
    end = len(records) - 1
    X_DO = [r.X_WD.inverse() @ r.X_WO for r in (records[0], records[told])]
    last_on_table = records[lifting if lifting is not None else end]
    area = bool(scene.area)
    on_table = [r for r in records[: end if lifting is None else lifting] if r.time >= _SETTLED]
    touched = squeezing
    if touched is None and closing is not None and state.reason == GiveUp.OUT_OF_BALANCE:
        touched = _first(phases, told, GraspPhase.BACK_OFF)  # All had touched, and that was why.
    contacts = None
    if touched is not None:
        contacts = _contacts(records[touched], state.active, p_OCoM)
    lift = last_on_table.X_WO.translation()[2]
    tilt = np.degrees(np.arccos(np.clip(records[end].X_WO.rotation().matrix()[2, 2], -1, 1)))
    return Outcome(
        condition=job.condition,
        arm=job.arm,
        seed=job.seed,
        close_at=close_at,
        lifted=bool(
            lifting is not None
            and phases[end] == GraspPhase.HOLD
            and 1e3 * (records[end].X_WO.translation()[2] - lift) > LIFTED_ABOVE_MM
        ),
        level=bool(tilt < LEVEL_BELOW_DEG),
        pushed_before_mm=_way(X_DO[0], X_DO[1]),
        turned_before_deg=_turn(X_DO[0], X_DO[1]),
        pushed_closing_mm=_way(X_DO[1], last_on_table.X_WD.inverse() @ last_on_table.X_WO),
        slip_mm=np.nan if lifting is None else _slip(records[lifting:], state.active),
        tilt_deg=float(tilt),
        residual_n=np.nan if contacts is None else _residual(scene, contacts),
        fingers=int(np.sum(state.active)),
        waited_s=float(records[end if closing is None else closing].time - close_at),
        withdrawn=float(np.mean([look.withdrawn for look in looks])) if looks else np.nan,
        goal_in_area=_share([look.distance < 0 for look in looks]) if area else np.nan,
        tip_in_area=_share([_in_area(scene, tip_radii, r) for r in on_table]) if area else np.nan,
        q_msv=np.nan if contacts is None else grasp_quality(contacts[0]).q_msv,
        q_gii=np.nan if contacts is None else grasp_quality(contacts[0]).q_gii,
        gave_up=describe_give_up(state.reason, state.detail) or "",
    )


def _first(phases: FloatArray, start: int, phase: GraspPhase) -> int | None:
    """Returns the index of the first record of a phase, from one on, or None."""
    found = np.flatnonzero(phases[start:] == phase)
    return start + int(found[0]) if len(found) else None


def _way(X_DO_1: RigidTransform, X_DO_2: RigidTransform) -> float:
    """Returns how far the object went on the turntable, in millimetres."""
    return 1e3 * float(np.linalg.norm(X_DO_2.translation() - X_DO_1.translation()))


def _turn(X_DO_1: RigidTransform, X_DO_2: RigidTransform) -> float:
    """Returns how far it turned, in degrees."""
    R = X_DO_1.rotation().inverse() @ X_DO_2.rotation()
    return float(np.degrees(Rotation.from_matrix(R.matrix()).magnitude()))


def _slip(records: Sequence[GraspRecord], active: BoolArray) -> float:
    """Returns how far any fingertip moved over the object, at most, in millimetres."""
    p_OT = np.array([(r.X_WO.inverse() @ r.p_WT[active].T).T for r in records])
    return 1e3 * float(np.max(np.linalg.norm(p_OT - p_OT[0], axis=2)))


def _contacts(
    record: GraspRecord, active: BoolArray, p_OCoM: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Returns lever arms and outward normals where fingertips touch, and z of W, all in O."""
    X_OW = record.X_WO.inverse()
    p_OT = (X_OW @ record.p_WT[active].T).T
    box = BoxSolid(np.zeros(3), np.eye(3), np.array(BOX.size))
    distances, normals = box.distance_and_gradient(p_OT)
    p_OC = p_OT - distances[:, None] * normals
    return p_OC - p_OCoM, normals, X_OW.rotation().matrix()[:, 2]


def _residual(scene: Scene, contacts: tuple[FloatArray, FloatArray, FloatArray]) -> float:
    p_CoMC, normals, up = contacts
    grasp = scene.grasp()
    weight = np.append(-GRAVITY * BOX.mass * up, np.zeros(3))
    return squeeze_forces(
        p_CoMC,
        normals,
        weight,
        friction=grasp.planned_friction,
        least_normal=grasp.least_force,
        largest_normal=grasp.largest_force,
    ).residual


def _in_area(scene: Scene, tip_radii: FloatArray, record: GraspRecord) -> bool:
    gaps = [solid.distance(record.p_WT) - tip_radii for solid in scene.area_at(record.time)]
    return bool(np.min(gaps) < 0)


def _share(found: Sequence[bool]) -> float:
    return float(np.mean(found)) if found else np.nan
