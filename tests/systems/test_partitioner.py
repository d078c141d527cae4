"""Safe regions through the ports of their system: frames, obstacles, hands, and bad values."""

import numpy as np
import pytest
from broken_values import BAD_NUMBERS, NO_POSES
from made_systems import X_WO, N, partition, sloping_measures
from pydrake.math import RigidTransform, RollPitchYaw, RotationMatrix
from pydrake.multibody.math import SpatialVelocity
from selections import joined

import drake_pregrasp as dp
from drake_pregrasp.contacts.goal_limits import hold_contacts
from drake_pregrasp.contacts.selection_input import ContactStatus, SelectionInput
from drake_pregrasp.regions.constraints import Limit
from drake_pregrasp.regions.coordinates import weight_share
from drake_pregrasp.regions.safe_regions import NO_REGION, compute_safe_regions, safe_region_labels
from drake_pregrasp.regions.walls import WALL_TESTS

TILT = RollPitchYaw(0.1, 0.2, 0.3).ToRotationMatrix().matrix()
BALL = dp.BallSolid(np.array([0.07, 0.0, 0.0]), 0.012)
BOX = dp.BoxSolid(np.array([0.0, 0.08, 0.02]), TILT, np.array([0.05, 0.03, 0.02]))
POINT = dp.ForbiddenPoints(np.array([[-0.06, 0, 0]]), np.array([0.03]))
X_OH = RigidTransform(RollPitchYaw(0.4, 0.1, 0.5), [0.03, 0.01, 0.0])
WEIGHTS = np.array([0, 0, 1e-3, 0, -np.inf])


def ball_reach(center, radius):
    return dp.BallReach(center=list(center), radius=radius)


def differ(a, b):
    """The share of candidates that differ; rounding may decide ties."""
    return np.mean(a.labels != b.labels)


def in_world(value):
    if isinstance(value, dp.Obstacles):
        return value.moved(X_WO.rotation().matrix(), X_WO.translation())
    return X_WO @ value if isinstance(value, RigidTransform) else value


def test_regions_are_those_of_the_printed_equation_in_the_objects_frame(surface, p_OC):
    inputs = {"contact_weights": WEIGHTS, "obstacles": in_world(dp.Obstacles(points=POINT))}
    forbidden = joined(surface.forbidden, POINT)
    expected = compute_safe_regions(surface.p_OQ, p_OC, WEIGHTS, forbidden)
    assert differ(partition(surface, p_OC, inputs), expected) < 0.01


HUGE_WEIGHT = {"contact_weights": [1.0, 0, 0, 0, 0]}


@pytest.mark.parametrize(
    ("inputs", "settings"),
    [
        ({"obstacles": dp.Obstacles((BALL, BOX))}, {"tip_radii": [0.004] * N}),
        ({"X_WH": X_OH}, {"reach": [ball_reach([0.02, 0.0, 0.0], 0.05)] * N}),
        ({"X_WU": X_OH}, {"joint_range": 0.25, "finger_measures": sloping_measures()}),
        *[(HUGE_WEIGHT, {"wall_test": wall_test}) for wall_test in WALL_TESTS[1:]],
    ],
)
def test_limits_of_regions_move_with_the_world(surface, p_OC, inputs, settings):
    here = partition(surface, p_OC, inputs, X=RigidTransform(), **settings)
    inputs = {port: in_world(value) for port, value in inputs.items()}
    there = partition(surface, p_OC, inputs, **settings)
    assert differ(here, there) < 0.01
    np.testing.assert_array_equal(here.limits, there.limits)
    weights = {"contact_weights": inputs.get("contact_weights", np.zeros(N))}
    assert differ(here, partition(surface, p_OC, weights)) > 0.03


def test_without_a_hand_reach_is_in_the_world(surface, p_OC):
    reach = [ball_reach(X_WO @ p_OC[0], 0.03)] + [None] * 4
    in_world = partition(surface, p_OC, reach=reach)
    assert in_world.sizes()[0] > 0
    as_hand = partition(surface, p_OC, {"X_WH": RigidTransform()}, reach=reach)
    np.testing.assert_array_equal(in_world.labels, as_hand.labels)


