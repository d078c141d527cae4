"""Contacts of a hand's links, which should touch nothing."""

from collections.abc import Callable, Iterator, Mapping, Sequence

import numpy as np
from pydrake.common.value import AbstractValue
from pydrake.geometry import GeometryId
from pydrake.multibody.plant import ContactResults
from pydrake.systems.framework import Context, DiscreteValues, LeafSystem

from drake_pregrasp.arrays import FloatArray, tick_index
from drake_pregrasp.systems.hand_kinematics import HandLink
from drake_pregrasp.systems.mujoco_plant import PairForce

TOUCHED = ("object", "surroundings", "hand")
"""Names of the elements of `link_forces`: the kinds of things that links touch."""


class LinkContacts(LeafSystem):
    """Measures the largest forces of contacts with links that are not fingertips.

    .. pydrake_system::

        name: LinkContacts
        input_ports:
        - contact_results
        output_ports:
        - link_forces

    Port `contact_results` accepts the `ContactResults` of a MultibodyPlant with a hand, or the list
    of `PairForce` of a `MujocoPlant`.

    Port `link_forces` emits a vector of 3: the largest forces since the last tick, in newtons,
    between such a link and the object, the surroundings such as the table, and another finger.

    Args:
        links: Collision geometries of the hand.
        touched: Collision geometries of the object.
        period: Seconds between ticks.
        time_step: Time step of the plant, in seconds.
        results: Model value of port `contact_results`; None for `ContactResults`.
    """

    def __init__(
        self,
        links: Mapping[GeometryId, HandLink],
        touched: Sequence[GeometryId],
        *,
        period: float,
        time_step: float,
        results: AbstractValue | None = None,
    ) -> None:
        super().__init__()
        self._links = {geometry.get_value(): link for geometry, link in links.items()}
        self._object = frozenset(geometry.get_value() for geometry in touched)
        self._period = period
        self._results = self.DeclareAbstractInputPort(
            "contact_results", results or AbstractValue.Make(ContactResults())
        )
        self._largest = self.DeclareDiscreteState(len(TOUCHED))
        self._last = self.DeclareDiscreteState([0.0])
        self.DeclareStateOutputPort("link_forces", self._largest)
        self.DeclarePeriodicDiscreteUpdateEvent(time_step, 0.0, self._update)

    def _update(self, context: Context, discrete_state: DiscreteValues) -> None:
        largest: FloatArray = context.get_discrete_state(self._largest).value().copy()
        tick = tick_index(context.get_time(), self._period)
        if tick > context.get_discrete_state(self._last)[0]:
            largest[:] = 0.0
        for one, other, force in _contacts(self._results.Eval(context)):
            a, b = self._links.get(one), self._links.get(other)
            link = b if a is None or a.is_tip else a
            if link is None or link.is_tip:
                continue
            kind = 2 if a and b else 0 if {one, other} & self._object else 1
            largest[kind] = max(largest[kind], float(np.linalg.norm(force())))
        discrete_state.set_value(self._largest, largest)
        discrete_state.set_value(self._last, [float(tick)])


def _contacts(
    results: ContactResults | list[PairForce],
) -> Iterator[tuple[int, int, Callable[[], FloatArray]]]:
    """Yields the identifiers of each contact's geometries, and a function with its force in W."""
    if isinstance(results, list):
        yield from ((one, other, lambda f=force: f) for one, other, force in results)
        return
    for index in range(results.num_point_pair_contacts()):
        point = results.point_pair_contact_info(index)
        pair = point.point_pair()
        yield pair.id_A.get_value(), pair.id_B.get_value(), point.contact_force
    for index in range(results.num_hydroelastic_contacts()):
        patch = results.hydroelastic_contact_info(index)
        surface = patch.contact_surface()
        force = patch.F_Ac_W().translational
        yield surface.id_M().get_value(), surface.id_N().get_value(), force
