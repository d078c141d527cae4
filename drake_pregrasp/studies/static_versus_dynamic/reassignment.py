"""Contacts that stay on the object while fingers change over, round the hand."""

from collections.abc import Sequence

import numpy as np
from pydrake.common.value import AbstractValue
from pydrake.math import RigidTransform
from pydrake.systems.framework import BasicVector, BusValue, Context, DiscreteValues, LeafSystem

from drake_pregrasp.arrays import FloatArray, IntArray
from drake_pregrasp.contacts.assignment import mean_angle, wrapped
from drake_pregrasp.contacts.selection_input import ContactStatus

_TOO_FAR_ASIDE = float(np.radians(40))


class Reassignment(LeafSystem):
    """Gives each finger the contact of its neighbour when the object has turned far.

    .. pydrake_system::

        name: Reassignment
        input_ports:
        - fingertip_targets
        - contact_status
        - contact_weights
        - X_WH
        output_ports:
        - fingertip_targets
        - contact_status

    The ports are as those of `PregraspPlanner`: it is fingers that are lost, not contacts. When
    contacts are more than 40 degrees aside of their fingers in H on the average, all fingers change
    over to the next contact that way round.

    Args:
        tip_frames: Scoped names of the fingertips' frames.
        azimuths: Of the fingers about z of H, shape (n,), in radians, one after another round it.
        period: Seconds between ticks.
    """

    def __init__(self, *, tip_frames: Sequence[str], azimuths: FloatArray, period: float) -> None:
        super().__init__()
        self._tip_frames, self._azimuths = list(tip_frames), np.array(azimuths)
        n = len(self._tip_frames)
        self._shift = self.DeclareDiscreteState(1)
        self._targets = self.DeclareAbstractInputPort(
            "fingertip_targets", AbstractValue.Make(BusValue())
        )
        self._status = self.DeclareVectorInputPort("contact_status", n)
        self._weights = self.DeclareVectorInputPort("contact_weights", n)
        self._X_WH = self.DeclareAbstractInputPort("X_WH", AbstractValue.Make(RigidTransform()))
        self.DeclareAbstractOutputPort(
            "fingertip_targets", lambda: AbstractValue.Make(BusValue()), self._calc_targets
        )
        self.DeclareVectorOutputPort("contact_status", n, self._calc_status)
        self.DeclarePeriodicDiscreteUpdateEvent(period, 0.0, self._change_over)

    def _contact_of_finger(self, context: Context) -> IntArray:
        shift = int(context.get_discrete_state(self._shift).value()[0])
        return (np.arange(len(self._tip_frames)) + shift) % len(self._tip_frames)

    def _change_over(self, context: Context, discrete_state: DiscreteValues) -> None:
        targets: BusValue = self._targets.Eval(context)
        X_HW: RigidTransform = self._X_WH.Eval(context).inverse()
        contacts = self._contact_of_finger(context)
        there = [
            finger for finger, c in enumerate(contacts) if self._target(targets, c) is not None
        ]
        if not there:
            return
        p_HC = np.array([(X_HW @ self._target(targets, contacts[f])).translation() for f in there])
        aside = wrapped(np.arctan2(p_HC[:, 1], p_HC[:, 0]) - self._azimuths[there])
        mean = mean_angle(aside)
        if abs(mean) > _TOO_FAR_ASIDE:
            shift = context.get_discrete_state(self._shift).value()[0] - np.sign(mean)
            discrete_state.set_value(self._shift, [shift])

    def _target(self, targets: BusValue, contact: int) -> RigidTransform | None:
        return targets.Find(self._tip_frames[contact])

    def _calc_targets(self, context: Context, output: AbstractValue) -> None:
        targets: BusValue = self._targets.Eval(context)
        changed = BusValue()
        for name, contact in zip(self._tip_frames, self._contact_of_finger(context), strict=True):
            target = self._target(targets, contact)
            if target is not None:
                changed.Set(name, AbstractValue.Make(target))
        output.set_value(changed)

    def _calc_status(self, context: Context, output: BasicVector) -> None:
        status: FloatArray = np.asarray(self._status.Eval(context))
        lost = np.isneginf(self._weights.Eval(context))
        changed = status[self._contact_of_finger(context)]
        output.SetFromVector(np.where(lost, float(ContactStatus.LOST), changed))
