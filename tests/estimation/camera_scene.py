"""A camera that sees a mesh, and an estimator of the mesh's pose."""

import time
from typing import NamedTuple

import numpy as np
import trimesh
from pydrake.geometry import Box as BoxShape
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.multibody.math import SpatialVelocity
from pydrake.planning import RobotDiagramBuilder
from pydrake.systems.analysis import Simulator
from scipy.spatial.transform import Rotation

import drake_pregrasp as dp
from drake_pregrasp.arrays import FloatArray
from drake_pregrasp.config.object_config import Mesh
from drake_pregrasp.config.planner_config import filter_noise
from drake_pregrasp.diagrams.object_body import add_object
from drake_pregrasp.diagrams.wiring import connect
from drake_pregrasp.estimation.point_measurement import SeenObject
from drake_pregrasp.estimation.surface_alignment import SurfacePoints
from drake_pregrasp.fast import default_kernels
from drake_pregrasp.geometry.mesh_solid import MeshSolid
from drake_pregrasp.geometry.resting import settled_rotation
from drake_pregrasp.systems.ports import points_in

RATE = 30.0  # Pictures per second.
SPEED, TURN_RATE = 0.2, 0.5  # Of a tracked object, in m/s and rad/s.
CONFIG = dp.EstimatorConfig(rests_on_table=True)


class Tracked(NamedTuple):
    """Errors while an object moves.

    Attributes:
        distances: Errors of the position of its centre, shape (k,), in metres.
        angles: Errors of its orientation, shape (k,), in radians.
        load: Processor seconds a second for camera and filter.
    """

    distances: FloatArray
    angles: FloatArray
    load: float


