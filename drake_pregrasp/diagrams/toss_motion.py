"""The object in free flight."""

import numpy as np
from pydrake.math import RigidTransform, RollPitchYaw
from pydrake.multibody.math import SpatialVelocity
from pydrake.multibody.plant import AddMultibodyPlant, MultibodyPlantConfig
from pydrake.systems.framework import DiagramBuilder

from drake_pregrasp.diagrams.motion_config import Toss
from drake_pregrasp.diagrams.moving_object import MovingObject, add_model, add_pose_output
from drake_pregrasp.diagrams.object_body import add_object_body, add_solid_collision
from drake_pregrasp.diagrams.object_config import ObjectConfig
from drake_pregrasp.systems.launch import Launch


def add_toss(
    builder: DiagramBuilder,
    object_config: ObjectConfig,
    motion: Toss,
    plant_config: MultibodyPlantConfig,
) -> MovingObject:
    """Launches the object into the air in the plant's first step.

    A plant in steps of h falls by g t (t + h)/2. A launch that is faster by g h/2 upwards makes
    the parabola of the centre of mass exact at the steps, for any h. The orientation of a
    tumbling body still has an error of the order of h.
    """
    plant, scene_graph = AddMultibodyPlant(plant_config, builder)
    body = add_object_body(plant, object_config)
    if motion.table:
        add_solid_collision(plant, body, object_config)
        add_model(plant, "table.sdf")
    plant.Finalize()
    R_WO = RollPitchYaw(motion.rpy).ToRotationMatrix()
    p_OCoM = body.CalcCenterOfMassInBodyFrame(plant.CreateDefaultContext())
    plant.SetDefaultFloatingBaseBodyPose(
        body, RigidTransform(R_WO, np.array(motion.position) - R_WO @ p_OCoM)
    )
    half_step = -plant.gravity_field().gravity_vector() * plant.time_step() / 2
    V_WOcm = SpatialVelocity(w=motion.spin, v=np.array(motion.velocity) + half_step)
    launch = builder.AddNamedSystem("launch", Launch(plant, body, V_WOcm))
    builder.Connect(launch.get_output_port(), plant.get_applied_spatial_force_input_port())
    return MovingObject(plant, scene_graph, add_pose_output(builder, plant, body))
