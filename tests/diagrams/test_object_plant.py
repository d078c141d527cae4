import xml.etree.ElementTree as ET

import numpy as np
import pytest
from pydrake.math import RollPitchYaw
from pydrake.systems.analysis import Simulator

from drake_pregrasp import InvalidArgumentError, ObjectPlant, load_scenario
from drake_pregrasp.config.object_config import Box, Conveyor
from drake_pregrasp.diagrams.object_body import resized_box_sdf
from drake_pregrasp.resources import resource_folder

CUBE = resource_folder("models") / "cube.sdf"


@pytest.mark.parametrize(
    ("size", "v", "w"),
    [([0.1, 0.1, 0.1], 0.001, 0.0174), ([0.2, 0.2, 0.1], 0.02, -0.2), ([0.07, 0.07, 0.075], 0, 0)],
)
def test_the_table_carries_the_object(scenario, size, v, w):
    plant = ObjectPlant(Box(size=size), Conveyor(v, w), scenario.plant_config)
    simulator = Simulator(plant)
    simulator.AdvanceTo(3.0)
    X_WO = plant.GetOutputPort("X_WO").Eval(simulator.get_context())
    lag_w = abs(w) * scenario.plant_config.time_step
    slip = abs(v) * scenario.plant_config.time_step  # The object starts from rest.
    np.testing.assert_allclose(X_WO.translation()[:2], [3 * v, 0], atol=2 * slip + 1e-4)
    assert X_WO.translation()[2] == pytest.approx(size[2] / 2, abs=1e-3)
    assert RollPitchYaw(X_WO.rotation()).yaw_angle() == pytest.approx(3 * w, abs=2 * lag_w + 1e-3)


def test_at_rest_the_object_stays(scenario):
    plant = ObjectPlant(Box(), Conveyor(0, 0), scenario.plant_config)
    simulator = Simulator(plant)
    simulator.AdvanceTo(2.0)
    X_WO = plant.GetOutputPort("X_WO").Eval(simulator.get_context())
    np.testing.assert_allclose(X_WO.translation()[:2], 0, atol=1e-8)


@pytest.mark.parametrize("name", ["a_base", "d_smaller", "e_bigger"])
def test_the_model_has_the_scenarios_size_and_inertia(name):
    config = load_scenario(name).object
    x, y, z = config.size
    model = ET.fromstring(resized_box_sdf(CUBE, config.size, config.mass))
    m = config.mass
    for tag, expected in (
        ("mass", m),
        ("ixx", m / 12 * (y**2 + z**2)),
        ("iyy", m / 12 * (x**2 + z**2)),
        ("izz", m / 12 * (x**2 + y**2)),
    ):
        assert float(model.find(f".//{tag}").text) == pytest.approx(expected)
    radius = float(model.find(".//sphere/radius").text)
    for collision in model.iter("collision"):
        foot = np.array([float(word) for word in collision.find("pose").text.split()[:3]])
        np.testing.assert_allclose(np.abs(foot) + radius, np.array(config.size) / 2)
        assert foot[2] < 0


def test_the_shipped_cube_is_the_base_case():
    config = Box()
    canonical = [
        ET.tostring(ET.fromstring(text))
        for text in (CUBE.read_text(), resized_box_sdf(CUBE, config.size, config.mass))
    ]
    numbers = [
        [float(w) for w in ET.fromstring(c).itertext() for w in w.split()] for c in canonical
    ]
    np.testing.assert_allclose(*numbers, rtol=1e-12)


def test_a_model_that_is_no_box_is_refused(tmp_path):
    for text, problem in (("<sdf", "can't be read"), ("<sdf version='1.9'/>", "no visual named")):
        file = tmp_path / "bad.sdf"
        file.write_text(text)
        with pytest.raises(InvalidArgumentError, match=problem):
            resized_box_sdf(file, [0.1, 0.1, 0.1], 1.0)
