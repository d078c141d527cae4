"""The monitor of grasp quality, and the logger of ticks."""

import dataclasses

import numpy as np
import pytest
from driven import Driven
from made_systems import X_WO, regions_of

from drake_pregrasp import ContactStatus, GraspQualityMonitor, InvalidArgumentError, TrackingStatus
from drake_pregrasp.config.planner_config import MeasuresConfig
from drake_pregrasp.quality.grasp_quality import CONTACT_MODELS, grasp_quality
from drake_pregrasp.systems.grasp_quality_monitor import GraspQualityView
from drake_pregrasp.systems.loggers import TickLogger


def quality(p_OC, surface, status=None, **options):
    config = MeasuresConfig(**options)
    monitor = Driven(
        GraspQualityMonitor(config, surface=surface, num_contacts=len(p_OC)),
        p_WC=(X_WO @ p_OC.T).T.ravel(),
        X_WO=X_WO,
    )
    if status is not None:
        monitor.fix(contact_status=status)
    return monitor.array("grasp_quality")


def test_quality_is_about_the_true_centre_of_mass(p_OC, surface):
    p_OCoM = np.array([0.01, 0.0, -0.01])
    expected = grasp_quality(p_OC - p_OCoM)
    measured = quality(p_OC, dataclasses.replace(surface, p_OCoM=p_OCoM))
    np.testing.assert_allclose(measured, expected.to_vector(), rtol=1e-12)
    view = GraspQualityView(measured)
    assert (view.q_msv, view.graspable) == (measured[0], 1)


def test_active_contacts_only_count(p_OC, surface):
    status = np.array([1.0, ContactStatus.INACTIVE, 1.0, ContactStatus.LOST, 1.0])
    expected = grasp_quality(p_OC[[0, 2, 4]]).to_vector()
    np.testing.assert_allclose(quality(p_OC, surface, status), expected, rtol=1e-12)
    nobody = quality(p_OC, surface, np.full(5, float(ContactStatus.LOST)))
    np.testing.assert_array_equal(nobody, [0, 0, 0, 0, 1])


@pytest.mark.parametrize("length", [None, 0.03])
@pytest.mark.parametrize("model", CONTACT_MODELS)
def test_quality_is_that_of_the_contact_model(p_OC, surface, model, length):
    # By default in metres, or for the other models in the cube's half diagonal.
    unit = length or (1.0 if model == "complete" else 0.05 * np.sqrt(3))
    expected = grasp_quality(p_OC, surface.project(p_OC)[1], model=model, length=unit).to_vector()
    options = {"contact_model": model} | ({"length": length} if length else {})
    measured = quality(p_OC, surface, **options)
    np.testing.assert_allclose(measured, expected, rtol=1e-9, atol=1e-15)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"contact_model": "glue"}, "contact_model must be one of: auto, complete"),
        ({"length": -1}, "length must be a number at least 0"),
    ],
)
def test_invalid_arguments_are_refused(p_OC, surface, options, message):
    with pytest.raises(InvalidArgumentError, match=message):
        quality(p_OC, surface, **options)


def test_a_logger_hands_over_each_tick(surface, p_OC):
    records = []
    regions = regions_of(surface, p_OC)
    logger = Driven(
        TickLogger(num_contacts=5, period=0.1, sink=records.append),
        X_WO_estimated=X_WO,
        X_WO=X_WO,
        p_WC=(X_WO @ p_OC.T).T.ravel(),
        contact_status=np.ones(5),
        contact_causes=np.arange(5),
        safe_regions=regions,
        grasp_quality=np.arange(5.0),
        tracking_status=[TrackingStatus.COASTING],
        time_since_measurement=[0.25],
    )
    logger.simulator.Initialize()
    (record,) = records
    np.testing.assert_allclose(record.p_WC, (X_WO @ p_OC.T).T)
    np.testing.assert_array_equal(record.regions.sizes(), regions.sizes())
    np.testing.assert_array_equal(record.contact_causes, np.arange(5))
    assert record.X_WO.IsExactlyEqualTo(X_WO)
    assert record.tracking_status == TrackingStatus.COASTING
    assert record.time_since_measurement == 0.25
    assert record.wall_seconds >= 0