def test_finger_measures_are_those_of_the_palm(surface, p_OC):
    limited = {"joint_range": 0.25, "finger_measures": sloping_measures()}
    hand = {"X_WH": RigidTransform([9.0, 0.0, 0.0]), "X_WU": X_WO @ X_OH}
    regions, free = partition(surface, p_OC, hand, **limited), partition(surface, p_OC)
    ahead = (X_OH.inverse() @ surface.p_OQ.T)[0] >= 0
    np.testing.assert_array_equal(regions.labels, np.where(ahead, free.labels, NO_REGION))
    hand = {"X_WH": X_WO @ X_OH}  # Without a frame of its own, it is given in that of reach.
    same = partition(surface, p_OC, hand, **limited)
    np.testing.assert_array_equal(same.labels, regions.labels)


def test_reach_limits_the_regions_of_its_finger(surface, p_OC):
    reach = [None, None, None, ball_reach([0.02, 0.0, 0.0], 0.05), None]
    X_OH = RigidTransform(RollPitchYaw(0.4, 0.1, 0.5), p_OC[3] - [0.02, 0.01, 0])
    free = partition(surface, p_OC)
    regions = partition(surface, p_OC, {"X_WH": X_WO @ X_OH}, reach=reach)
    p_OR = X_OH @ np.array([0.02, 0.0, 0.0])
    inside = np.linalg.norm(surface.p_OQ - p_OR, axis=1) <= 0.05
    expected = np.where((free.labels == 3) & ~inside, NO_REGION, free.labels)
    assert 0 < regions.sizes()[3] < free.sizes()[3]
    assert np.mean(regions.labels != expected) < 0.01
    away = partition(surface, p_OC, {"X_WH": RigidTransform([9.0, 0, 0])}, reach=reach)
    assert (away.sizes()[3], away.limits[3]) == (0, Limit.REACH)


def test_a_late_finger_has_no_region_and_its_status_says_why(surface, p_OC):
    lost = partition(surface, p_OC, {"contact_weights": [0, -np.inf, 0, 0, 0]})
    late = partition(surface, p_OC, {"late_fingers": [0, 1, 0, 0, np.nan]})
    np.testing.assert_array_equal(late.labels, lost.labels)
    np.testing.assert_array_equal(late.limits == Limit.LATE, [0, 1, 0, 0, 0])
    held = hold_contacts(SelectionInput(surface, p_OC, late, np.eye(3)))
    assert held.status[1] == ContactStatus.TOO_LATE
    both = {"contact_weights": [0, -np.inf, 0, 0, 0], "late_fingers": np.ones(N)}
    np.testing.assert_array_equal(partition(surface, p_OC, both).lost, [0, 1, 0, 0, 0])


@pytest.mark.parametrize("arguments", [{"clearance": 0.02}, {"tip_radii": [0.02] * N}])
def test_clearance_and_fingertips_set_regions_back_from_obstacles(surface, p_OC, arguments):
    up = X_WO.rotation().matrix()[:, 2]
    obstacles = dp.Obstacles((dp.HalfSpace(X_WO @ np.array([0.0, 0.0, -0.03]), up),))
    before = partition(surface, p_OC, {"obstacles": obstacles})
    after = partition(surface, p_OC, {"obstacles": obstacles}, **arguments)
    lowest = [np.min(surface.p_OQ[r.labels != NO_REGION, 2]) for r in (before, after)]
    assert lowest[1] >= -0.03 + 0.02 - 1e-9 > lowest[0]


