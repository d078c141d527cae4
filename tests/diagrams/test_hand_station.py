"""A plant with object and hand: what collides, forces of links, the loop with a controller."""

import re
from itertools import combinations

import numpy as np
import pytest
from driven import Driven
from five_finger_hand import HAND
from pydrake.multibody.plant import MultibodyPlantConfig

from drake_pregrasp import Box, Conveyor, GraspConfig, HandStation
from drake_pregrasp.diagrams.hand_model import HandModel
from drake_pregrasp.diagrams.object_plant import TABLE
from drake_pregrasp.resources import resource_folder
from drake_pregrasp.simulation.hand_file import HandFile, load_hand
from drake_pregrasp.simulation.scenario import Scenario
from drake_pregrasp.simulation.simulation_diagram import make_diagram
from drake_pregrasp.systems.link_contacts import TOUCHED

PLANT = MultibodyPlantConfig(time_step=0.005, discrete_contact_approximation="lagged")
P_WO = np.array([0.0, 0.0, 0.05])
HOME = HAND.home(P_WO, 0.0)


def make_station(initial, size=0.1):
    return HandStation(Box(size=[size] * 3), Conveyor(), PLANT, HAND, friction=0.7, initial=initial)


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


def test_pads_touch_with_patches_also_if_their_model_has_points(tmp_path):
    models = resource_folder("models")
    soft = re.compile(r"\s*<drake:(compliant|hydro|mesh_res).*")
    (tmp_path / "gripper.sdf").write_text(soft.sub("", (models / "gripper.sdf").read_text()))
    text = (models / "gripper.yaml").read_text()
    hand = text.replace("package://drake_pregrasp/gripper.sdf", str(tmp_path / "gripper.sdf"))
    (tmp_path / "gripper.yaml").write_text(hand)
    gripper = HandModel(load_hand(tmp_path / "gripper.yaml", folders=[tmp_path]))
    initial = gripper.home(P_WO, 0.0)
    box = Box(size=[0.05] * 3)
    station = HandStation(box, Conveyor(), PLANT, gripper, friction=0.7, initial=initial)
    inspector = station.scene_graph.model_inspector()
    are_soft = {
        (jaw, inspector.GetName(geometry)): inspector.GetProximityProperties(geometry).HasProperty(
            "hydroelastic", "compliance_type"
        )
        for jaw in ("jaw_0", "jaw_1")
        for geometry in station.plant.GetCollisionGeometriesForBody(
            station.plant.GetBodyByName(jaw)
        )
    }
    assert sorted(are_soft.values()) == [False, False, True, True]
    assert all(is_soft == name.endswith("pad") for (_, name), is_soft in are_soft.items())


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
    held = Driven(station, desired_state=np.concatenate([initial, np.zeros_like(initial)]))
    held.advance(0.015)
    forces = held.eval("link_forces")
    assert {name for name, force in zip(TOUCHED, forces, strict=True) if force > 0} == set(touched)


BOX = Box(size=[0.08, 0.09, 0.1])
SUNK = 1e-4  # Metres by which feet may be in the table.
SHIPPED = "package://drake_pregrasp/five_finger_hand.yaml"


@pytest.fixture(scope="module")
def driven():
    scenario = Scenario(object=BOX, hand=HandFile(SHIPPED), ring_contacts=5)
    diagram = make_diagram(scenario)
    controller, station = map(diagram.GetSubsystemByName, ("hand_controller", "object_plant"))
    return controller, station, diagram.CreateDefaultContext()


def test_the_first_desired_state_is_the_present_state(driven):
    controller, station, context = driven
    own = station.GetMyContextFromRoot(context)
    desired = station.GetInputPort("desired_state").Eval(own)
    state = station.GetOutputPort("hand_state").Eval(own)
    np.testing.assert_allclose(desired, state, atol=1e-12)
    n = len(controller.initial)
    np.testing.assert_allclose(state[:n], controller.initial, atol=1e-12)


def test_the_controller_sees_the_plants_fingertips(driven):
    controller, station, context = driven
    own = station.plant.GetMyContextFromRoot(context)
    port = controller.GetOutputPort("p_WT")
    p_WT = port.Eval(controller.GetMyContextFromRoot(context)).reshape(-1, 3)
    for tip, point in zip(HAND.description.fingertips, p_WT, strict=True):
        frame = station.plant.GetFrameByName(tip.frame)
        np.testing.assert_allclose(frame.CalcPoseInWorld(own).translation(), point, atol=1e-9)


def test_the_hand_starts_raised_over_the_box_which_stands_on_the_table(driven):
    controller, station, context = driven
    own = station.GetMyContextFromRoot(context)
    p_WO = station.GetOutputPort("X_WO").Eval(own).translation()
    height = TABLE.solid.distance(p_WO[None])
    np.testing.assert_allclose(height, BOX.size[2] / 2, atol=SUNK)
    settings = GraspConfig().make_settings(HAND.description.fingertips)
    raised = p_WO + np.array([0.0, 0.0, settings.approach_height])
    slides = list(HAND.base.joints[:3])
    over_box = HAND.home(raised, 0.0)[slides]
    np.testing.assert_allclose(controller.initial[slides], over_box, atol=SUNK)
