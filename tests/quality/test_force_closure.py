"""The two margins of force closure with exact cones, and the lower bound of one of them."""

from functools import partial

import numpy as np
import pytest
from conftest import slow
from hypothesis import settings
from made_contacts import SURFACE, anywhere, on_box, seeds
from scipy.optimize import linprog
from scipy.spatial import ConvexHull
from scipy.spatial.transform import Rotation

from drake_pregrasp import InvalidArgumentError
from drake_pregrasp.quality.force_closure import (
    CONE_MODELS,
    LARGEST_LOAD,
    LEAST_MARGIN,
    TORSIONAL_FRICTION,
    ferrari_canny,
    friction_cones,
    largest_load,
    min_weight_margin,
    needed_friction,
    torsional_friction_of,
)
from drake_pregrasp.quality.grasp_quality import grasp_quality
from drake_pregrasp.quality.margin_bounds import least_norm_margin, moved_least_norm_margin

cases = seeds(2, 6)
ball_radius = partial(ferrari_canny, length=0.05)


def assert_not_closed(r, nhat, friction=0.7, model="hard_finger"):
    assert min_weight_margin(r, nhat, friction, model=model) == pytest.approx(0, abs=1e-9)
    assert ball_radius(r, nhat, friction, model=model) == 0
    assert not least_norm_margin(r, nhat, friction, model=model) > 0


def test_contacts_on_one_side_or_nowhere_have_no_margin():
    one_side = np.array([[0.05, 0.02, 0.02], [0.05, -0.02, 0.02], [0.05, 0, -0.02]])
    for model in CONE_MODELS:
        assert_not_closed(one_side, np.tile([1.0, 0, 0], (3, 1)), model=model)
        assert_not_closed(np.empty((0, 3)), np.empty((0, 3)), model=model)


@pytest.mark.parametrize("n", [5, 10, 20])
@pytest.mark.parametrize(("model", "friction"), [("frictionless", 0.7), ("hard_finger", 0.0)])
def test_nothing_holds_a_ball_without_friction(model, friction, n):
    _, nhat = anywhere(n, n)
    assert_not_closed(0.05 * nhat, nhat, friction, model)


def test_two_hard_contacts_cannot_resist_a_turn_about_their_line_and_two_soft_ones_can():
    pair = np.array([[0.05, 0, 0], [-0.05, 0, 0]]), np.array([[1.0, 0, 0], [-1, 0, 0]])
    assert_not_closed(*pair)
    assert min_weight_margin(*pair, 0.7, model="soft_finger") == pytest.approx(1)
    assert min_weight_margin(*pair, 0.7, model="soft_finger", torsional_friction=0) == 0
    # Half the newton at either side, each holding its twist: the weakest direction there is.
    twist = ball_radius(*pair, 0.7, model="soft_finger", torsional_friction=0.004)
    assert twist == pytest.approx(0.004 / 0.05, rel=0.1)


def test_without_friction_six_contacts_are_too_few_and_pairs_that_twist_close():
    """Seven frictionless points are the least that can close a rigid body (Somov, 1900)."""
    x, y, z = np.eye(3)
    normals = np.repeat([x, -x, y, -y, z, -z], 2, axis=0)
    offsets = np.tile([0.03, -0.03], 6)[:, None] * np.repeat([y, y, z, z, x, x], 2, axis=0)
    r = 0.05 * normals + offsets
    rng = np.random.default_rng(0)
    for _ in range(20):
        six = rng.choice(12, 6, replace=False)
        assert_not_closed(r[six], normals[six], model="frictionless")
    assert min_weight_margin(r, normals, 0.7, model="frictionless") == pytest.approx(1)
    assert ball_radius(r, normals, 0.7, model="frictionless") > 0


