"""The planner's stages keep goals where they are as long as nobody knows where the object is."""

import numpy as np
import pytest
from driven import Driven
from made_systems import PERIOD, X_WO, make_selector, partition, points_of
from pydrake.common.value import AbstractValue
from pydrake.math import RigidTransform, RollPitchYaw, RotationMatrix
from pydrake.multibody.math import SpatialVelocity

from drake_pregrasp import BallReach, BallSolid, ContactStatus, InvalidArgumentError, Obstacles
from drake_pregrasp.estimation.pose_track import TrackingStatus
from drake_pregrasp.regions.safe_regions import compute_safe_regions

LATER = RigidTransform(RollPitchYaw(0.1, 0.2, -0.7), [0.3, 0.1, 0.0])
STANDOFF = 0.03
NOT_FOLLOWED = [TrackingStatus.WAITING, TrackingStatus.LOST, np.nan, 17.0, -np.inf]


def turned_by(matrix):
    return RigidTransform(RotationMatrix.MakeUnchecked(matrix), np.zeros(3))


NO_POSES = {
    "nan place": RigidTransform([np.nan, 0.0, 0.0]),
    "infinite place": RigidTransform([0.0, -np.inf, 0.0]),
    "far place": RigidTransform([1e300, 0.0, 0.0]),
    "nan rotation": turned_by(np.full((3, 3), np.nan)),
    "infinite rotation": turned_by(np.full((3, 3), np.inf)),
    "scaled": turned_by(1.1 * np.eye(3)),
    "mirrored": turned_by(-np.eye(3)),
}


class Selector(Driven):
    """A selector tick by tick, whose regions are those of its goals."""

    def __init__(self, surface, p_OC, **settings):
        system = make_selector(surface, p_OC, lost_standoff=STANDOFF, **settings)
        super().__init__(system)
        self.surface, self.n = surface, len(p_OC)
        self.fix(X_WO_estimated=X_WO, p_WO_covariance=np.diag([1e-6, 4e-6, 1e-6]).ravel())
        self.set_regions()

    def set_regions(self, weights=None):
        weights = np.zeros(self.n) if weights is None else weights
        regions = compute_safe_regions(
            self.surface.p_OQ, self.p_OC, weights, self.surface.forbidden
        )
        self.fix(safe_regions=AbstractValue.Make(regions))

    @property
    def p_OC(self):
        return self.context.get_discrete_state(1).value().reshape(-1, 3).copy()

    def tick(self):
        super().tick()
        self.set_regions()

    def targets(self):
        names = [f"fingertip_{i}" for i in range(self.n)]
        return points_of(self.eval("fingertip_targets"), names)


@pytest.mark.parametrize("status", NOT_FOLLOWED)
def test_goals_stay_on_the_object_and_targets_off_it_while_it_is_lost(surface, p_OC, status):
    selector = Selector(surface, p_OC)
    selector.tick()
    held, known = selector.p_OC, selector.array("contact_status")
    selector.fix(tracking_status=[float(status)])
    selector.fix(X_WO_estimated=LATER)
    for _ in range(3):
        goals = selector.array("p_WC").reshape(-1, 3)
        np.testing.assert_allclose(goals, (LATER @ held.T).T, atol=1e-12)
        np.testing.assert_array_equal(selector.array("contact_status"), known)
        normals = (LATER.rotation() @ surface.project(held)[1].T).T
        np.testing.assert_allclose(selector.targets(), goals + STANDOFF * normals, atol=1e-12)
        selector.tick()
        np.testing.assert_array_equal(selector.p_OC, held)


