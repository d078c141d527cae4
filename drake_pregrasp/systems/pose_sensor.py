"""A noisy measurement of the object's pose."""

import numpy as np
from pydrake.common import RandomDistribution
from pydrake.common.value import AbstractValue
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.systems.framework import Context, LeafSystem, PortDataType

from drake_pregrasp.planning.rotation_vectors import rotation_matrix


class NoisyPoseSensor(LeafSystem):
    """Measures a pose with white noise.

    .. pydrake_system::

        name: NoisyPoseSensor
        input_ports:
        - X_WO
        - noise
        output_ports:
        - X_WO_measured

    Port `X_WO` accepts a `RigidTransform`: the true pose of the object O in the world W.

    Port `noise` accepts a vector of 6 standard normal numbers, three for the position and three
    for the orientation. It is a random input in Drake's sense; `NoiseSource` says why that system
    is the better source for it.

    Port `X_WO_measured` emits a `RigidTransform` M with p_WM = p_WO + position_std * noise[:3] and
    R_WM = Exp(orientation_std * noise[3:]) R_WO.

    Args:
        position_std: Standard deviation per axis, in metres.
        orientation_std: Standard deviation per axis of the rotation vector, in radians.
    """

    NOISE_SIZE = 6

    def __init__(self, *, position_std: float, orientation_std: float) -> None:
        super().__init__()
        self._position_std = position_std
        self._orientation_std = orientation_std
        self._X_WO = self.DeclareAbstractInputPort("X_WO", AbstractValue.Make(RigidTransform()))
        self._noise = self.DeclareInputPort(
            "noise", PortDataType.kVectorValued, self.NOISE_SIZE, RandomDistribution.kGaussian
        )
        self.DeclareAbstractOutputPort(
            "X_WO_measured",
            lambda: AbstractValue.Make(RigidTransform()),
            self._calc_measured_pose,
            {self._X_WO.ticket(), self._noise.ticket()},
        )

    def _calc_measured_pose(self, context: Context, output: AbstractValue) -> None:
        X_WO: RigidTransform = self._X_WO.Eval(context)
        noise: np.ndarray = self._noise.Eval(context)
        turn = RotationMatrix(rotation_matrix(self._orientation_std * noise[3:]))
        output.set_value(
            RigidTransform(
                turn @ X_WO.rotation(),
                X_WO.translation() + self._position_std * noise[:3],
            )
        )
