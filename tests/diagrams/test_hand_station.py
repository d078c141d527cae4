"""The plant with object and hand: what collides, and the forces of links that touch something."""

from itertools import combinations

import numpy as np
import pytest
from five_finger_hand import HAND
from pydrake.multibody.plant import MultibodyPlantConfig
from pydrake.systems.analysis import Simulator

from drake_pregrasp import Box, Conveyor, HandStation
from drake_pregrasp.systems.link_contacts import TOUCHED

PLANT = MultibodyPlantConfig(time_step=0.005, discrete_contact_approximation="lagged")
P_WO = np.array([0.0, 0.0, 0.05])
HOME = HAND.home(P_WO, 0.0)


def make_station(initial, size=0.1):
    return HandStation(
        Box(size=[size] * 3), Conveyor(), PLANT, HAND.description, friction=0.7, initial=initial
    )


def test_links_collide_with_all_but_their_own_finger_and_the_base():
    station = make_station(HOME)
    plant, inspector = station.plant, station.scene_graph.model_inspector()

    def shapes(*bodies):
        named = [plant.GetBodyByName(body) for body in bodies]
        return [g for body in named for g in plant.GetCollisionGeometriesForBody(body)]

    def meet(some, others):
        return {not inspector.CollisionFiltered(a, b) for a in some for b in others}

    fingers = [
        shapes(*(f"finger_{i}_{link}" for link in ("knuckle", "proximal", "distal")))
        for i in range(5)
    ]
    links = [geometry for finger in fingers for geometry in finger]
    assert len(links) == 25
    assert meet(links + shapes("palm"), shapes("turntable")) == {True}
    for link in links + shapes("palm"):  # Of hull and mesh of the object, it meets one.
        met = [not inspector.CollisionFiltered(link, g) for g in shapes("object")]
        assert met.count(True) == 1
    for one, other in combinations(fingers, 2):
        assert meet(one, other) == {True}
    for finger in fingers:
        assert meet(finger, shapes("palm")) == {False}
        assert {inspector.CollisionFiltered(a, b) for a, b in combinations(finger, 2)} == {True}


RAISED = [0.0, 0.0, 0.4]
STRETCHED, FOLDED = [0.0, 1.5, 0.0], [0.0, 0.0, 2.4]


@pytest.mark.parametrize(
    ("touched", "place", "fingers"),
    [
        ((), P_WO, [HOME[4:7]] * 5),
        (("object",), [0.0, 0.0, -0.063], [STRETCHED] * 5),  # With the palm.
        (("surroundings",), [0.0, 0.1, -0.057], [FOLDED, *[STRETCHED] * 4]),  # With an elbow.
        (("hand",), P_WO, [[0.5, *HOME[5:7]], [-0.5, *HOME[5:7]], *[HOME[4:7]] * 3]),
        # A fingertip alone touches the link of another finger, before or after it in order.
        (("hand",), RAISED, [[-0.75, 0.88, 1.72], *[HOME[4:7]] * 4]),
        (("hand",), RAISED, [*[HOME[4:7]] * 4, [0.75, 0.88, 1.72]]),
    ],
)
def test_links_that_touch_something_are_measured(touched, place, fingers):
    initial = HAND.home(np.array(place), 0.0)
    initial[4:] = np.ravel(fingers)
    station = make_station(initial, size=0.04 if touched == ("surroundings",) else 0.1)
    simulator = Simulator(station)
    context = simulator.get_mutable_context()
    desired = np.concatenate([initial, np.zeros_like(initial)])
    station.GetInputPort("desired_state").FixValue(context, desired)
    simulator.AdvanceTo(0.015)
    forces = station.GetOutputPort("link_forces").Eval(context)
    assert {name for name, force in zip(TOUCHED, forces, strict=True) if force > 0} == set(touched)