@pytest.mark.parametrize("status", [TrackingStatus.TRACKING, TrackingStatus.COASTING])
def test_goals_go_on_while_the_object_is_followed(surface, p_OC, status):
    selector, told = Selector(surface, p_OC), Selector(surface, p_OC)
    told.fix(tracking_status=[float(status)])
    for _ in range(3):
        np.testing.assert_array_equal(told.array("p_WC"), selector.array("p_WC"))
        np.testing.assert_array_equal(told.targets(), selector.targets())
        np.testing.assert_allclose(told.targets().ravel(), told.array("p_WC"), atol=1e-12)
        selector.tick()
        told.tick()


def test_goals_keep_to_their_limits_when_the_object_is_found_again(surface, p_OC):
    step = 0.002
    selector = Selector(surface, p_OC, limits={"max_step": step})
    moved = 0.0
    for tick in range(12):
        lost = 3 <= tick < 8
        selector.fix(tracking_status=[3.0 if lost else 1.0])
        before = selector.p_OC
        selector.tick()
        ways = np.linalg.norm(selector.p_OC - before, axis=1)
        assert np.max(ways) <= step + 1e-12
        assert not lost or np.max(ways) == 0
        moved = max(moved, np.max(ways) * (tick >= 8))
    assert moved > step / 2


def test_nothing_is_planned_before_the_object_is_first_seen(surface, p_OC):
    selector = Selector(surface, p_OC)
    selector.fix(tracking_status=[float(TrackingStatus.WAITING)])
    selector.tick()
    np.testing.assert_array_equal(selector.array("contact_status"), ContactStatus.INACTIVE)
    selector.fix(tracking_status=[float(TrackingStatus.TRACKING)])
    assert np.all(selector.array("contact_status") > 0)


@pytest.mark.parametrize("name", NO_POSES)
def test_without_a_pose_goals_stay_where_the_object_was_last(surface, p_OC, name):
    selector = Selector(surface, p_OC)
    selector.tick()
    selector.fix(X_WO_estimated=LATER)
    selector.tick()
    held = selector.p_OC
    selector.fix(X_WO_estimated=NO_POSES[name])
    for _ in range(2):
        goals = selector.array("p_WC").reshape(-1, 3)
        np.testing.assert_allclose(goals, (LATER @ held.T).T, atol=1e-12)
        np.testing.assert_array_equal(selector.array("p_WC_previous"), goals.ravel())
        off = np.linalg.norm(selector.targets() - goals, axis=1)
        np.testing.assert_allclose(off, STANDOFF, atol=1e-12)
        selector.tick()
    selector.fix(X_WO_estimated=X_WO)
    np.testing.assert_allclose(selector.array("p_WC_previous"), (X_WO @ held.T).T.ravel())


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf, 1e300, -1e300, -1.0])
def test_any_covariance_leaves_goals_on_the_surface(surface, p_OC, value):
    selector = Selector(surface, p_OC)
    selector.fix(p_WO_covariance=np.full(9, value))
    goals = selector.array("p_WC").reshape(-1, 3)
    p_OC_new = (X_WO.inverse() @ goals.T).T
    nearest, _ = surface.project(p_OC_new)
    assert np.max(np.abs(nearest - p_OC_new)) < 1e-9
    assert np.all(selector.array("contact_status") > 0)


def test_an_unknown_wish_to_hold_holds(surface, p_OC):
    selector = Selector(surface, p_OC)
    selector.tick()
    held = selector.p_OC
    selector.fix(hold_contacts=[np.nan])
    np.testing.assert_allclose(selector.array("p_WC"), (X_WO @ held.T).T.ravel(), atol=1e-12)


def test_regions_of_another_type_are_refused_by_the_ports_name(surface, p_OC):
    selector = Selector(surface, p_OC)
    selector.fix(safe_regions=AbstractValue.Make(object()))
    with pytest.raises(InvalidArgumentError, match="port safe_regions"):
        selector.array("p_WC")


@pytest.mark.parametrize("standoff", [-0.01, np.nan, np.inf])
def test_a_senseless_standoff_is_refused(surface, p_OC, standoff):
    with pytest.raises(InvalidArgumentError, match="lost_standoff"):
        make_selector(surface, p_OC, lost_standoff=standoff)


