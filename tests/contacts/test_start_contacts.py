"""Start contacts of a hand: laws of the choice, and what is missing where there is no grasp."""

import re
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from conftest import slow
from scipy.spatial.distance import pdist
from scipy.spatial.transform import Rotation

from drake_pregrasp.contacts.assignment import palm_turn, ring_contacts
from drake_pregrasp.contacts.contact_pairs import Pair
from drake_pregrasp.contacts.goal_limits import tip_gaps
from drake_pregrasp.contacts.hand_above_object import HandAboveObject
from drake_pregrasp.contacts.start_candidates import StartCandidates
from drake_pregrasp.contacts.start_contacts import _Search, choose_start_contacts
from drake_pregrasp.contacts.tipping import tipping_shares
from drake_pregrasp.errors import Lack, NoGraspError
from drake_pregrasp.geometry.mesh_surface import AxisArea, mesh_surface
from drake_pregrasp.geometry.shapes import ball_shape, box_shape, cylinder_shape, load_shape
from drake_pregrasp.geometry.solids import BallSolid, HalfSpace
from drake_pregrasp.quality.force_closure import largest_load, min_weight_margin
from drake_pregrasp.quality.grasp_stiffness import turn_by_force
from drake_pregrasp.regions.constraints import Limit, Obstacles, RegionConstraints
from drake_pregrasp.regions.finger_reach import FingerReach
from drake_pregrasp.regions.safe_regions import compute_safe_regions

MODELS = Path(__file__).parents[2] / "models"
N, TIP, GAP, STANDOFF, CLEARANCE = 5, 0.009, 0.004, 0.02, 0.004
AZIMUTHS = 2 * np.pi * np.arange(N) / N
HOME = 0.08 * np.stack([np.cos(AZIMUTHS), np.sin(AZIMUTHS), np.zeros(N)], axis=1)
FORCES = np.array([[2.5] * N, [12.0] * N])


@cache
def shape_of(name):
    if name.startswith("box"):
        return box_shape(np.random.default_rng(int(name[3:])).uniform(0.06, 0.11, 3))
    if name.startswith("cylinder"):
        rng = np.random.default_rng(int(name[8:]))
        return cylinder_shape(rng.uniform(0.025, 0.05), rng.uniform(0.06, 0.12))
    return ball_shape(0.04) if name == "ball" else load_shape(MODELS / f"{name}.obj")


def surface_of(shape, spacing=0.01):
    return mesh_surface(shape, spacing=spacing, no_touch=[AxisArea("+z"), AxisArea("-z")])


def reach_of(azimuth, half_angle, solid=None):
    direction = np.array([np.cos(azimuth), np.sin(azimuth), 0.0])
    return FingerReach(solid, direction, half_angle=half_angle, incidence=1.22)


def hand_over(shape, *, turn=0.0, half_angle=1.13, mass=0.3, reaches=None, tip=TIP, **changes):
    """A radial hand over an object on the table, both turned about the vertical."""
    R_WO = Rotation.from_euler("z", turn).as_matrix()
    bottom = np.array([0.0, 0.0, shape.mesh.bounds[0][2]])
    shared = {
        "obstacles": Obstacles((HalfSpace(bottom, np.array([0.0, 0.0, 1.0])),)),
        "clearance": CLEARANCE,
        "tip_radii": np.full(N, tip),
        "tip_gap": GAP,
        "standoff": STANDOFF,
        "reach": reaches or [reach_of(azimuth, half_angle) for azimuth in AZIMUTHS],
    }

    def R_OH(yaw):
        return R_WO.T @ Rotation.from_euler("z", yaw).as_matrix()

    values = {
        "constraints_at": lambda yaw: RegionConstraints(
            N, **shared, reach_pose=(R_OH(yaw), np.zeros(3))
        ),
        "p_OT_at": lambda yaw: HOME @ R_OH(yaw).T,
        "azimuths": AZIMUTHS,
        "R_AO": R_WO,
        "wrench": np.array([0, 0, -9.81 * mass, 0, 0, 0]),
        "friction": 0.5,
        "normal_forces": FORCES,
        "touch_force": 0.525,
        "yaw": turn,
    }
    return HandAboveObject(**values | changes)