@pytest.mark.parametrize("V_WO", [None, SpatialVelocity(w=[0, 0, 0.5], v=[0.02, -0.01, 0.0])])
def test_over_a_horizon_regions_keep_clear_of_where_obstacles_will_be(surface, p_OC, V_WO):
    velocity, horizon, radius = np.array([-0.06, 0.01, 0.0]), 0.9, 0.009
    wall = dp.HalfSpace(np.array([0.12, 0.0, 0.0]), np.array([-1.0, 0.1, 0.0]))
    inputs = {"obstacles": dp.Obstacles((wall,), velocities=velocity[None])}
    # Tilted, so that the order of the rotations matters.
    X = RigidTransform(RollPitchYaw(0.5, -0.4, 0.3), [0.01, 0.0, 0.0])
    tips = {"tip_radii": [radius] * N}
    without = partition(surface, p_OC, inputs, X=X, **tips).labels
    if V_WO is not None:
        inputs["V_WO_estimated"] = V_WO
    labels = partition(surface, p_OC, inputs, X=X, horizon=horizon, **tips).labels
    touched = np.zeros(len(labels), dtype=bool)
    for moment in np.linspace(0.0, horizon, 4):
        X_then = X
        if V_WO is not None:
            turned = RotationMatrix.MakeZRotation(0.5 * moment) @ X.rotation()
            X_then = RigidTransform(turned, X.translation() + moment * V_WO.translational())
        p_WT = X_then @ (surface.p_OQ + radius * surface.nhat_OQ).T
        touched |= wall.moved(np.eye(3), moment * velocity).distance(p_WT.T) < radius
    kept = without != NO_REGION
    assert 0 < np.sum(touched & kept) < np.sum(kept)
    np.testing.assert_array_equal(labels[kept], np.where(touched, NO_REGION, without)[kept])


def test_normals_as_coordinates_keep_regions_to_one_face(surface):
    p_OC = np.array([[0.05, 0.0, 0.0], [0.03, 0.05, 0.0]])
    on_x = surface.nhat_OQ[:, 0] > 0.9
    assert np.any(partition(surface, p_OC).labels[on_x] == 1)
    assert not np.any(partition(surface, p_OC, normal_length=0.2).labels[on_x] == 1)


def coordinates(*fingers):
    return [dp.CoordinateConfig(scale=1.0, fingers=list(fingers))]


def test_a_strong_finger_has_the_places_that_ask_for_force():
    """Eq. 1 as printed over positions and forces, by the ports and by the configuration."""
    bar = dp.box_surface([0.3, 0.06, 0.06], spacing=0.01, forbidden_faces=())
    p_OC = np.array([[0.02, 0.03, 0.0], [-0.03, 0.03, 0.01], [0.09, -0.03, 0.0]])
    share = 30 * weight_share(bar)
    forces = np.array([10.0, 24.0, 11.0])
    config = dp.CoordinateConfig(
        scale=0.3, candidates="weight_share", fingers=(forces / 30).tolist()
    )
    configured = partition(bar, p_OC, coordinates=[config])
    inputs = {"candidate_coordinates": 0.01 * share, "finger_coordinates": 0.01 * forces}
    by_ports = partition(bar, p_OC, inputs, coordinates=coordinates())
    q, c = np.column_stack([bar.p_OQ, 0.01 * share]), np.column_stack([p_OC, 0.01 * forces])
    empty = np.empty((0, 4)), np.empty(0)
    expected = safe_region_labels(q, c, np.zeros(3), *empty)
    np.testing.assert_array_equal(by_ports.labels, expected)
    np.testing.assert_array_equal(configured.labels, expected)
    strong, weak = (share[expected == i].mean() for i in (1, 0))
    before = partition(bar, p_OC).labels
    assert strong - weak > share[before == 1].mean() - share[before == 0].mean() + 3


@pytest.mark.parametrize("number", BAD_NUMBERS)
def test_a_coordinate_without_a_number_is_that_of_the_place_or_left_out(surface, p_OC, number):
    heights, places = surface.p_OQ[:, 2], surface.nearest_candidates(p_OC)
    fingers = 0.03 * np.arange(N)
    fingers[1] = number
    inputs = {"finger_coordinates": fingers, "candidate_coordinates": heights}
    labels = partition(surface, p_OC, inputs, coordinates=coordinates()).labels
    fingers[1] = heights[places[1]]
    inputs["finger_coordinates"] = fingers
    again = partition(surface, p_OC, inputs, coordinates=coordinates()).labels
    np.testing.assert_array_equal(labels, again)
    plain = partition(surface, p_OC).labels
    assert np.any(labels != plain)
    inputs["candidate_coordinates"] = np.append(heights[:-1], number)
    without = partition(surface, p_OC, inputs, coordinates=coordinates()).labels
    np.testing.assert_array_equal(without, plain)