@pytest.mark.slow
@pytest.mark.parametrize("model", CONE_MODELS)
@settings(max_examples=10)
@cases
def test_margins_depend_neither_on_the_unit_of_length_nor_on_the_reference_point(model, seed, n):
    r, nhat = on_box(seed, n)
    for margin in (min_weight_margin, least_norm_margin):
        expected = margin(r, nhat, 0.7, model=model)
        scaled = margin(1e3 * r, nhat, 0.7, model=model, torsional_friction=4.0)
        moved = margin(r + np.array([0.01, -0.02, 0.03]), nhat, 0.7, model=model)
        np.testing.assert_allclose([scaled, moved], expected, rtol=1e-6, atol=1e-6)
    radius = ball_radius(r, nhat, 0.7, model=model)
    scaled = ball_radius(1e3 * r, nhat, 0.7, length=50.0, model=model, torsional_friction=4.0)
    assert scaled == pytest.approx(radius, abs=1e-9)


@pytest.mark.slow
@pytest.mark.parametrize("model", CONE_MODELS)
@settings(max_examples=20)
@cases
def test_the_two_margins_agree_on_force_closure(model, seed, n):
    r, nhat = on_box(seed, n)
    margin = min_weight_margin(r, nhat, 0.7, model=model)
    radius = ball_radius(r, nhat, 0.7, model=model)
    assert 0 <= margin <= 1 + 1e-9
    assert (margin > 1e-7) == (radius > 1e-9)
    if margin > 1e-7:
        measured = "hard_finger" if model == "frictionless" else model
        assert grasp_quality(r, nhat, model=measured).indeterminate == 0


def pyramids(r, nhat, friction, model, edges, scale=1.0):
    """Wrenches of the edges of pyramids inside the cones, or around them, shape (6, n edges)."""
    B = friction_cones(r, nhat, friction, model, 0.004)
    B[:, 3:] /= 0.05
    if model == "frictionless":
        return B[:, :, 0].T
    angles = 2 * np.pi * np.arange(edges) / edges
    u = scale * np.stack([np.cos(angles), np.sin(angles)], axis=1)
    g = np.column_stack([np.ones(edges), u, *[np.zeros(edges)] * (B.shape[2] - 3)])
    if model == "soft_finger":
        g = np.vstack([g, [[1, 0, 0, scale], [1, 0, 0, -scale]]])
    return np.einsum("nik,ek->nei", B, g).reshape(-1, 6).T


@pytest.mark.parametrize("model", ["hard_finger", "frictionless"])
@cases
def test_the_margin_is_between_those_of_pyramids_inside_and_around_the_cones(model, seed, n):
    """The linear program of FRoGGeR, with 64 edges."""
    r, nhat = on_box(seed, n)
    margin, edges = min_weight_margin(r, nhat, 0.7, model=model), 64
    for scale, sign in [(1.0, 1), (1 / np.cos(np.pi / edges), -1)]:
        W = pyramids(r, nhat, 0.7, model, edges, scale)
        m = W.shape[1]
        A = np.vstack([W, np.ones(m)])
        A, c = np.hstack([A, A.sum(axis=1, keepdims=True)]), -np.eye(m + 1)[m]
        best = linprog(c, A_eq=A, b_eq=np.eye(7)[6], bounds=[*m * [(0, None)], (None, None)])
        spans = np.linalg.matrix_rank(W, tol=1e-9) == 6
        expected = max(0.0, -m * best.fun) if spans and best.success else 0.0
        assert sign * (margin - expected) > -1e-7
        assert margin == pytest.approx(expected, abs=0.05)


@pytest.mark.slow
@settings(max_examples=15)
@cases
def test_the_radius_is_between_those_of_random_directions_and_of_pyramids_inside(seed, n):
    """Wrenches reach as far in all directions, and a ball inside pyramids is inside the cones."""
    r, nhat = on_box(seed, n)
    B = friction_cones(r, nhat, 0.7, "hard_finger", 0)
    B[:, 3:] /= 0.05
    directions = np.random.default_rng(seed).normal(size=(2000, 6))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    g = np.einsum("nik,ui->unk", B, directions)
    support = np.max(g[..., 0] + np.hypot(g[..., 1], g[..., 2]), axis=1)
    radius = ball_radius(r, nhat, 0.7)
    assert radius <= max(np.min(support), 0) + 1e-12
    hull = ConvexHull(pyramids(r, nhat, 0.7, "hard_finger", 4).T, qhull_options="QJ")
    assert radius >= float(-np.max(hull.equations[:, -1])) - 1e-6


