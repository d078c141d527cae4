import dataclasses
import struct

import numpy as np
import pytest
from pydrake.common.value import AbstractValue
from pydrake.geometry import Meshcat, MeshcatParams
from pydrake.math import RigidTransform, RollPitchYaw
from pydrake.systems.analysis import Simulator

from drake_pregrasp import ContactStatus, InvalidArgumentError, box_surface
from drake_pregrasp.config.planner_config import MeasuresConfig
from drake_pregrasp.estimation.pose_track import TrackingStatus
from drake_pregrasp.quality.grasp_quality import CONTACT_MODELS, grasp_quality
from drake_pregrasp.regions.safe_regions import compute_safe_regions
from drake_pregrasp.systems.grasp_quality_monitor import GraspQualityMonitor, GraspQualityView
from drake_pregrasp.systems.loggers import TickLogger
from drake_pregrasp.systems.pregrasp_visualizer import ROOT, PregraspVisualizer

X_WO = RigidTransform(RollPitchYaw(0.1, 0.2, 0.3), [1.0, 2.0, 3.0])


def quality(p_OC, surface, status=None, **options):
    config = MeasuresConfig(**options)
    monitor = GraspQualityMonitor(config, surface=surface, num_contacts=len(p_OC))
    context = monitor.CreateDefaultContext()
    monitor.GetInputPort("p_WC").FixValue(context, (X_WO @ p_OC.T).T.ravel())
    monitor.GetInputPort("X_WO").FixValue(context, X_WO)
    if status is not None:
        monitor.GetInputPort("contact_status").FixValue(context, status)
    return monitor.get_output_port().Eval(context)


def test_monitor_measures_about_the_true_centre_of_mass(p_OC, surface):
    np.testing.assert_allclose(quality(p_OC, surface), grasp_quality(p_OC).to_vector(), rtol=1e-12)
    p_OCoM = np.array([0.01, 0.0, -0.01])
    expected = grasp_quality(p_OC - p_OCoM).to_vector()
    lopsided = dataclasses.replace(surface, p_OCoM=p_OCoM)
    np.testing.assert_allclose(quality(p_OC, lopsided), expected, rtol=1e-12)


def test_monitor_counts_active_contacts_only(p_OC, surface):
    status = np.array([1.0, ContactStatus.INACTIVE, 1.0, ContactStatus.LOST, 1.0])
    expected = grasp_quality(p_OC[[0, 2, 4]]).to_vector()
    np.testing.assert_allclose(quality(p_OC, surface, status), expected, rtol=1e-12)
    nobody = quality(p_OC, surface, np.full(5, float(ContactStatus.LOST)))
    np.testing.assert_array_equal(nobody, [0, 0, 0, 0, 1])


@pytest.mark.parametrize("model", CONTACT_MODELS)
def test_monitor_measures_by_the_contact_model(p_OC, surface, model):
    nhat = surface.project(p_OC)[1]
    expected = grasp_quality(p_OC, nhat, model=model, length=0.03).to_vector()
    measured = quality(p_OC, surface, contact_model=model, length=0.03)
    np.testing.assert_allclose(measured, expected, rtol=1e-9, atol=1e-15)
    # By default in metres, or for the other models in the cube's half diagonal.
    length = 1.0 if model == "complete" else 0.05 * np.sqrt(3)
    expected = grasp_quality(p_OC, nhat, model=model, length=length).to_vector()
    measured = quality(p_OC, surface, contact_model=model)
    np.testing.assert_allclose(measured, expected, rtol=1e-9, atol=1e-15)


def test_monitor_refuses_unusable_arguments(p_OC, surface):
    with pytest.raises(InvalidArgumentError, match="contact_model must be one of: complete"):
        quality(p_OC, surface, contact_model="glue")
    with pytest.raises(InvalidArgumentError, match="length must be a number at least 0"):
        quality(p_OC, surface, length=-1)


def test_monitor_elements_have_names(p_OC, surface):
    view = GraspQualityView(quality(p_OC, surface))
    assert view.q_msv == quality(p_OC, surface)[0]
    assert view.graspable == 1