@pytest.mark.parametrize(
    ("arguments", "problem"),
    [
        ({"coordinates": coordinates(1.0)}, r"coordinates\[0\].fingers must be 5 or none, not 1"),
        ({"tip_radii": [0.0] * 3}, "tip_radii must be 5 or none, not 3"),
        ({"tip_radii": [-1.0] * 5}, r"limits.tip_radii\[0\] must be a number at least 0"),
        ({"reach": [None]}, "reach must be 5 or none, not 1"),
        ({"clearance": -1.0}, "limits.clearance must be a number at least 0 .*, not -1"),
        ({"finger_force": 1.0}, "finger_force need the fingers of a hand"),
        ({"tip_gap": 0.1}, "a tip gap or a standoff needs tip_radii"),
        ({"wall_test": "glance"}, "wall_test must be one of: none, normals, surface"),
        ({"normal_length": np.nan}, "normal_length must be a number at least 0"),
    ],
)
def test_settings_that_make_no_sense_are_refused(surface, p_OC, arguments, problem):
    with pytest.raises(dp.InvalidArgumentError, match=problem):
        partition(surface, p_OC, **arguments)


@pytest.mark.parametrize("X", NO_POSES)
def test_without_a_pose_all_regions_are_empty_and_no_contact_is_in_reach(surface, p_OC, X):
    assert np.all(partition(surface, p_OC, X=X).sizes() == 0)
    reach = [ball_reach(X_WO.translation(), 1.0)] * 3 + [None] * 2
    assert np.all(partition(surface, p_OC, reach=reach).sizes() > 0)
    regions = partition(surface, p_OC, {"X_WH": X}, reach=reach)
    np.testing.assert_array_equal(regions.sizes() > 0, [0, 0, 0, 1, 1])
    regions = partition(surface, p_OC, {"X_WU": X}, finger_measures=sloping_measures())
    np.testing.assert_array_equal(regions.limits, Limit.REACH)


@pytest.mark.parametrize("number", BAD_NUMBERS)
def test_a_contact_without_a_place_or_a_weight_is_as_one_that_is_lost(surface, p_OC, number):
    p_WC = (X_WO @ p_OC.T).T
    p_WC[2, 1] = number
    for inputs in ({"p_WC": p_WC.ravel()}, {"contact_weights": [0, 0, np.nan, 0, 0]}):
        regions = partition(surface, p_OC, inputs, tip_radii=[0.009] * N)
        np.testing.assert_array_equal(regions.lost, np.arange(N) == 2)
        np.testing.assert_array_equal(regions.sizes() > 0, np.arange(N) != 2)


@pytest.mark.parametrize("weight", [np.inf, 1e300])
def test_huge_weights_take_all_candidates_or_none(surface, p_OC, weight):
    sizes = partition(surface, p_OC, {"contact_weights": [0, weight, 0, 0, 0]}).sizes()
    assert sizes[1] > 0
    assert sizes.sum() == sizes[1]
    if np.isfinite(weight):
        least = partition(surface, p_OC, {"contact_weights": [0, -weight, 0, 0, 0]})
        assert least.sizes()[1] == 0
        assert not least.lost[1]


def test_an_obstacle_without_a_place_obstructs_all(surface, p_OC):
    ball = dp.BallSolid(np.array([9.0, 0.0, 0.0]), 0.1)
    obstacles = dp.Obstacles((dp.BallSolid(np.array([9.0, 1.0, 0.0]), 0.1), ball))
    assert np.all(partition(surface, p_OC, {"obstacles": obstacles}).sizes())
    ball.center[0] = np.nan
    regions = partition(surface, p_OC, {"obstacles": obstacles})
    assert np.all(regions.sizes() == 0)
    np.testing.assert_array_equal(regions.causes, 1)


@pytest.mark.parametrize("rate", BAD_NUMBERS)
def test_an_object_of_unknown_velocity_is_taken_to_stay(surface, p_OC, rate):
    ball = dp.BallSolid(X_WO.translation() + 0.12 * np.eye(3)[2], 0.05)
    inputs = {"obstacles": dp.Obstacles((ball,), velocities=np.array([[0.0, 0, 0.01]]))}
    settings = {"horizon": 0.5, "tip_radii": [0.009] * N}
    labels = [
        partition(surface, p_OC, inputs | {"V_WO_estimated": V_WO}, **settings).labels
        for V_WO in (SpatialVelocity.Zero(), SpatialVelocity(w=[rate, 0, 0], v=[0, rate, 0]))
    ]
    np.testing.assert_array_equal(*labels)
