"""A person who moves an object along recorded poses, and lets it go to somebody who takes it."""

import numpy as np
import pytest
from driven import Driven
from pydrake.math import RigidTransform
from pydrake.multibody.math import SpatialVelocity
from pydrake.multibody.plant import MultibodyPlantConfig
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
from scipy.spatial.transform import Rotation

from drake_pregrasp.config.object_config import Mesh, PoseStream
from drake_pregrasp.diagrams.object_plant import add_moving_object
from drake_pregrasp.estimation.recorded_poses import COLUMNS, RecordedPoses
from drake_pregrasp.systems.giver import LETS_GO, Giver

G, MASS, STEP = 9.81, 0.3, 0.005
MUG = Mesh(file="package://drake_pregrasp/mug.obj").make_shape()  # Not about its origin.


def brought(times):
    """Rows of poses along a curve, on which the object turns."""
    s = np.clip(times / 1.5, 0, 1)
    along = 10 * s**3 - 15 * s**4 + 6 * s**5
    p_WO = np.stack([0.6 * along, 0.1 * along, 0.3 + 0.1 * np.sin(np.pi * along)], axis=1)
    R_WO = Rotation.from_rotvec(along[:, None] * [0.2, -0.3, 0.8])
    return p_WO, R_WO


@pytest.mark.slow
def test_an_object_follows_the_recorded_poses(tmp_path):
    times = np.arange(0, 2.001, 0.02)
    p_WO, R_WO = brought(times)
    file, rows = tmp_path / "poses.csv", np.c_[times, p_WO, R_WO.as_quat()[:, [3, 0, 1, 2]]]
    np.savetxt(file, rows, "%.6f", ",", header=",".join(COLUMNS), comments="")
    builder, config = DiagramBuilder(), MultibodyPlantConfig(time_step=STEP)
    stream = PoseStream(file=str(file))
    moving = add_moving_object(builder, MUG, MASS, stream, config, add_more=lambda plant: None)
    builder.ExportOutput(moving.X_WO, "X_WO")
    diagram = builder.Build()
    simulator = Simulator(diagram)
    for time in (0.3, 0.8, 1.2, 2.0):
        simulator.AdvanceTo(time - STEP / 2)  # The plant is at the next time step.
        X_WO = diagram.GetOutputPort("X_WO").Eval(simulator.get_context())
        position, rotation = brought(np.array([time]))
        np.testing.assert_allclose(X_WO.translation(), position[0], atol=1e-3)
        error = Rotation.from_matrix(X_WO.rotation().matrix()) * rotation[0].inv()
        assert np.degrees(error.magnitude()) < 0.2


@pytest.mark.parametrize("share", [0.9, 1.1])
def test_the_giver_lets_go_for_good_of_an_object_that_somebody_pulls_away(share):
    moving = add_moving_object(
        DiagramBuilder(),
        MUG,
        MASS,
        PoseStream(file="package://drake_pregrasp/carried_by_hand.csv"),
        MultibodyPlantConfig(time_step=STEP),
    )
    plant = moving.plant
    body, still = plant.GetBodyByName("object"), SpatialVelocity.Zero()
    poses = RecordedPoses(np.zeros(1), np.array([[0.1, 0.2, 0.3]]), Rotation.identity(1))

    def around(shift):
        """What a plant says of the world and of the body, which is so far from the recording."""
        return {
            "body_poses": [RigidTransform(), RigidTransform([0.1, 0.2, 0.3 + shift])],
            "body_spatial_velocities": [still, still],
        }

    giver = Driven(Giver(plant, body, poses), **around(0.0))
    (force,) = giver.eval("spatial_forces")
    np.testing.assert_allclose(force.F_Bq_W.translational(), [0, 0, MASS * G], rtol=1e-3)
    np.testing.assert_allclose(force.F_Bq_W.rotational(), 0, atol=1e-12)
    np.testing.assert_allclose(force.p_BoBq_B, body.default_com())
    giver.fix(**around(1e-4))
    (force,) = giver.eval("spatial_forces")
    stiffness = (MASS * G - force.F_Bq_W.translational()[2]) / 1e-4
    giver.fix(**around(share * LETS_GO * MASS * G / stiffness))
    giver.tick()
    giver.fix(**around(0.0))
    giver.tick()
    assert len(giver.eval("spatial_forces")) == (share < 1)