def chosen(shape, surface=None, **options):
    hand = hand_over(shape, **options)
    return choose_start_contacts(surface or surface_of(shape), shape.solid, hand), hand


def margin_of(surface, p_OC):
    return min_weight_margin(p_OC - surface.p_OCoM, surface.project(p_OC)[1], 0.5)


SLOW = ["box1", "cylinder0", "mug", "screwdriver"]
SHAPES = ["box0", slow("ball"), *map(slow, SLOW)]


@pytest.mark.slow
@pytest.mark.parametrize("name", SHAPES)
def test_chosen_contacts_pass_all_tests_and_hold_the_object(name):
    shape = shape_of(name)
    surface = surface_of(shape)
    start, hand = chosen(shape, surface)
    on = np.flatnonzero(start.has_contact)
    assert len(on) >= hand.least_fingers
    p_OC, normals = start.p_OC[on], surface.project(start.p_OC)[1][on]
    constraints = hand.constraints_at(start.yaw)
    limits = [
        constraints.limits_at(i, p[None], n[None])[0][0]
        for i, p, n in zip(on, p_OC, normals, strict=True)
    ]
    assert set(limits) == {Limit.NONE}
    # The palm turns to the yaw at which they are in reach, and fingers that stay away do not.
    p_OT = p_OC + (TIP + constraints.standoff) * normals
    turned = palm_turn(p_OT @ hand.R_AO.T + hand.p_AO, AZIMUTHS[on], start.yaw)
    assert turned == pytest.approx(start.yaw, abs=1e-9)
    # Fingertips are beside each other, seen from above, and outside the object.
    level = np.array([1.0, 1.0, 0.0])
    assert np.min(tip_gaps(p_OC * level, normals * level, np.full(len(on), TIP), GAP)) >= 0
    assert np.min(shape.solid.distance(p_OC + TIP * normals)) >= TIP - 0.0025
    # From there the planner can move them.
    nhat = {"nhat_OQ": surface.nhat_OQ, "nhat_OC": surface.project(start.p_OC)[1]}
    weights = np.where(start.has_contact, 0.0, -np.inf)
    constraints = replace(constraints, **nhat)
    regions = compute_safe_regions(
        surface.p_OQ, start.p_OC, weights, surface.forbidden, constraints
    )
    assert np.all(regions.counts[on] > 0)
    assert start.margin == pytest.approx(margin_of(surface, p_OC), abs=1e-6)
    # It trades little of the margin for flat surface and for fingers near their home.
    assert start.margin >= margin_of(surface, ring_contacts(surface, N)) - 0.07
    load = largest_load(
        p_OC - surface.p_OCoM, normals, 0.5, wrench=hand.wrench, normal_forces=FORCES[:, on]
    )
    assert load >= 1


def at_the_edge(start, surface, hand):
    """Counts the contacts that a turn of the palm by 0.1 rad takes out of reach."""
    nhat_OC, turned = surface.project(start.p_OC)[1], [start.yaw - 0.1, start.yaw + 0.1]
    limits = [
        hand.constraints_at(yaw).limits_at(i, start.p_OC[[i]], nhat_OC[[i]])[0][0]
        for yaw in turned
        for i in np.flatnonzero(start.has_contact)
    ]
    return limits.count(Limit.REACH)


