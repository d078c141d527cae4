import dataclasses

import numpy as np
import pytest
from made_systems import PERIOD, Driven, make_partitioner, make_selector
from pydrake.common.value import AbstractValue
from pydrake.math import RigidTransform, RollPitchYaw

from drake_pregrasp import BlendConfig, ContactStatus, ForbiddenPoints, InvalidArgumentError
from drake_pregrasp.contacts.centroids import position_tracking, select_contacts
from drake_pregrasp.contacts.selection_input import SelectionInput
from drake_pregrasp.contacts.strategies import make_blend, make_strategy
from drake_pregrasp.regions.constraints import Obstacles
from drake_pregrasp.regions.safe_regions import compute_safe_regions

X_WO = RigidTransform(RollPitchYaw(0.2, -0.4, 1.0), [0.5, -0.3, 0.2])
COVARIANCE = 1e-6 * np.eye(3)


def in_world(p_OC):
    return (X_WO @ p_OC.T).T.ravel()


def partition(surface, p_OC, weights=None, obstacles=None):
    driven = Driven(make_partitioner(surface), X_WO_estimated=X_WO, p_WC=in_world(p_OC))
    if weights is not None:
        driven.fix(contact_weights=weights)
    if obstacles is not None:
        driven.fix(obstacles=AbstractValue.Make(Obstacles(points=obstacles)))
    return driven.eval("safe_regions")


def test_partitioner_computes_in_the_object_frame(surface, p_OC):
    expected = compute_safe_regions(surface.p_OQ, p_OC, np.zeros(5), surface.forbidden)
    regions = partition(surface, p_OC)
    assert np.mean(regions.labels != expected.labels) < 0.01  # Rounding may decide ties.


def test_partitioner_uses_weights(surface, p_OC):
    weights = np.array([0, 0, 1e-3, 0, -np.inf])
    expected = compute_safe_regions(surface.p_OQ, p_OC, weights, surface.forbidden)
    regions = partition(surface, p_OC, weights=weights)
    assert np.mean(regions.labels != expected.labels) < 0.01
    assert regions.sizes()[4] == 0


def test_partitioner_takes_obstacles_in_the_world(surface, p_OC):
    p_OZ = np.array([[0.06, 0.0, 0.0]])
    radii = np.array([0.03])
    obstacles = ForbiddenPoints((X_WO @ p_OZ.T).T, radii)
    expected = compute_safe_regions(
        surface.p_OQ, p_OC, np.zeros(5), surface.forbidden.joined(ForbiddenPoints(p_OZ, radii))
    )
    regions = partition(surface, p_OC, obstacles=obstacles)
    assert np.mean(regions.labels != expected.labels) < 0.01
    assert regions.sizes()[4] < partition(surface, p_OC).sizes()[4]


def selector_and_context(surface, p_OC, **settings):
    system = make_selector(surface, p_OC, **settings)
    context = system.CreateDefaultContext()
    regions = compute_safe_regions(surface.p_OQ, p_OC, np.zeros(len(p_OC)), surface.forbidden)
    system.GetInputPort("X_WO_estimated").FixValue(context, X_WO)
    system.GetInputPort("p_WO_covariance").FixValue(context, COVARIANCE.ravel())
    system.GetInputPort("safe_regions").FixValue(context, AbstractValue.Make(regions))
    selection = SelectionInput(surface, p_OC, regions, COVARIANCE + 0.04**2 * np.eye(3))
    return system, context, select_contacts(selection, position_tracking)


def test_selector_emits_the_goals_of_this_tick(surface, p_OC):
    system, context, expected = selector_and_context(surface, p_OC)
    p_WC = system.GetOutputPort("p_WC").Eval(context)
    np.testing.assert_allclose(p_WC, in_world(expected.p_OC), atol=1e-15)
    status = system.GetOutputPort("contact_status").Eval(context)
    np.testing.assert_array_equal(status, ContactStatus.ACTIVE)


def test_selector_emits_the_same_goals_before_and_after_storing_them(surface, p_OC):
    system, context, _ = selector_and_context(surface, p_OC)
    before = system.GetOutputPort("p_WC").Eval(context).copy()
    previous = system.GetOutputPort("p_WC_previous")
    np.testing.assert_allclose(previous.Eval(context), in_world(p_OC), atol=1e-15)
    context.SetDiscreteState(system.EvalUniquePeriodicDiscreteUpdate(context))
    np.testing.assert_array_equal(system.GetOutputPort("p_WC").Eval(context), before)
    np.testing.assert_array_equal(previous.Eval(context), before)


def test_selector_turns_the_covariance_into_the_objects_frame(surface, p_OC):
    covariance_W = np.diag([4e-3, 1e-4, 1e-3])
    system, context, _ = selector_and_context(surface, p_OC)
    system.GetInputPort("p_WO_covariance").FixValue(context, covariance_W.ravel())
    R_OW = X_WO.rotation().inverse().matrix()
    regions = compute_safe_regions(surface.p_OQ, p_OC, np.zeros(5), surface.forbidden)
    covariance_O = R_OW @ covariance_W @ R_OW.T + 0.04**2 * np.eye(3)
    expected = select_contacts(
        SelectionInput(surface, p_OC, regions, covariance_O), position_tracking
    )
    p_WC = system.GetOutputPort("p_WC").Eval(context)
    np.testing.assert_allclose(p_WC, in_world(expected.p_OC), atol=1e-12)


