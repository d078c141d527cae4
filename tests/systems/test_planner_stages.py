import dataclasses

import numpy as np
import pytest
from made_systems import PERIOD, X_WO, Driven, make_selector, partition
from pydrake.common.value import AbstractValue
from pydrake.math import RigidTransform, RollPitchYaw

from drake_pregrasp import BlendConfig, ContactStatus, ForbiddenPoints, InvalidArgumentError
from drake_pregrasp.contacts.centroids import position_tracking, select_contacts
from drake_pregrasp.contacts.selection_input import SelectionInput
from drake_pregrasp.contacts.strategies import make_blend, make_strategy
from drake_pregrasp.regions.constraints import Obstacles
from drake_pregrasp.regions.safe_regions import compute_safe_regions

COVARIANCE = 1e-6 * np.eye(3)


def in_world(p_OC):
    return (X_WO @ p_OC.T).T.ravel()


def test_partitioner_computes_in_the_object_frame(surface, p_OC):
    expected = compute_safe_regions(surface.p_OQ, p_OC, np.zeros(5), surface.forbidden)
    regions = partition(surface, p_OC)
    assert np.mean(regions.labels != expected.labels) < 0.01  # Rounding may decide ties.


def test_partitioner_uses_weights(surface, p_OC):
    weights = np.array([0, 0, 1e-3, 0, -np.inf])
    expected = compute_safe_regions(surface.p_OQ, p_OC, weights, surface.forbidden)
    regions = partition(surface, p_OC, {"contact_weights": weights})
    assert np.mean(regions.labels != expected.labels) < 0.01
    assert regions.sizes()[4] == 0


def test_partitioner_takes_obstacles_in_the_world(surface, p_OC):
    p_OZ = np.array([[0.06, 0.0, 0.0]])
    radii = np.array([0.03])
    obstacles = ForbiddenPoints((X_WO @ p_OZ.T).T, radii)
    expected = compute_safe_regions(
        surface.p_OQ, p_OC, np.zeros(5), surface.forbidden.joined(ForbiddenPoints(p_OZ, radii))
    )
    regions = partition(surface, p_OC, {"obstacles": Obstacles(points=obstacles)})
    assert np.mean(regions.labels != expected.labels) < 0.01
    assert regions.sizes()[4] < partition(surface, p_OC).sizes()[4]


def regions_of(surface, p_OC, weights=None):
    weights = np.zeros(len(p_OC)) if weights is None else weights
    return compute_safe_regions(surface.p_OQ, p_OC, weights, surface.forbidden)


def selector_at(surface, p_OC, X=X_WO, **settings):
    return Driven(
        make_selector(surface, p_OC, **settings),
        X_WO_estimated=X,
        p_WO_covariance=COVARIANCE.ravel(),
        safe_regions=AbstractValue.Make(regions_of(surface, p_OC)),
    )


def goals_of(surface, p_OC, covariance=COVARIANCE, strategy=position_tracking, **options):
    covariance_O = covariance + 0.04**2 * np.eye(3)
    chosen = SelectionInput(surface, p_OC, regions_of(surface, p_OC), covariance_O)
    return select_contacts(chosen, strategy, **options).p_OC


def update(selector):
    changed = selector.system.EvalUniquePeriodicDiscreteUpdate(selector.context)
    selector.context.SetDiscreteState(changed)


def test_selector_emits_the_same_goals_of_this_tick_before_and_after_storing_them(surface, p_OC):
    selector = selector_at(surface, p_OC)
    before = selector.array("p_WC")
    np.testing.assert_allclose(before, in_world(goals_of(surface, p_OC)), atol=1e-15)
    np.testing.assert_array_equal(selector.array("contact_status"), ContactStatus.ACTIVE)
    np.testing.assert_allclose(selector.array("p_WC_previous"), in_world(p_OC), atol=1e-15)
    update(selector)
    np.testing.assert_array_equal(selector.array("p_WC"), before)
    np.testing.assert_array_equal(selector.array("p_WC_previous"), before)


def test_selector_turns_the_covariance_into_the_objects_frame(surface, p_OC):
    covariance_W = np.diag([4e-3, 1e-4, 1e-3])
    selector = selector_at(surface, p_OC)
    selector.fix(p_WO_covariance=covariance_W.ravel())
    R_OW = X_WO.rotation().inverse().matrix()
    expected = goals_of(surface, p_OC, R_OW @ covariance_W @ R_OW.T)
    np.testing.assert_allclose(selector.array("p_WC"), in_world(expected), atol=1e-12)


def test_selector_starts_from_the_state_in_its_context(surface, p_OC):
    selector = selector_at(surface, p_OC, static_duration=1.0)
    np.testing.assert_allclose(selector.array("p_WC"), in_world(p_OC), atol=1e-12)
    moved = -p_OC * [1, 1, -1]
    selector.context.get_mutable_discrete_state(1).SetFromVector(moved.ravel())
    np.testing.assert_allclose(selector.array("p_WC"), in_world(moved), atol=1e-12)