def under_parts(start, surface, shape):
    """Counts the fingertips that have a part of the object over them."""
    tips = start.p_OC + TIP * surface.project(start.p_OC)[1]
    over = 0.01 * np.arange(1, 11)[:, None, None] * [0.0, 0.0, 1.0]
    gaps = shape.solid.distance((tips + over).reshape(-1, 3)).reshape(10, N).min(axis=0)
    return np.count_nonzero((gaps < TIP - 1e-9) & start.has_contact)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "half_angle", "count"),
    [
        ("box2", 0.15, lambda start, surface, hand, shape: at_the_edge(start, surface, hand)),
        ("drill", 1.13, lambda start, surface, hand, shape: under_parts(start, surface, shape)),
    ],
)
def test_contacts_keep_a_reserve_of_reach_and_avoid_places_under_parts(name, half_angle, count):
    shape = shape_of(name)
    surface = surface_of(shape)
    counts = []
    for clearance_weight in (0.0, 1.0):
        start, hand = chosen(
            shape,
            surface,
            half_angle=half_angle,
            clearance_weight=clearance_weight,
            touch_force=0.0,
        )
        counts.append(count(start, surface, hand, shape))
    assert counts[0] > counts[1] == 0


@pytest.mark.slow
@pytest.mark.parametrize("name", ["box0", "mug"])
def test_an_object_and_a_palm_that_turn_together_have_the_same_contacts(name):
    shape = shape_of(name)
    surface = surface_of(shape)
    start, _ = chosen(shape, surface)
    turned, _ = chosen(shape, surface, turn=0.7)
    np.testing.assert_allclose(turned.p_OC, start.p_OC, atol=1e-12)
    assert turned.yaw == pytest.approx(start.yaw + 0.7, abs=1e-9)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["box1", "cylinder0", "mug"])
def test_a_larger_reach_gives_no_smaller_margin(name):
    shape = shape_of(name)
    surface = surface_of(shape)
    margins = [chosen(shape, surface, half_angle=angle)[0].margin for angle in (0.5, 0.8, np.pi)]
    assert np.all(np.diff(margins) >= -0.05), margins


@pytest.mark.slow
def test_ranges_of_the_palm_that_differ_by_a_whole_turn_are_the_same():
    shape = shape_of("box0")
    (start, _), (turned, _) = (
        chosen(shape, yaw_range=(low, low + 0.5)) for low in (-2.5, -2.5 + 2 * np.pi)
    )
    np.testing.assert_allclose(turned.p_OC, start.p_OC)
    assert turned.yaw == pytest.approx(start.yaw + 2 * np.pi)


@pytest.mark.slow
def test_the_palm_stays_within_its_range():
    start, _ = chosen(shape_of("box0"), yaw_range=(0.2, 0.4))
    assert 0.2 <= start.yaw <= 0.4
    start, _ = chosen(shape_of("box0"), holds_palm=lambda yaw: yaw < -1)
    assert start.yaw < -1


@pytest.mark.slow
@pytest.mark.parametrize("middle", [-2.8, -2.0, 0.4, 1.2])
def test_a_palm_that_is_held_at_few_yaws_has_a_grasp_there(middle):
    start, _ = chosen(shape_of("box0"), holds_palm=lambda yaw: abs(yaw - middle) < 0.25)
    assert abs(start.yaw - middle) < 0.25


@pytest.mark.slow
def test_the_same_object_has_the_same_contacts_at_any_density():
    shape = shape_of("box2")
    margins = [chosen(shape, surface_of(shape, spacing))[0].margin for spacing in (0.008, 0.002)]
    assert margins[1] == pytest.approx(margins[0], abs=0.1)


def test_a_palm_that_its_contacts_would_turn_too_far_is_refused():
    with pytest.raises(NoGraspError, match="only at yaws that the palm leaves"):
        chosen(shape_of("box0"), half_angle=0.15, azimuths=AZIMUTHS + 0.8)


def test_a_palm_that_its_contacts_would_turn_a_little_out_of_reach_keeps_its_yaw():
    """Fingers reach little, and not at the azimuths to which the palm would turn."""
    shape = shape_of("box0")
    surface = surface_of(shape)
    start, hand = chosen(shape, surface, half_angle=0.15, azimuths=AZIMUTHS + 0.3)
    on = np.flatnonzero(start.has_contact)
    p_OC, normals = start.p_OC[on], surface.project(start.p_OC)[1][on]
    for i, p, n in zip(on, p_OC, normals, strict=True):
        assert hand.constraints_at(start.yaw).limits_at(i, p[None], n[None])[0][0] == Limit.NONE
    turned = palm_turn(p_OC + (TIP + STANDOFF) * normals, hand.azimuths[on], start.yaw)
    assert start.yaw_slack == pytest.approx(abs(turned - start.yaw), abs=1e-9)
    assert start.yaw_slack > 0.1