def test_selector_starts_from_the_state_in_its_context(surface, p_OC):
    system, context, _ = selector_and_context(surface, p_OC, static_duration=1.0)
    assert np.max(np.abs(system.GetOutputPort("p_WC").Eval(context) - in_world(p_OC))) < 1e-12
    moved = -p_OC * [1, 1, -1]
    context.get_mutable_discrete_state(1).SetFromVector(moved.ravel())
    assert np.max(np.abs(system.GetOutputPort("p_WC").Eval(context) - in_world(moved))) < 1e-12


def test_a_hand_that_closes_holds_goals_where_they_are_on_the_object(surface, p_OC):
    system, context, _ = selector_and_context(surface, p_OC)
    context.SetDiscreteState(system.EvalUniquePeriodicDiscreteUpdate(context))
    stored = context.get_discrete_state(1).value().reshape(-1, 3)
    status = system.GetOutputPort("contact_status").Eval(context).copy()
    later = RigidTransform(RollPitchYaw(0.1, 0.2, -0.7), [0.3, 0.1, 0.0])
    context.SetTime(PERIOD)
    system.GetInputPort("X_WO_estimated").FixValue(context, later)
    system.GetInputPort("p_WO_covariance").FixValue(context, np.diag([4e-3, 1e-4, 1e-3]).ravel())
    moving = system.GetOutputPort("p_WC").Eval(context).copy()
    system.GetInputPort("hold_contacts").FixValue(context, [1.0])
    held = system.GetOutputPort("p_WC").Eval(context)
    np.testing.assert_allclose(held.reshape(-1, 3), (later @ stored.T).T, atol=1e-12)
    np.testing.assert_array_equal(system.GetOutputPort("contact_status").Eval(context), status)
    system.GetInputPort("hold_contacts").FixValue(context, [0.0])
    np.testing.assert_array_equal(system.GetOutputPort("p_WC").Eval(context), moving)
    assert not np.allclose(held, moving)


def test_held_contacts_on_forbidden_ground_are_inactive(surface, p_OC):
    p_OC = p_OC.copy()
    p_OC[0] = [0.0, 0.0, 0.05]
    open_top = dataclasses.replace(surface, forbidden=ForbiddenPoints.none())
    system, context, _ = selector_and_context(open_top, p_OC, static_duration=1.0)
    status = system.GetOutputPort("contact_status").Eval(context)
    assert list(status) == [ContactStatus.NO_ALLOWED_GROUND, 1, 1, 1, 1]


def test_a_lost_contact_has_no_fingertip_target(surface, p_OC):
    system, context, _ = selector_and_context(surface, p_OC)
    weights = np.array([0, 0, -np.inf, 0, 0])
    regions = compute_safe_regions(surface.p_OQ, p_OC, weights, surface.forbidden)
    system.GetInputPort("safe_regions").FixValue(context, AbstractValue.Make(regions))
    targets = system.GetOutputPort("fingertip_targets").Eval(context)
    assert [targets.Find(f"fingertip_{i}") is not None for i in range(5)] == [1, 1, 0, 1, 1]


def test_selector_holds_the_static_contacts_on_the_object(surface, p_OC):
    system, context, _ = selector_and_context(surface, p_OC, static_duration=4.0)
    for k in (0, 1, 79):
        context.SetTime(k * PERIOD)
        p_WC = system.GetOutputPort("p_WC").Eval(context)
        np.testing.assert_array_equal(p_WC, in_world(p_OC))
    context.SetTime(80 * PERIOD)
    assert np.max(np.abs(system.GetOutputPort("p_WC").Eval(context) - in_world(p_OC))) > 1e-3


def test_selector_breaks_the_loop_to_the_partitioner(surface, p_OC):
    system, _, _ = selector_and_context(surface, p_OC)
    regions = system.GetInputPort("safe_regions").get_index()
    for name, depends in (("p_WC", True), ("p_WC_previous", False)):
        output = system.GetOutputPort(name).get_index()
        assert system.HasDirectFeedthrough(regions, output) == depends


def test_fingertip_targets_look_into_the_object(surface, p_OC):
    names = [f"hand::tip_{i}" for i in range(5)]
    system, context, expected = selector_and_context(surface, p_OC, fingertip_frames=names)
    targets = system.GetOutputPort("fingertip_targets").Eval(context)
    _, normals = surface.project(expected.p_OC)
    for name, p_OCi, normal in zip(names, expected.p_OC, normals, strict=True):
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
    selector = make_selector(surface, p_OC, **arguments)
    context = selector.CreateDefaultContext()
    regions = compute_safe_regions(surface.p_OQ, p_OC, np.zeros(5), surface.forbidden)
    for name, value in (
        ("X_WO_estimated", RigidTransform()),
        ("p_WO_covariance", np.zeros(9)),
        ("safe_regions", AbstractValue.Make(regions)),
    ):
        selector.GetInputPort(name).FixValue(context, value)
    chosen = SelectionInput(surface, p_OC, regions, 0.04**2 * np.eye(3))
    expected = select_contacts(chosen, strategy, in_turns=in_turns).p_OC
    actual = selector.GetOutputPort("p_WC").Eval(context).reshape(-1, 3)
    np.testing.assert_allclose(actual, expected, atol=1e-12)


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