@pytest.mark.slow
@settings(max_examples=20)
@cases
def test_the_radius_is_that_of_the_hull_of_pyramids_with_many_edges(seed, n):
    r, nhat = on_box(seed, n)
    radius = ball_radius(r, nhat, 0.7)
    if radius > 0:
        hull = ConvexHull(pyramids(r, nhat, 0.7, "hard_finger", 24).T, qhull_options="QJ")
        inner = float(-np.max(hull.equations[:, -1]))
        assert inner - 1e-9 <= radius
        assert radius == pytest.approx(inner, abs=0.02)


def test_the_radius_of_an_octahedron_of_wrenches_is_known():
    """Soft pairs on three axes without friction: forces and twists are 12 corners +-e_i, +-e_j."""
    r = np.vstack([0.05 * np.eye(3), -0.05 * np.eye(3)])
    options = {"model": "soft_finger", "torsional_friction": 0.05}
    # Each wrench is (e_i, +-e_i): the hull is that of 12 points of norm sqrt(2), three planes of
    # squares; a facet takes one corner of each square's four sides: 1/sqrt(3) from the origin.
    assert ball_radius(r, r / 0.05, 0.0, **options) == pytest.approx(1 / np.sqrt(3))


@pytest.mark.parametrize(("slope", "least"), [(0.32, 0.1), (1.98, 0.1), (1.98, 2.4), (2.06, 0.1)])
def test_contacts_on_a_cone_need_as_much_friction_as_it_is_steep(slope, least):
    """Those of three fingers that press from the sides on a pyramid of some slope."""
    a, tilt = 2 * np.pi / 3 * np.arange(3), np.arctan(slope)
    level = np.stack([np.cos(a), np.sin(a), 0 * a], axis=1)
    nhat = np.cos(tilt) * level + [0.0, 0.0, np.sin(tilt)]
    found = needed_friction([(0.05 * level, nhat, {})], least)
    if slope > 2:
        assert found == np.inf
    else:
        assert max(slope, least) <= found <= max(slope + 0.05, least)


@pytest.mark.slow
@settings(max_examples=12)
@cases
def test_more_friction_holds_no_less(seed, n):
    r, nhat = on_box(seed, n)
    for model in ("hard_finger", "soft_finger"):
        radii = [ball_radius(r, nhat, mu, model=model) for mu in (0.2, 0.5, 0.7, 1.0)]
        assert np.all(np.diff(radii) >= -1e-12)
    hard = ball_radius(r, nhat, 0.7)
    assert hard <= ball_radius(r, nhat, 0.7, model="soft_finger") + 1e-12


def changed(r, nhat, seed):
    """The same contacts in another order, turned, and mirrored for odd seeds."""
    R = Rotation.random(random_state=seed).as_matrix() @ np.diag([1.0, 1, (-1) ** (seed % 2)])
    order = np.random.default_rng(seed).permutation(len(r))
    return (r @ R.T)[order], (nhat @ R.T)[order], R


@pytest.mark.parametrize("model", CONE_MODELS)
@settings(max_examples=60)
@cases
def test_margins_depend_neither_on_axes_nor_on_handedness_nor_on_the_order(model, seed, n):
    grasp = on_box(seed, n)
    *other, _ = changed(*grasp, seed)
    for margin in (min_weight_margin, least_norm_margin):
        value = margin(*grasp, 0.7, model=model)
        changes = margin(*other, 0.7, model=model)
        assert changes == pytest.approx(value, abs=1e-9)
        assert (changes > LEAST_MARGIN) == (value > LEAST_MARGIN)


@pytest.mark.parametrize("model", ["hard_finger", slow("soft_finger"), slow("frictionless")])
@settings(max_examples=15)
@cases
def test_the_radius_depends_neither_on_axes_nor_on_handedness_nor_on_the_order(model, seed, n):
    grasp = on_box(seed, n)
    *other, _ = changed(*grasp, seed)
    radius = ball_radius(*grasp, 0.7, model=model)
    assert ball_radius(*other, 0.7, model=model) == pytest.approx(radius, abs=1e-9)