def test_jaws_have_no_slack():
    """Only fingers that are not jaws may keep contacts from which the palm would turn."""
    shape, surface = shape_of("box0"), surface_of(shape_of("box0"))
    hand = hand_over(shape, half_angle=0.15, azimuths=AZIMUTHS + 0.3)
    free, paired = (
        _Search(surface, shape.solid, replace(hand, pairs=pairs), 300, 2)
        for pairs in ((), (Pair(0, 2),))
    )
    kept = [trial for trial in map(free.settled, free.yaws()) if free.kept(trial)]
    assert kept
    assert not any(map(paired.kept, kept))


def test_opposite_contacts_are_where_the_palm_has_room():
    shape = shape_of("box0")
    for pair, is_limited in ((Pair(0, 2), True), (Pair(0, 2, distance=0.05), False)):
        hand = hand_over(shape, pairs=(pair,), fits_palm=lambda yaw, p_OC: p_OC[:, 2] > yaw)
        candidates = StartCandidates(surface_of(shape), shape.solid, hand, 300)
        limits, is_low = candidates.limits_at(0.01), candidates.p_OQ[:, 2] <= 0.01
        assert np.any(limits[1, is_low] == Limit.NONE)
        assert np.any(limits[[0, 2]][:, ~is_low] == Limit.NONE)
        lacking = ~np.isin(limits[[0, 2]][:, is_low], (Limit.REACH, Limit.FORBIDDEN))
        assert np.any(lacking) != is_limited


def test_a_finger_without_a_place_stays_away():
    reaches = [reach_of(azimuth, 1.13) for azimuth in AZIMUTHS]
    reaches[2] = reach_of(AZIMUTHS[2], 1.13, BallSolid(np.array([0.5, 0, 0]), 0.01))
    start, _ = chosen(shape_of("box0"), reaches=reaches)
    assert start.has_contact.tolist() == [True, True, False, True, True]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("at_contact", "at_standoff"), [(0.002 - 1e-6, 1.0), (-np.inf, 1.0), (1.0, 0.005 - 1e-6)]
)
def test_contacts_at_which_a_link_is_too_near_are_left_out(at_contact, at_standoff):
    shape = shape_of("box0")
    free, _ = chosen(shape)

    def link_gaps(yaw, finger, p_OT):
        stands_off = shape.solid.distance(p_OT) > TIP + 1e-6
        near = np.linalg.norm(p_OT - free.p_OC[finger], axis=1) < 0.02 + 0.02 * stands_off
        least = np.where(stands_off, 0.005, 0.002)
        gaps = np.where(stands_off, at_standoff, at_contact)
        return np.where(near & (finger == 1), gaps, least)

    start, _ = chosen(shape, link_gaps=link_gaps, least_link_gaps=(0.002, 0.005))
    assert free.has_contact[1]
    assert not start.has_contact[1] or np.linalg.norm(start.p_OC[1] - free.p_OC[1]) > 0.01


@pytest.mark.parametrize("name", ["box0", slow("cylinder0"), slow("mug")])
def test_noise_does_not_bar_start_contacts_at_once(name):
    """Shifts by 3 mm leave them permitted; a low centre of mass draws them to the table."""
    shape = shape_of(name)
    low = np.array([0.0, 0.0, shape.mesh.bounds[0][2] + 0.012])
    surface = replace(surface_of(shape, spacing=0.004), p_OCoM=low)
    start, hand = chosen(shape, surface, turn=0.3)
    limits = hand.constraints_at(start.yaw)
    for finger in np.flatnonzero(start.has_contact).tolist():
        p, nhat = start.p_OC[[finger]], surface.project(start.p_OC[[finger]])[1]
        for shift in 0.003 * np.vstack([np.eye(3), -np.eye(3)]):
            assert limits.limits_at(finger, p + shift, nhat)[0] == Limit.NONE


