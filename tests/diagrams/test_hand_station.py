"""The plant with object and hand, and its collision filters."""

from itertools import combinations

import numpy as np
from pydrake.multibody.plant import MultibodyPlantConfig

from drake_pregrasp import Box, Conveyor, HandStation, load_hand

HAND = load_hand("package://drake_pregrasp/five_finger_hand.yaml")


def test_the_box_meets_table_and_hand_and_of_the_hand_only_tips_meet():
    config = MultibodyPlantConfig(time_step=0.01, discrete_contact_approximation="lagged")
    station = HandStation(Box(), Conveyor(), config, HAND, friction=0.7, initial=np.zeros(19))
    plant, inspector = station.plant, station.scene_graph.model_inspector()

    def shapes(*bodies):
        return {
            inspector.GetName(g).split("::")[-1] + f" of {body}": g
            for body in bodies
            for g in plant.GetCollisionGeometriesForBody(plant.GetBodyByName(body))
        }

    def meet(one, other):
        return not inspector.CollisionFiltered(one, other)

    (box,) = shapes("object").values()
    (table,) = shapes("turntable").values()
    last = shapes(*(f"finger_{i}_distal" for i in range(5)))
    first = shapes(*(f"finger_{i}_proximal" for i in range(5)))
    assert all(meet(part, box) for part in (table, *last.values(), *first.values()))
    assert not any(meet(a, b) for a, b in combinations(first.values(), 2))
    assert not any(meet(a, b) for a in first.values() for b in last.values())
    assert meet(last["tip of finger_0_distal"], last["tip of finger_1_distal"])
