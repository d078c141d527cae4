"""Records of grasps that nothing has simulated."""

import numpy as np
from pydrake.math import RigidTransform, RotationMatrix

from drake_pregrasp.systems.loggers import GraspRecord


def record(time, phase, *, lift=0.0, slid=0.0, slip=0.0, tilt=0.0, links=(0.0, 0.0, 0.0)):
    """Returns the record of a tick at which five fingertips are around a cube."""
    R = RotationMatrix.MakeXRotation(tilt)
    X_WO = RigidTransform(R, [slid, 0.0, 0.05 + lift])
    tips = np.array([[0.059, 0, 0], [-0.059, 0.01, 0], [0, 0.059, 0], [0, -0.059, 0], [0, 0, 0.2]])
    tips[0, 1] += slip
    return GraspRecord(
        time=time,
        report=np.array([phase, 0.0, 0.0, 0.0]),
        p_WT=(X_WO @ tips.T).T,
        p_GT=tips,
        f_T_W=np.zeros((5, 3)),
        X_WG=X_WO,
        X_WO=X_WO,
        X_WD=RigidTransform(),
        link_forces=np.array(links),
    )


def state_of(context):
    """Returns the time and the discrete state of a diagram."""
    groups = range(context.num_discrete_state_groups())
    values = [context.get_discrete_state(group).value() for group in groups]
    return np.concatenate([[context.get_time()], *values])