def test_a_hand_that_closes_holds_goals_where_they_are_on_the_object(surface, p_OC):
    selector = selector_at(surface, p_OC)
    update(selector)
    stored = selector.context.get_discrete_state(1).value().reshape(-1, 3)
    status = selector.array("contact_status")
    later = RigidTransform(RollPitchYaw(0.1, 0.2, -0.7), [0.3, 0.1, 0.0])
    selector.context.SetTime(PERIOD)
    selector.fix(X_WO_estimated=later, p_WO_covariance=np.diag([4e-3, 1e-4, 1e-3]).ravel())
    moving = selector.array("p_WC")
    selector.fix(hold_contacts=[1.0])
    held = selector.array("p_WC")
    np.testing.assert_allclose(held.reshape(-1, 3), (later @ stored.T).T, atol=1e-12)
    np.testing.assert_array_equal(selector.array("contact_status"), status)
    selector.fix(hold_contacts=[0.0])
    np.testing.assert_array_equal(selector.array("p_WC"), moving)
    assert not np.allclose(held, moving)


def test_held_contacts_on_forbidden_ground_are_inactive(surface, p_OC):
    p_OC = np.vstack([[0.0, 0.0, 0.05], p_OC[1:]])
    open_top = dataclasses.replace(surface, forbidden=ForbiddenPoints.none())
    status = selector_at(open_top, p_OC, static_duration=1.0).array("contact_status")
    assert list(status) == [ContactStatus.NO_ALLOWED_SURFACE, 1, 1, 1, 1]


def test_a_lost_contact_has_no_fingertip_target(surface, p_OC):
    selector = selector_at(surface, p_OC)
    regions = regions_of(surface, p_OC, np.array([0, 0, -np.inf, 0, 0]))
    selector.fix(safe_regions=AbstractValue.Make(regions))
    targets = selector.eval("fingertip_targets")
    assert [targets.Find(f"fingertip_{i}") is not None for i in range(5)] == [1, 1, 0, 1, 1]


def test_selector_holds_the_static_contacts_on_the_object(surface, p_OC):
    selector = selector_at(surface, p_OC, static_duration=4.0)
    for k in (0, 1, 79):
        selector.context.SetTime(k * PERIOD)
        np.testing.assert_array_equal(selector.array("p_WC"), in_world(p_OC))
    selector.context.SetTime(80 * PERIOD)
    assert np.max(np.abs(selector.array("p_WC") - in_world(p_OC))) > 1e-3


def test_selector_breaks_the_loop_to_the_partitioner(surface, p_OC):
    system = make_selector(surface, p_OC)
    regions = system.GetInputPort("safe_regions").get_index()
    for name, depends in (("p_WC", True), ("p_WC_previous", False)):
        output = system.GetOutputPort(name).get_index()
        assert system.HasDirectFeedthrough(regions, output) == depends


def test_fingertip_targets_look_into_the_object(surface, p_OC):
    names = [f"hand::tip_{i}" for i in range(5)]
    targets = selector_at(surface, p_OC, fingertip_frames=names).eval("fingertip_targets")
    expected = goals_of(surface, p_OC)
    for name, p_OCi, normal in zip(names, expected, surface.project(expected)[1], strict=True):
        X_WF = targets.Find(name)
        np.testing.assert_allclose(X_WF.translation(), X_WO @ p_OCi, atol=1e-15)
        z = X_WF.rotation().col(2)
        np.testing.assert_allclose(z, X_WO.rotation() @ -normal, atol=1e-12)


@pytest.mark.parametrize(
    ("arguments", "strategy", "in_turns"),
    [
        ({"strategy": "vew", "power": 3.0}, make_strategy("vew", power=3.0), False),
        ({"strategy": "margin", "friction": 0.3}, make_strategy("margin", friction=0.3), False),
        ({"strategy": "margin", "in_turns": True}, make_strategy("margin"), True),
        (
            {"strategy": "blend", "blend": BlendConfig(vew=1.0, position=2.0), "stretch": False},
            make_blend({"vew": 1, "position": 2}, stretch=False),
            False,
        ),
    ],
)
def test_selector_weighs_as_it_is_told(surface, p_OC, arguments, strategy, in_turns):
    selector = selector_at(surface, p_OC, RigidTransform(), **arguments)
    expected = goals_of(surface, p_OC, strategy=strategy, in_turns=in_turns)
    np.testing.assert_allclose(selector.array("p_WC").reshape(-1, 3), expected, atol=1e-12)


@pytest.mark.parametrize(
    "arguments",
    [
        {"period": 0.0},
        {"position_spread": 0.0},
        {"strategy": "telepathy"},
        {"strategy": "blend"},
        {"strategy": "blend", "blend": BlendConfig(vew=-1.0)},
        {"strategy": "msv", "power": 0.0},
        {"strategy": "margin", "friction": -1.0},
        {"static_duration": np.nan},
        {"p_OC": np.array([[0.0, 0.0, 0.0]])},
        {"p_OC": np.array([[0.05, 0.0, np.nan]])},
        {"p_OC": np.zeros((0, 3))},
        {"fingertip_frames": ["only_one"]},
    ],
)
def test_selector_refuses_bad_arguments(surface, p_OC, arguments):
    with pytest.raises(InvalidArgumentError):
        make_selector(surface, arguments.pop("p_OC", p_OC), **arguments)