@pytest.mark.parametrize("name", NO_POSES)
def test_without_a_pose_nobody_has_a_region(surface, p_OC, name):
    assert np.all(partition(surface, p_OC, {"X_WO_estimated": NO_POSES[name]}).sizes() == 0)


@pytest.mark.parametrize("name", NO_POSES)
def test_without_the_hands_pose_nothing_is_in_reach(surface, p_OC, name):
    center = X_WO.translation().tolist()
    reach = [BallReach(center=center, radius=1.0)] * 3 + [None] * 2
    assert np.all(partition(surface, p_OC, {}, reach=reach).sizes() > 0)
    regions = partition(surface, p_OC, {"X_WH": NO_POSES[name]}, reach=reach)
    np.testing.assert_array_equal(regions.sizes() > 0, [0, 0, 0, 1, 1])


def test_a_weight_that_is_no_number_is_that_of_a_lost_finger(surface, p_OC):
    unknown = partition(surface, p_OC, {"contact_weights": [0, np.nan, 0, 0, 0]})
    lost = partition(surface, p_OC, {"contact_weights": [0, -np.inf, 0, 0, 0]})
    np.testing.assert_array_equal(unknown.labels, lost.labels)
    np.testing.assert_array_equal(unknown.lost, lost.lost)


@pytest.mark.parametrize("weight", [np.inf, 1e300])
def test_huge_weights_take_all_ground_or_none(surface, p_OC, weight):
    sizes = partition(surface, p_OC, {"contact_weights": [0, weight, 0, 0, 0]}).sizes()
    assert sizes[1] > 0
    assert sizes.sum() == sizes[1]
    if np.isfinite(weight):
        least = partition(surface, p_OC, {"contact_weights": [0, -weight, 0, 0, 0]})
        assert least.sizes()[1] == 0
        assert not least.lost[1]


@pytest.mark.parametrize("number", [np.nan, np.inf, 1e300])
def test_a_contact_without_a_place_is_as_one_that_is_lost(surface, p_OC, number):
    p_WC = (X_WO @ p_OC.T).T
    p_WC[2, 1] = number
    regions = partition(surface, p_OC, {"p_WC": p_WC.ravel()}, tip_radii=[0.009] * 5)
    np.testing.assert_array_equal(regions.lost, np.arange(5) == 2)
    np.testing.assert_array_equal(regions.sizes() > 0, np.arange(5) != 2)


def test_an_obstacle_without_a_place_obstructs_all(surface, p_OC):
    ball = BallSolid(np.array([9.0, 0.0, 0.0]), 0.1)
    obstacles = Obstacles((BallSolid(np.array([9.0, 1.0, 0.0]), 0.1), ball))
    assert np.all(partition(surface, p_OC, {"obstacles": obstacles}).sizes())
    ball.center[0] = np.nan
    regions = partition(surface, p_OC, {"obstacles": obstacles})
    assert np.all(regions.sizes() == 0)
    np.testing.assert_array_equal(regions.causes, 1)


def test_an_object_of_unknown_velocity_is_taken_to_stay(surface, p_OC):
    ball = BallSolid(X_WO.translation() + 0.12 * np.eye(3)[2], 0.05)
    obstacles = Obstacles((ball,), velocities=np.array([[0.0, 0, 0.01]]))
    arguments = {"horizon": 0.5, "tip_radii": [0.009] * 5}
    changes = {"obstacles": obstacles, "V_WO_estimated": SpatialVelocity.Zero()}
    still = partition(surface, p_OC, changes, **arguments)
    for rate in (np.nan, np.inf, 1e300):
        changes["V_WO_estimated"] = SpatialVelocity(w=[rate, 0, 0], v=[0, rate, 0])
        unknown = partition(surface, p_OC, changes, **arguments)
        np.testing.assert_array_equal(unknown.labels, still.labels)