@pytest.mark.slow
def test_links_are_not_judged_at_a_standoff_to_which_joints_do_not_get():
    shape = shape_of("box0")
    free, _ = chosen(shape)

    def link_gaps(yaw, finger, p_OT):
        return np.where(shape.solid.distance(p_OT) > TIP + 1e-6, -np.inf, 0.002)

    start, _ = chosen(shape, link_gaps=link_gaps, least_link_gaps=(0.002, 0.005))
    np.testing.assert_array_equal(start.p_OC, free.p_OC)


@pytest.mark.parametrize("mass", [0.1, 0.3])
def test_an_object_that_turns_far_with_its_load_lowers_the_score(mass):
    surface, load = surface_of(shape_of("box0")), 0.5 * 9.81 * mass
    free, _ = chosen(shape_of("box0"), surface, mass=mass)
    soft = {"compliance": lambda yaw, finger, p_OT: 2e-3 * np.eye(3), "load_change": load}
    start, _ = chosen(shape_of("box0"), surface, mass=mass, **soft)

    def turn(contacts):
        p = contacts.p_OC[contacts.has_contact]
        C = np.tile(2e-3 * np.eye(3), (len(p), 1, 1))
        arms = {"torsional_arms": np.zeros(len(p)), "force": load}
        return turn_by_force(p - surface.p_OCoM, surface.project(p)[1], C, **arms)

    assert 0 < turn(start) <= turn(free)
    assert free.score - 6.0 * turn(free) <= start.score + 1e-9 <= free.score
    nowhere = {"compliance": lambda yaw, finger, p_OT: np.full((3, 3), np.nan)}
    lost, _ = chosen(shape_of("box0"), surface, mass=mass, load_change=load, **nowhere)
    assert lost.score == pytest.approx(free.score - 6.0 * 0.25)  # As the farthest turn.


# Three fingers in a row and two opposite ones.
ROW = np.array([[-30.0, 50, 0], [0, 50, 0], [30, 50, 0], [-20, -50, 0], [20, -50, 0]]) * 1e-3


def row_over(size, touch_force):
    """Returns start contacts of a hand with fingers in rows on a box, with its surface and hand."""
    shape = box_shape(np.array(size))
    surface = surface_of(shape)
    reaches = [
        FingerReach(None, np.array([0, y, 0]), half_angle=1.6, incidence=1.2)
        for y in np.sign(ROW[:, 1])
    ]
    start, hand = chosen(
        shape,
        surface,
        reaches=reaches,
        p_OT_at=lambda yaw: ROW @ Rotation.from_euler("z", yaw).as_matrix().T,
        azimuths=np.arctan2(ROW[:, 1], ROW[:, 0]),
        touch_force=touch_force,
    )
    return start, surface, hand


@pytest.mark.slow
@pytest.mark.parametrize("size", [(0.1, 0.03, 0.15), (0.06, 0.03, 0.2), (0.12, 0.04, 0.1)])
def test_fingertips_on_straight_paths_to_their_contacts_do_not_cross(size):
    start, surface, hand = row_over(size, 0.525)
    on = np.flatnonzero(start.has_contact)
    p_OT = start.p_OC + TIP * surface.project(start.p_OC)[1]
    ends = [points[on, :2] for points in (hand.p_OT_at(start.yaw), p_OT)]
    least = [pdist((1 - share) * ends[0] + share * ends[1]) for share in np.linspace(0.0, 1.0, 101)]
    assert len(on) == N
    assert np.all(np.min(least, axis=0) >= np.minimum(least[0], least[-1]) / np.sqrt(2))