def fix_planner_outputs(system, context, surface, p_OC):
    regions = compute_safe_regions(surface.p_OQ, p_OC, np.zeros(len(p_OC)), surface.forbidden)
    values = {
        "X_WO_estimated": X_WO,
        "X_WO": X_WO,
        "p_WC": (X_WO @ p_OC.T).T.ravel(),
        "contact_status": np.ones(len(p_OC)),
        "contact_causes": np.arange(len(p_OC)),
        "safe_regions": AbstractValue.Make(regions),
        "p_WO_covariance": 1e-6 * np.eye(3).ravel(),
        "grasp_quality": np.arange(5.0),
        "tracking_status": [float(TrackingStatus.COASTING)],
        "time_since_measurement": [0.25],
    }
    for index in range(system.num_input_ports()):
        port = system.get_input_port(index)
        port.FixValue(context, values[port.get_name()])
    return regions


def test_logger_hands_over_each_tick(surface, p_OC):
    records = []
    logger = TickLogger(num_contacts=5, quality_size=5, period=0.1, sink=records.append)
    context = logger.CreateDefaultContext()
    regions = fix_planner_outputs(logger, context, surface, p_OC)
    Simulator(logger, context).Initialize()
    (record,) = records
    np.testing.assert_allclose(record.p_WC, (X_WO @ p_OC.T).T)
    np.testing.assert_array_equal(record.regions.sizes(), regions.sizes())
    np.testing.assert_array_equal(record.contact_causes, np.arange(5))
    assert record.X_WO.IsExactlyEqualTo(X_WO)
    assert record.tracking_status == TrackingStatus.COASTING
    assert record.time_since_measurement == 0.25
    assert record.wall_seconds >= 0


def test_tiles_have_a_spacing_of_their_own(surface):
    meshcat = Meshcat(MeshcatParams(host="localhost"))
    tiles = box_surface([0.1, 0.1, 0.1], spacing=0.02)
    PregraspVisualizer(
        meshcat=meshcat, surface=surface, tile_surface=tiles, num_contacts=1, publish_period=0.1
    )
    assert meshcat.HasPath(f"{ROOT}/object/tiles/{len(tiles.p_OQ) - 1}")
    assert not meshcat.HasPath(f"{ROOT}/object/tiles/{len(tiles.p_OQ)}")


def test_visualizer_draws_once_and_then_only_moves(surface, p_OC):
    meshcat = Meshcat(MeshcatParams(host="localhost"))
    visualizer = PregraspVisualizer(
        meshcat=meshcat, surface=surface, num_contacts=5, publish_period=0.1, trail_length=3
    )
    for tile in (0, len(surface.p_OQ) - 1):
        assert meshcat.HasPath(f"{ROOT}/object/tiles/{tile}")
    assert not meshcat.HasPath(f"{ROOT}/object/tiles/{len(surface.p_OQ)}")
    assert meshcat.HasPath(f"{ROOT}/object/trails/4/2")
    context = visualizer.CreateDefaultContext()
    fix_planner_outputs(visualizer, context, surface, p_OC)
    meshcat.StartRecording(frames_per_second=10)
    before = len(meshcat.StaticHtml())
    visualizer.ForcedPublish(context)
    assert len(meshcat.StaticHtml()) > before


@pytest.mark.parametrize(("std", "half_axis"), [(1e-3, 0.03), (1e-2, 0.1 / 3), (1e5, 0.1 / 3)])
def test_the_covariance_is_drawn_no_larger_than_there_is_room(surface, p_OC, std, half_axis):
    meshcat = Meshcat(MeshcatParams(host="localhost"))
    visualizer = PregraspVisualizer(
        meshcat=meshcat, surface=surface, num_contacts=5, publish_period=0.1
    )
    context = visualizer.CreateDefaultContext()
    fix_planner_outputs(visualizer, context, surface, p_OC)
    port = visualizer.GetInputPort("p_WO_covariance")
    port.FixValue(context, std**2 * np.eye(3).ravel())
    visualizer.ForcedPublish(context)
    message = meshcat._GetPackedProperty(f"{ROOT}/covariance/axes", "scale")
    last = struct.unpack(">d", message[-8:])[0]  # Numbers are big-endian in MessagePack.
    assert last == pytest.approx(half_axis)
