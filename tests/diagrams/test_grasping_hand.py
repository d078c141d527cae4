"""A hand in a plant of one's own: contacts that are chosen, and checks of those that are given."""

import numpy as np
import pytest
from five_finger_hand import HAND, X_WO
from pydrake.multibody.plant import AddMultibodyPlant, MultibodyPlantConfig
from pydrake.systems.framework import DiagramBuilder

from drake_pregrasp import (
    AddHandController,
    GraspConfig,
    InvalidArgumentError,
    NoGraspError,
    PlannerConfig,
    ScenarioError,
    add_hand_model,
    box_surface,
    load_scenario,
)

SIZE = [0.1, 0.1, 0.1]
SURFACE = box_surface(SIZE, spacing=0.01, forbidden_faces=["+z", "-z"])


def add(p_OC=None, mass=0.4, **config):
    builder = DiagramBuilder()
    settings = MultibodyPlantConfig(time_step=0.01, use_sampled_output_ports=False)
    plant, _ = AddMultibodyPlant(settings, builder)
    robot = add_hand_model(plant, HAND.description)
    plant.Finalize()
    added = AddHandController(
        builder,
        HAND.description,
        SURFACE,
        PlannerConfig(static_duration=0.0),
        plant=plant,
        robot=robot,
        mass=mass,
        X_WO=X_WO,
        p_OC=p_OC,
        config=GraspConfig(**config),
    )
    return builder, plant, robot, added


def test_the_robot_starts_where_its_controller_starts():
    builder, plant, robot, added = add()
    context = builder.Build().CreateDefaultContext()
    q = plant.GetPositions(plant.GetMyContextFromRoot(context), robot)
    np.testing.assert_array_equal(q, added.controller.initial)
    p_WC = added.planner.GetOutputPort("p_WC")
    planning = added.planner.GetMyMutableContextFromRoot(context)
    added.planner.GetInputPort("X_WO_measured").FixValue(planning, X_WO)
    contacts = p_WC.Eval(planning).reshape(-1, 3)
    assert np.max(SURFACE.distance(contacts - X_WO.translation())) < 1e-6


BESIDE = [[1, -0.6, 0], [1, -0.3, 0], [1, 0, 0], [1, 0.3, 0], [1, 0.6, 0]]


@pytest.mark.parametrize("contacts", [BESIDE, BESIDE[:4]])
def test_given_contacts_are_checked_as_on_the_command_line(contacts):
    with pytest.raises(ScenarioError) as of_a_file:
        load_scenario("grasp_five_finger", text=f"{{initial_contacts: {contacts}}}")
    with pytest.raises(InvalidArgumentError) as in_python:
        add(np.array(contacts) * 0.05)
    assert str(of_a_file.value).endswith(str(in_python.value))


@pytest.mark.parametrize(
    ("text", "python"),
    [
        ("{object: {mass: 9}}", {"mass": 9.0}),
        ("{grasp: {touch_force: 3}}", {"touch_force": 3.0}),
        ("{grasp: {least_force: 20}}", {"least_force": 20.0}),
        ("{grasp: {period: 0.002}, plant_config: {time_step: 0.01}}", {"period": 0.002}),
    ],
)
def test_settings_are_checked_as_on_the_command_line(text, python):
    with pytest.raises(ScenarioError) as of_a_file:
        load_scenario("grasp_five_finger", text=text)
    with pytest.raises(InvalidArgumentError) as in_python:
        add(**python)
    assert str(of_a_file.value).endswith(str(in_python.value))


def test_without_a_grasp_python_says_what_is_missing():
    with pytest.raises(NoGraspError, match="for lack of friction"):
        add(mass=0.1, planned_friction=0.02, largest_force=100.0)
