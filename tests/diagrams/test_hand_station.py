"""The plant with object and hand, and its collision filters."""

from itertools import combinations

import numpy as np
from pydrake.multibody.plant import MultibodyPlantConfig

from drake_pregrasp import Box, Conveyor, HandStation, load_hand

HAND = load_hand("package://drake_pregrasp/five_finger_hand.yaml")


def test_the_box_meets_table_and_hand_and_fingers_meet_each_other():
    config = MultibodyPlantConfig(time_step=0.01)
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
    for one, other in combinations(range(5), 2):
        assert meet(first[f"link of finger_{one}_proximal"], last[f"tip of finger_{other}_distal"])
    assert not meet(first["link of finger_0_proximal"], last["link of finger_0_distal"])