@cases
def test_loads_are_those_of_pyramids_and_depend_neither_on_axes_nor_on_the_order(seed, n):
    grasp, wrench = on_box(seed, n), np.random.default_rng(seed).normal(size=6) / 10
    *other, R = changed(*grasp, seed)
    turned = np.concatenate([R @ wrench[:3], np.linalg.det(R) * R @ wrench[3:]])
    forces = np.array([[1.0] * n, [20.0] * n])
    load = largest_load(*grasp, 0.7, wrench=wrench, normal_forces=forces)
    changes = largest_load(*other, 0.7, wrench=turned, normal_forces=forces)
    assert changes == pytest.approx(load, abs=1e-6)
    edges = 64
    W = np.column_stack([pyramids(*grasp, 0.7, "hard_finger", edges), wrench])
    W[3:, -1] /= 0.05
    normals = np.hstack([np.kron(np.eye(n), np.ones(edges)), np.zeros((n, 1))])
    A, b = np.vstack([normals, -normals]), np.concatenate([forces[1], -forces[0]])
    bounds = [(0, None)] * (n * edges) + [(0, LARGEST_LOAD)]
    best = linprog(-np.eye(n * edges + 1)[-1], A, b, W, np.zeros(6), bounds)
    expected = float(best.x[-1]) if best.success else 0.0
    assert load >= expected - 1e-6
    assert load == pytest.approx(expected, rel=0.05, abs=0.05)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"model": "complete"}, "'complete'; there are: hard_finger, soft"),
        ({"friction": -0.1}, r"friction must be at least 0, not -0\.1"),
        ({"torsional_friction": -1}, "torsional_friction must be at least 0, not -1"),
        ({"length": 0}, "length must be greater than 0 m, not 0"),
    ],
)
def test_bad_arguments_are_refused(arguments, message):
    with pytest.raises(InvalidArgumentError, match=message):
        ball_radius(*on_box(0, 4), **({"friction": 0.7} | arguments))


CUBE = 0.05 * np.vstack([np.eye(3), -np.eye(3)])
models = pytest.mark.parametrize("model", CONE_MODELS)
grasps = seeds(3, 6)


def by_pseudoinverse(r, nhat, model):
    B = friction_cones(r, nhat, 0.7, model, 0.004)
    B[:, 3:] /= 0.05
    n, _, k = B.shape
    A = np.vstack([B.transpose(1, 0, 2).reshape(6, n * k), np.tile(np.eye(k)[0], n)])
    if np.linalg.matrix_rank(A, tol=1e-9) < 7:
        return -np.inf
    g = (np.linalg.pinv(A) @ np.eye(7)[6]).reshape(n, k)
    return n * np.min(g[:, 0] - np.linalg.norm(g[:, 1:], axis=1))


@models
@grasps
def test_it_equals_its_definition_and_is_a_lower_bound(model, seed, n):
    r, nhat = on_box(seed, n)
    bound = least_norm_margin(r, nhat, 0.7, model=model)
    assert bound == pytest.approx(by_pseudoinverse(r, nhat, model), rel=1e-6, abs=1e-9)
    assert bound <= 1 + 1e-12
    assert max(bound, 0) <= min_weight_margin(r, nhat, 0.7, model=model) + 1e-9


def test_it_certifies_a_good_share_of_good_grasps_and_no_bad_one():
    known = [on_box(seed, 5) for seed in range(80)]
    margins = np.array([min_weight_margin(*one, 0.7) for one in known])
    bounds = np.array([least_norm_margin(*one, 0.7) for one in known])
    assert np.mean(bounds[margins > 0.5] > 0) > 0.8
    assert not np.any(bounds[margins == 0] > 0)


@pytest.mark.parametrize("model", ["hard_finger", "soft_finger"])
@pytest.mark.parametrize("margin", [least_norm_margin, min_weight_margin])
def test_where_wrenches_add_up_to_zero_margins_are_one(margin, model):
    assert margin(CUBE, CUBE / 0.05, 0.7, model=model) == pytest.approx(1)


