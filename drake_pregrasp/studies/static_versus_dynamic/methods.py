"""Compared methods of the study, and the system that re-assigns the contacts of a fixed plan."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from pydrake.math import RigidTransform
from pydrake.systems.framework import BusValue, Context, DiscreteValues, LeafSystem

from drake_pregrasp.arrays import FloatArray, IntArray
from drake_pregrasp.contacts.assignment import mean_angle, wrapped
from drake_pregrasp.contacts.selection_input import ContactStatus
from drake_pregrasp.simulation.scenario_file import read_mapping
from drake_pregrasp.systems.ports import BUS, POSE, declare_output, pose_bus

_LARGEST_MEAN_OFFSET = float(np.radians(40))  # Largest mean angle between fingers and contacts.


@dataclass(frozen=True)
class Method:
    """A method that chooses the contacts of a trial.

    Attributes:
        label: Name of the method in tables and figures.
        text: Description of the method's contacts.
        color: Colour of the method in figures, as hexadecimal RGB.
        marker: Matplotlib marker of the method in figures.
        plans_start: Whether contacts are planned at the start, from random initial contacts.
        replans: Whether contacts are planned at every tick.
        uses_reach: Whether planning at every tick respects the reach of the fingers.
        is_reassigned: Whether contacts are assigned to other fingers as the object turns.
        is_stationary: Whether the hand does not turn with the object.
        is_reactive: Whether a grasp is chosen at every tick by distance and alignment.
    """

    label: str
    text: str
    color: str
    marker: str
    plans_start: bool = False
    replans: bool = False
    uses_reach: bool = False
    is_reassigned: bool = False
    is_stationary: bool = False
    is_reactive: bool = False


# The methods by their keys, in the order of tables and figures.
METHODS = {
    key: Method(**fields)
    for key, fields in read_mapping(Path(__file__).with_name("methods.yaml")).items()
}

TESTED = "dynamic_reach"  # Key of the method that is tested against each other method.


def rays_at(azimuths: FloatArray) -> FloatArray:
    """Returns the horizontal unit vectors at azimuths in radians, shape (n, 3)."""
    return np.stack([np.cos(azimuths), np.sin(azimuths), np.zeros(len(azimuths))], axis=1)


def declare_goals(
    system: LeafSystem,
    tip_frames: Sequence[str],
    targets: Callable[[Context], Mapping[int, RigidTransform]],
    status: Callable[[Context], FloatArray],
) -> None:
    """Declares the output ports of the hand's goals.

    Args:
        system: System with an input port `contact_weights`, which marks lost fingers.
        tip_frames: Scoped names of the fingertips' frames.
        targets: Function that returns the targets X_WC by the fingers' indices.
        status: Function that returns the contact status of each finger, shape (n,), without regard
            to lost fingers.
    """

    def calc_targets(context: Context) -> BusValue:
        return pose_bus({tip_frames[f]: X_WC for f, X_WC in targets(context).items()})

    def calc_status(context: Context) -> FloatArray:
        lost = np.isneginf(system.GetInputPort("contact_weights").Eval(context))
        return np.where(lost, float(ContactStatus.LOST), status(context))

    everything = system.all_sources_ticket()
    declare_output(system, "fingertip_targets", BUS, calc_targets, everything)
    declare_output(system, "contact_status", len(tip_frames), calc_status, everything)


class Reassignment(LeafSystem):
    """Assigns each finger to the contact of its neighbour when the object has turned far.

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

    The ports are those of `PregraspPlanner`. Losses concern fingers, not contacts. If the mean
    angle from the fingers to their contacts about z of H exceeds 40 degrees, every finger changes
    to a neighbouring contact, which reduces the angle.

    Args:
        tip_frames: Scoped names of the fingertips' frames.
        azimuths: Azimuths of the fingers about z of H, shape (n,), in radians, in order around H.
        period: Seconds between ticks.
    """

    def __init__(self, tip_frames: Sequence[str], *, azimuths: FloatArray, period: float) -> None:
        super().__init__()
        self._tip_frames, self._azimuths = np.array(tip_frames), np.array(azimuths)
        self._shift = self.DeclareDiscreteState(1)
        self._given = self.DeclareAbstractInputPort("fingertip_targets", BUS)
        self._given_status = self.DeclareVectorInputPort("contact_status", len(tip_frames))
        self.DeclareVectorInputPort("contact_weights", len(tip_frames))
        self._X_WH = self.DeclareAbstractInputPort("X_WH", POSE)
        declare_goals(self, tip_frames, self._targets, self._status)
        self.DeclarePeriodicDiscreteUpdateEvent(period, 0.0, self._update_shift)

    def _contact_of_finger(self, context: Context) -> IntArray:
        shift = int(context.get_discrete_state(self._shift).value()[0])
        return (np.arange(len(self._tip_frames)) + shift) % len(self._tip_frames)

    def _update_shift(self, context: Context, discrete_state: DiscreteValues) -> None:
        targets = self._targets(context)
        if not targets:
            return
        X_HW: RigidTransform = self._X_WH.Eval(context).inverse()
        p_HC = np.array([(X_HW @ X_WC).translation() for X_WC in targets.values()])
        offsets = wrapped(np.arctan2(p_HC[:, 1], p_HC[:, 0]) - self._azimuths[list(targets)])
        mean = mean_angle(offsets)
        if abs(mean) > _LARGEST_MEAN_OFFSET:
            shift = context.get_discrete_state(self._shift).value()[0] - np.sign(mean)
            discrete_state.set_value(self._shift, [shift])

    def _targets(self, context: Context) -> Mapping[int, RigidTransform]:
        given: BusValue = self._given.Eval(context)
        found = map(given.Find, self._tip_frames[self._contact_of_finger(context)])
        return {finger: X_WC for finger, X_WC in enumerate(found) if X_WC is not None}

    def _status(self, context: Context) -> FloatArray:
        return np.asarray(self._given_status.Eval(context))[self._contact_of_finger(context)]
