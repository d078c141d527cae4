"""Records of grasps that nothing has simulated."""

import numpy as np
from pydrake.math import RigidTransform, RotationMatrix

from drake_pregrasp.grasping.held_criterion import GraspTicks, held_measures
from drake_pregrasp.simulation.run_log import pose_values
from drake_pregrasp.systems.loggers import GraspRecord


def record(time, phase, *, since=0.0, lift=0.0, slid=0.0, sunk=0.0, tilt=0.0, links=(0.0,) * 3):
    """Returns the record of a tick at which five fingertips are around a cube.

    Args:
        time: Time of the tick.
        phase: Phase of the grasp.
        since: Time at which the phase began.
        lift: Height by which the hand has lifted the cube.
        slid: Distance by which the cube has moved on the table.
        sunk: Distance by which the cube has slipped down in the hand.
        tilt: Angle of the cube about x.
        links: Forces of links.
    """
    R = RotationMatrix.MakeXRotation(tilt)
    X_WO = RigidTransform(R, [slid, 0.0, 0.05 + lift - sunk])
    tips = np.array([[0.059, 0, 0], [-0.059, 0.01, 0], [0, 0.059, 0], [0, -0.059, 0], [0, 0, 0.2]])
    return GraspRecord(
        time=time,
        report=np.array([phase, since, 0.0, 0.0]),
        p_WT=(X_WO @ tips.T).T,
        p_GT=tips,
        f_T_W=np.zeros((5, 3)),
        X_WG=RigidTransform([0.0, 0.0, 0.05 + lift]),
        X_WO=X_WO,
        X_WD=RigidTransform(),
        link_forces=np.array(links),
        catch_certificate=np.full(5, np.nan),
    )


def ticks_of(records):
    """Returns records as arrays."""
    poses = [[pose_values(X) for X in (r.X_WO, r.X_WD, r.X_WG)] for r in records]
    columns = np.array([[r.time, *r.report[:2]] for r in records]).T
    return GraspTicks(*columns, *np.array(poses).swapaxes(0, 1))


def motion_of(records, close_at, *, is_carried=True, shakes=True):
    """Returns the `held_measures` of records of an object with its centre of mass at its origin."""
    still = {"is_carried": is_carried, "falls": False, "shakes": shakes}
    return held_measures(ticks_of(records), np.zeros(3), close_at, **still)


def state_of(context):
    """Returns the time and the discrete state of a diagram."""
    groups = range(context.num_discrete_state_groups())
    values = [context.get_discrete_state(group).value() for group in groups]
    return np.concatenate([[context.get_time()], *values])