@models
@pytest.mark.parametrize("n", [1, 2, 5])
def test_moving_one_contact_and_many_sets_at_once_are_as_one_by_one(model, n):
    grasp, places = on_box(4, n), (SURFACE.p_OQ[::3], SURFACE.nhat_OQ[::3])
    for moved in {0, n // 2}:
        sets = [np.repeat(values[None], len(places[0]), axis=0) for values in grasp]
        for values, place in zip(sets, places, strict=True):
            values[:, moved] = place
        expected = [least_norm_margin(*one, 0.7, model=model) for one in zip(*sets, strict=True)]
        at_once = least_norm_margin(*sets, 0.7, model=model)
        np.testing.assert_allclose(at_once, expected, rtol=1e-9)
        p_CoMQ, nhat_Q = places
        values = moved_least_norm_margin(
            *grasp, 0.7, moved=moved, p_CoMQ=p_CoMQ, nhat_Q=nhat_Q, model=model
        )
        np.testing.assert_allclose(values, expected, rtol=1e-6)


def test_grasps_that_leave_a_wrench_out_are_not_certified():
    pair = CUBE[[0, 3]]
    assert least_norm_margin(pair, pair / 0.05, 0.7) == -np.inf
    assert least_norm_margin(pair, pair / 0.05, 0.7, model="soft_finger") == pytest.approx(1)


PADS = np.array([[0.03, 0, 0], [-0.03, 0, 0]]), np.array([[1.0, 0, 0], [-1, 0, 0]])


@pytest.mark.parametrize("offset", [0.0, 0.005, 0.03])
@pytest.mark.parametrize("friction", [0.3, 0.7])
def test_two_pads_hold_a_weight_beside_them_by_the_limit_surface(offset, friction):
    """Each pad carries half of weight and moment: |(t/mu, m/gamma)| = N at the largest load."""
    torsional, weight, force = 0.004, 2.0, 10.0
    load = largest_load(
        *PADS,
        friction,
        wrench=np.array([0, 0, -weight, weight * offset, 0, 0]),
        normal_forces=np.array([[1.0, 1.0], [force, force]]),
        model="soft_finger",
        torsional_friction=torsional,
    )
    expected = 2 * force / weight / np.hypot(1 / friction, offset / torsional)
    assert load == pytest.approx(min(expected, LARGEST_LOAD), rel=1e-4)


def test_a_soft_finger_without_torsional_friction_is_a_hard_one():
    for seed in range(5):
        r, nhat = on_box(seed, 4)
        each = np.array([0.0, 0.004, 0.0, 0.006])
        hard, mixed, soft = (
            min_weight_margin(r, nhat, 0.5, model=model, torsional_friction=torsional)
            for model, torsional in (
                ("hard_finger", 0.0),
                ("soft_finger", each),
                ("soft_finger", 0.006),
            )
        )
        assert hard <= mixed + 1e-7
        assert mixed <= soft + 1e-7
        none = min_weight_margin(r, nhat, 0.5, model="soft_finger", torsional_friction=0 * each)
        assert none == pytest.approx(hard, abs=1e-6)
        bound = moved_least_norm_margin(
            r,
            nhat,
            0.5,
            moved=1,
            p_CoMQ=r[1:2],
            nhat_Q=nhat[1:2],
            model="soft_finger",
            torsional_friction=each,
        )
        assert bound[0] <= mixed + 1e-7
        other = each[[3, 0, 1, 2]], [3, 0, 1, 2]
        turned = moved_least_norm_margin(
            r[other[1]],
            nhat[other[1]],
            0.5,
            moved=2,
            p_CoMQ=r[1:2],
            nhat_Q=nhat[1:2],
            model="soft_finger",
            torsional_friction=other[0],
        )
        np.testing.assert_allclose(bound, turned, atol=1e-9)  # The order does not matter.


def test_the_moment_of_a_patch_grows_with_friction_and_radius():
    radii = np.array([0.0, 0.005, 0.01])
    found = torsional_friction_of(0.7, radii)
    np.testing.assert_allclose(found, [0, TORSIONAL_FRICTION / 2, TORSIONAL_FRICTION], rtol=0.04)
    np.testing.assert_allclose(torsional_friction_of(0.35, radii), found / 2)