class Scene:
    """A mesh over a table, cameras that see it, and an estimator of its pose.

    Args:
        name: Name of a shipped mesh.
        cameras: Number of cameras, 1 or 2; the second one looks from the opposite side.
    """

    def __init__(self, name: str, cameras: int = 1) -> None:
        shape = Mesh(file=f"package://drake_pregrasp/{name}.obj").make_shape()
        self.mesh, self.solid = shape.mesh, MeshSolid.of(shape.mesh)
        self.alike = self.symmetry()
        builder = RobotDiagramBuilder(time_step=0.01)
        self.plant, inner = builder.plant(), builder.builder()
        self.body = add_object(self.plant, shape, 0.3)
        table, grey = BoxShape(3.0, 3.0, 0.1), np.array([0.5, 0.5, 0.5, 1.0])
        X_WT, world = RigidTransform([0.0, 0.0, -0.05]), self.plant.world_body()
        self.plant.RegisterVisualGeometry(world, X_WT, table, "table", grey)
        self.plant.mutable_gravity_field().set_gravity_vector(np.zeros(3))
        self.plant.Finalize()
        places = [dp.CameraConfig(), dp.CameraConfig(position=[-0.45, 0.45, 0.45])][:cameras]
        self.config = dp.DepthSensorConfig(places, period=1 / RATE, latency=1 / RATE)
        graph = builder.scene_graph()
        self.sensor = inner.AddNamedSystem("sensor", dp.DepthSensor(self.config, graph))
        inner.Connect(graph.get_query_output_port(), self.sensor.GetInputPort("query_object"))
        self.estimator = inner.AddNamedSystem(
            "estimator",
            dp.PoseEstimator(CONFIG, period=1 / RATE, p_OCoM=shape.p_OCoM, object_solid=self.solid),
        )
        connect(inner, self.sensor, "point_cloud measurement_time", self.estimator)
        self.diagram = builder.Build()
        self.seen = SeenObject(
            self.solid,
            filter_noise(CONFIG),
            shape.p_OCoM,
            CONFIG.point_std,
            CONFIG.fewest_points,
            rests_on_table=True,
            align=default_kernels().align_pose(),
        )

    def symmetry(self) -> list[RigidTransform]:
        """Returns the half turns about principal axes that do not change the surface, and none."""
        middle, axes = self.mesh.centroid, self.mesh.principal_inertia_vectors
        turns = [np.eye(3)] + [2 * np.outer(axis, axis) - np.eye(3) for axis in axes]
        poses = [RigidTransform(RotationMatrix(R), middle - R @ middle) for R in turns]
        p_OQ = trimesh.sample.sample_surface(self.mesh, 2000, seed=1)[0]
        return [X for X in poses if np.abs(self.solid.surface.at((X @ p_OQ.T).T)[0]).max() < 1e-3]

    def resting(self, rng: np.random.Generator) -> RigidTransform:
        """Returns a random pose in which the object rests in the middle of the picture."""
        R = Rotation.random(rng=rng).as_matrix()
        turned = trimesh.Trimesh(self.mesh.vertices @ R.T, self.mesh.faces, process=False)
        R = settled_rotation(turned) @ R
        corners = self.solid.corners @ R.T
        middle = (corners.min(axis=0) + corners.max(axis=0)) / 2
        p_WO = np.append(rng.uniform(-0.05, 0.05, 2) - middle[:2], -corners[:, 2].min())
        return RigidTransform(RotationMatrix.ProjectToRotationMatrix(R), p_WO)

    def points(self, X_WO: RigidTransform, seed: int) -> FloatArray:
        """Returns the points of a picture of the object at a pose, shape (N, 3), in metres."""
        context = self.diagram.CreateDefaultContext()
        own = self.plant.GetMyMutableContextFromRoot(context)
        self.plant.SetFreeBodyPose(own, self.body, X_WO)
        system = self.sensor.GetSubsystemByName("object_points")
        own = system.GetMyMutableContextFromRoot(context)
        own.get_mutable_numeric_parameter(0).SetAtIndex(0, float(seed))
        own.SetDiscreteState(system.EvalUniquePeriodicDiscreteUpdate(own))
        context.SetTime(1.5 * self.config.latency)
        return points_in(system.GetOutputPort("point_cloud").Eval(own))

    def off(self, X_WO: RigidTransform, R_WO: FloatArray, p_WO: FloatArray) -> float:
        """Returns the largest distance of the surface from that at another pose, in metres."""
        p_OQ = trimesh.sample.sample_surface(self.mesh, 2000, seed=1)[0]
        p_WQ = (X_WO @ p_OQ.T).T
        return float(np.abs(self.solid.surface.at((p_WQ - p_WO) @ R_WO)[0]).max())

    def fitting(self, p_WQ: FloatArray, R_WO: FloatArray, p_WO: FloatArray) -> float:
        """Returns the share of points that fit to a pose, once it is aligned to them."""
        points = SurfacePoints.seen(p_WQ, CONFIG.point_std)
        std = np.sqrt(np.repeat(self.seen.noise.variances, 3))
        return self.seen.align(self.solid.surface, points, R_WO, p_WO, std).fits / len(p_WQ)

    def tracked(self, rng: np.random.Generator) -> Tracked:
        """Returns errors up to symmetry over two seconds, from the first half second on."""
        X_WO, angle = self.resting(rng), rng.uniform(0, 2 * np.pi)
        v_WO = SPEED * np.array([np.cos(angle), np.sin(angle), 0.0])
        X_WO.set_translation(X_WO.translation() - 1.0 * v_WO)
        simulator = Simulator(self.diagram)
        context = simulator.get_mutable_context()
        own = self.plant.GetMyMutableContextFromRoot(context)
        self.plant.SetFreeBodyPose(own, self.body, X_WO)
        V_WO, spatial = np.array([0.0, 0.0, rng.choice([-1, 1]) * TURN_RATE]), SpatialVelocity
        self.plant.SetFreeBodySpatialVelocity(own, self.body, spatial(V_WO, v_WO))
        estimate, p_OC = self.estimator.GetOutputPort("X_WO_estimated"), self.mesh.centroid
        own_estimator, errors = self.estimator.GetMyContextFromRoot(context), []
        simulator.AdvanceTo(0.5)
        start = time.process_time()
        for tick in range(50, 200):
            simulator.AdvanceTo(0.01 * tick)
            X_WE, X = estimate.Eval(own_estimator), self.plant.EvalBodyPoseInWorld(own, self.body)
            X_OE = X.InvertAndCompose(X_WE)
            alike = [(X_OE @ X_OS).rotation().ToAngleAxis().angle() for X_OS in self.alike]
            errors.append([np.linalg.norm(X_OE @ p_OC - p_OC), min(alike)])
        load = (time.process_time() - start) / 1.5
        return Tracked(*np.array(errors).T, load)
