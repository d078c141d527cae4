"""The goals of a hand that doesn't turn, and just closes when it is told to."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from pydrake.common.value import AbstractValue
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.systems.framework import BasicVector, BusValue, Context, LeafSystem

from drake_pregrasp.arrays import BoolArray, FloatArray
from drake_pregrasp.contacts.selection_input import ContactStatus
from drake_pregrasp.geometry.solids import BoxSolid
from drake_pregrasp.regions.constraints import Limit, Obstacles, RegionConstraints


class StillHand(LeafSystem):
    """Goals of fingers on a ring round the object that doesn't turn with it.

    .. pydrake_system::

        name: StillHand
        input_ports:
        - X_WO_estimated
        - contact_weights
        - obstacles
        - close
        output_ports:
        - fingertip_targets
        - contact_status

    The ports are as those of `PregraspPlanner`, but for `close`, the command. Fingers wait on a
    ring about the object, which goes along and does not turn. From the command on their goals
    are where the rays from its middle meet the object. A finger that is lost, or would be near an
    obstacle there, is not active, by the rule that the planner has.

    Args:
        tip_frames: Scoped names of the fingertips' frames.
        azimuths: Of the fingers in W, shape (n,), in radians.
        ring_radius: Of the fingertips' centres on the ring, in metres.
        box: The object, about the origin of O.
        constraints: With fingertips, clearance and standoff.
    """

    def __init__(
        self,
        *,
        tip_frames: Sequence[str],
        azimuths: FloatArray,
        ring_radius: float,
        box: BoxSolid,
        constraints: RegionConstraints,
    ) -> None:
        super().__init__()
        self._tip_frames, self._box, self._constraints = list(tip_frames), box, constraints
        self._rays = np.stack([np.cos(azimuths), np.sin(azimuths), np.zeros(len(azimuths))], axis=1)
        waiting = constraints.standoff + constraints.tip_radius(0)
        self._waiting_radius = ring_radius - waiting
        n = len(self._tip_frames)
        self._X_WO = self.DeclareAbstractInputPort(
            "X_WO_estimated", AbstractValue.Make(RigidTransform())
        )
        self._weights = self.DeclareVectorInputPort("contact_weights", n)
        self._obstacles = self.DeclareAbstractInputPort(
            "obstacles", AbstractValue.Make(Obstacles())
        )
        self._close = self.DeclareVectorInputPort("close", 1)
        self.DeclareAbstractOutputPort(
            "fingertip_targets", lambda: AbstractValue.Make(BusValue()), self._calc_targets
        )
        self.DeclareVectorOutputPort("contact_status", n, self._calc_status)

    def _contacts(self, context: Context) -> tuple[FloatArray, FloatArray]:
        """Returns where the rays meet the object, and the outward normals there, in W."""
        X_WO: RigidTransform = self._X_WO.Eval(context)
        R_WO = X_WO.rotation().matrix()
        rays = self._rays @ R_WO
        reached = self._box.size / 2 / np.maximum(np.abs(rays), 1e-12)
        p_OC = rays * np.min(reached, axis=1, keepdims=True)
        face = np.argmin(reached, axis=1)
        normals = np.eye(3)[face] * np.sign(np.take_along_axis(rays, face[:, None], axis=1))
        return X_WO.translation() + p_OC @ R_WO.T, normals @ R_WO.T

    def _goals(self, context: Context) -> tuple[FloatArray, FloatArray]:
        """Returns contacts and outward normals in W: those on the object, or of the ring."""
        if self._close.Eval(context)[0] >= 1:
            return self._contacts(context)
        middle = self._X_WO.Eval(context).translation()
        return middle + self._waiting_radius * self._rays, self._rays

    def _permitted(self, context: Context) -> BoolArray:
        points, normals = self._contacts(context)
        constraints = replace(self._constraints, obstacles=self._obstacles.Eval(context))
        limits = [
            constraints.limits_at(finger, points[[finger]], normals[[finger]])[0][0]
            for finger in range(len(points))
        ]
        permitted: BoolArray = np.array(limits) == Limit.NONE
        return permitted

    def _calc_targets(self, context: Context, output: AbstractValue) -> None:
        targets = BusValue()
        for name, point, normal in zip(self._tip_frames, *self._goals(context), strict=True):
            pose = RigidTransform(RotationMatrix.MakeFromOneVector(-normal, 2), point)
            targets.Set(name, AbstractValue.Make(pose))
        output.set_value(targets)

    def _calc_status(self, context: Context, output: BasicVector) -> None:
        lost = np.isneginf(self._weights.Eval(context))
        status = np.where(self._permitted(context), ContactStatus.ACTIVE, ContactStatus.OBSTRUCTED)
        output.SetFromVector(np.where(lost, ContactStatus.LOST, status).astype(float))