@pytest.mark.slow
@pytest.mark.parametrize("size", [(0.1, 0.03, 0.15), (0.06, 0.03, 0.2)])
def test_fingers_touch_a_box_that_tips_easily_lower(size):
    shares, heights = [], []
    for touch_force in (0.0, 0.525):
        start, surface, hand = row_over(size, touch_force)
        shares.append(
            tipping_shares(
                start.p_OC,
                surface.project(start.p_OC)[1],
                p_OV=np.asarray(surface.mesh.vertices),
                p_OCoM=surface.p_OCoM,
                weight=hand.wrench[:3],
                force=0.525,
            )
        )
        heights.append(start.p_OC[:, 2])
    assert np.max(shares[1]) < 0.9 < np.max(shares[0])
    assert np.all(np.abs(heights[0]) < 0.015)  # The height of the centre of mass is preferred.
    assert np.all(np.abs(heights[1]) < 0.04)


def ball_reaches(direction, radius):
    center = np.array([0.04, 0.0, 0.0])
    return [FingerReach(BallSolid(center, radius), np.array(direction), incidence=1.2)] * N


@pytest.mark.slow
@pytest.mark.parametrize(
    ("lack", "message", "options"),
    [
        (Lack.REACH, "only at yaws that the palm leaves", {"holds_palm": lambda yaw: False}),
        (Lack.REACH, "at most 0 fingers reach it", {"reaches": ball_reaches([1.0, 0, 0], 1e-4)}),
        (
            Lack.OPENING,
            "reach two opposite sides, which are 73.5 mm apart; tips at home are 152 mm apart",
            {"reaches": ball_reaches([1.0, 0, 0], 1)},
        ),
        (
            Lack.ROOM,
            "5 places in reach are at most [0-9.]+ mm apart, and fingertips need 64 mm",
            {"tip": 0.03, "least_fingers": 5},
        ),
        (
            Lack.FRICTION,
            "no contacts in reach have force closure with friction 0; they need 0.05",
            {"friction": 0.0},
        ),
        (Lack.FRICTION, "the best contacts hold 0.\\d+ of its weight", {"mass": 9.0}),
    ],
)
def test_it_says_what_is_missing(lack, message, options):
    with pytest.raises(NoGraspError, match=f"no grasp for lack of {lack}: .*{message}") as error:
        chosen(shape_of("box0"), **options)
    assert error.value.lack == lack


@pytest.mark.slow
@pytest.mark.parametrize(
    ("words", "options"),
    [
        (
            "the missing ones end ([0-9.]+) mm off",
            lambda added: {"reaches": ball_reaches([1.0, 0, 0], 1e-4 + added)},
        ),
        (
            "the missing ones are ([0-9.]+) mm too large for their roomiest places",
            lambda added: {"tip": 0.06 - added},
        ),
    ],
)
def test_what_is_missing_is_missing_no_longer_when_it_is_added(words, options):
    def found(added):
        try:
            chosen(shape_of("box0"), **options(added))
        except NoGraspError as error:
            return re.search(words, str(error))

    missing = 1e-3 * float(found(0.0)[1])
    assert found(0.9 * missing)
    assert not found(1.02 * missing)


@pytest.mark.slow
def test_an_object_that_is_nearly_too_heavy_is_held_beside_the_best_margin():
    shape, surface = shape_of("ball"), surface_of(shape_of("ball"))
    start, hand = chosen(shape, surface, mass=3.0)  # Level fingers hold 30 N.
    load = largest_load(
        start.p_OC - surface.p_OCoM,
        surface.project(start.p_OC)[1],
        0.5,
        wrench=hand.wrench,
        normal_forces=FORCES,
    )
    assert load >= 1


def test_level_fingers_hold_as_much_as_their_friction():
    angles = 2 * np.pi * np.arange(4) / 4
    normals = np.stack([np.cos(angles), np.sin(angles), np.zeros(4)], axis=1)
    load = largest_load(
        0.03 * normals,
        normals,
        0.5,
        wrench=np.array([0, 0, -3.0, 0, 0, 0]),
        normal_forces=np.array([[1.0] * 4, [6.0] * 4]),
    )
    assert load == pytest.approx(4 * 0.5 * 6 / 3)
    crowded = np.array([[7.0] * 4, [6.0] * 4])
    assert largest_load(0.03 * normals, normals, 0.5, wrench=np.ones(6), normal_forces=crowded) == 0
