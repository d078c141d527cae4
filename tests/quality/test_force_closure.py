import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from drake_pregrasp import InvalidArgumentError, box_surface
from drake_pregrasp.quality.force_closure import (
    CONE_EDGES,
    CONE_MODELS,
    cone_edges,
    ferrari_canny,
    least_norm_margin,
    min_weight_margin,
    primitive_wrenches,
)
from drake_pregrasp.quality.grasp_quality import grasp_quality

AROUND = 0.05 * np.array([[1.0, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0]])
SURFACE = box_surface([0.1, 0.08, 0.12], spacing=0.01)
seeds = given(seed=st.integers(0, 10**6), n=st.integers(2, 6))


def contacts(seed, n):
    q = np.random.default_rng(seed).choice(len(SURFACE.p_OQ), n, replace=False)
    return SURFACE.p_OQ[q], SURFACE.nhat_OQ[q]


def test_a_symmetric_grasp_has_the_whole_margin():
    assert min_weight_margin(AROUND, AROUND / 0.05, 0.7) == pytest.approx(1)


def test_contacts_on_one_side_have_none():
    r = np.array([[0.05, 0.02, 0.02], [0.05, -0.02, 0.02], [0.05, 0, -0.02]])
    nhat = np.tile([1.0, 0, 0], (3, 1))
    assert min_weight_margin(r, nhat, 0.7) == pytest.approx(0, abs=1e-9)
    assert ferrari_canny(r, nhat, 0.7, length=0.05) == 0


def test_two_hard_contacts_cannot_resist_a_turn_about_their_line_and_two_soft_ones_can():
    pair = AROUND[:2], AROUND[:2] / 0.05, 0.7
    assert min_weight_margin(*pair) == ferrari_canny(*pair, length=0.05) == 0
    assert min_weight_margin(*pair, model="soft_finger") == pytest.approx(1)
    assert min_weight_margin(*pair, model="soft_finger", torsional_friction=0) == 0
    # Half the newton at either side, each holding its twist: the weakest direction there is.
    twist = ferrari_canny(*pair, length=0.05, model="soft_finger", torsional_friction=0.004)
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
        assert min_weight_margin(r[six], normals[six], 0.7, model="frictionless") == 0
        assert ferrari_canny(r[six], normals[six], 0.7, length=0.05, model="frictionless") == 0
    assert min_weight_margin(r, normals, 0.7, model="frictionless") == pytest.approx(1)
    assert ferrari_canny(r, normals, 0.7, length=0.05, model="frictionless") > 0


def test_more_friction_keeps_force_closure(p_OC, surface):
    _, normals = surface.project(p_OC)
    margins = [min_weight_margin(p_OC, normals, mu) for mu in (0.05, 0.7, 1.0)]
    assert margins[0] == pytest.approx(0, abs=1e-9)
    assert all(margin > 0 for margin in margins[1:])


@pytest.mark.parametrize("model", CONE_MODELS)
@settings(max_examples=25)
@seeds
def test_margins_do_not_depend_on_the_unit_of_length(model, seed, n):
    r, nhat = contacts(seed, n)
    expected = min_weight_margin(r, nhat, 0.7, model=model)
    scaled = min_weight_margin(1e3 * r, nhat, 0.7, model=model, torsional_friction=4.0)
    assert scaled == pytest.approx(expected, abs=1e-6)
    radius = ferrari_canny(r, nhat, 0.7, length=0.05, model=model)
    assert ferrari_canny(
        1e3 * r, nhat, 0.7, length=50.0, model=model, torsional_friction=4.0
    ) == pytest.approx(radius, abs=1e-9)


@pytest.mark.parametrize("model", CONE_MODELS)
@settings(max_examples=40)
@seeds
def test_the_two_margins_agree_on_force_closure(model, seed, n):
    r, nhat = contacts(seed, n)
    margin = min_weight_margin(r, nhat, 0.7, model=model)
    radius = ferrari_canny(r, nhat, 0.7, length=0.05, model=model)
    assert 0 <= margin <= 1 + 1e-9
    assert (margin > 1e-7) == (radius > 1e-9)
    if margin > 1e-7:
        measured = "hard_finger" if model == "frictionless" else model
        assert grasp_quality(r, nhat, model=measured).indeterminate == 0


@settings(max_examples=30)
@seeds
def test_the_radius_is_the_least_support_of_the_primitive_wrenches(seed, n):
    """In no direction do the wrenches reach less far, and in none of random ones much less."""
    r, nhat = contacts(seed, n)
    W = primitive_wrenches(r, nhat, 0.7, model="hard_finger", torsional_friction=0)
    W[3:] /= 0.05
    directions = np.random.default_rng(seed).normal(size=(2000, 6))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    support = np.max(directions @ W, axis=1)
    radius = ferrari_canny(r, nhat, 0.7, length=0.05)
    assert radius <= max(np.min(support), 0) + 1e-12
    assert radius <= np.sqrt(1 + 0.7**2)


def test_the_radius_of_an_octahedron_of_wrenches_is_known():
    """Soft pairs on three axes without friction: forces and twists are 12 corners +-e_i, +-e_j."""
    r = np.vstack([0.05 * np.eye(3), -0.05 * np.eye(3)])
    options = {"length": 0.05, "model": "soft_finger", "torsional_friction": 0.05}
    # Each wrench is (e_i, +-e_i): the hull is that of 12 points of norm sqrt(2), three planes of
    # squares; a facet takes one corner of each square's four sides: 1/sqrt(3) from the origin.
    assert ferrari_canny(r, r / 0.05, 0.0, **options) == pytest.approx(1 / np.sqrt(3))


@pytest.mark.slow
@settings(max_examples=30)
@seeds
def test_more_friction_holds_no_less(seed, n):
    r, nhat = contacts(seed, n)
    for model in ("hard_finger", "soft_finger"):
        radii = [
            ferrari_canny(r, nhat, mu, length=0.05, model=model) for mu in (0.2, 0.5, 0.7, 1.0)
        ]
        assert np.all(np.diff(radii) >= -1e-12)
    hard = ferrari_canny(r, nhat, 0.7, length=0.05)
    assert hard <= ferrari_canny(r, nhat, 0.7, length=0.05, model="soft_finger") + 1e-12


@pytest.mark.slow
@settings(max_examples=30)
@seeds
def test_the_radius_turns_with_the_object_as_far_as_pyramids_are_cones(seed, n):
    """A pyramid stands inside its cone and around one that is narrower by cos(pi/8)."""
    r, nhat = contacts(seed, n)
    R = Rotation.random(random_state=seed).as_matrix()
    inside = np.cos(np.pi / CONE_EDGES)
    turned = ferrari_canny(r @ R.T, nhat @ R.T, 0.7, length=0.05)
    assert turned <= ferrari_canny(r, nhat, 0.7 / inside, length=0.05) + 1e-9
    assert turned >= ferrari_canny(r, nhat, 0.7 * inside, length=0.05) - 1e-9
    swapped = np.array([[0.0, -1, 0], [0, 0, 1], [-1, 0, 0]])  # Axes go to axes, pyramids too.
    for measure in (min_weight_margin, lambda *a: ferrari_canny(*a, length=0.05)):
        expected = measure(r, nhat, 0.7)
        assert measure(r @ swapped.T, nhat @ swapped.T, 0.7) == pytest.approx(expected, abs=1e-7)


@pytest.mark.parametrize("model", CONE_MODELS)
def test_edges_push_and_have_a_diagonal_gram_matrix(model):
    E = cone_edges(0.7, model, 0.004)
    assert np.all(E[0] == 1)
    gram = E @ E.T
    np.testing.assert_allclose(gram, np.diag(np.diag(gram)), atol=1e-15)
    if model == "hard_finger":
        np.testing.assert_allclose(np.hypot(E[1], E[2]), 0.7)


def test_no_contact_has_no_margin():
    none = np.empty((0, 3)), np.empty((0, 3)), 0.7
    for model in CONE_MODELS:
        assert min_weight_margin(*none, model=model) == 0
        assert ferrari_canny(*none, length=0.05, model=model) == 0


def test_bad_arguments_are_refused():
    some = AROUND, AROUND / 0.05
    with pytest.raises(InvalidArgumentError, match="'complete'; there are: hard_finger, soft"):
        min_weight_margin(*some, 0.7, model="complete")
    with pytest.raises(InvalidArgumentError, match=r"friction must be at least 0, not -0\.1"):
        min_weight_margin(*some, -0.1)
    with pytest.raises(InvalidArgumentError, match="torsional_friction must be at least 0, not -1"):
        ferrari_canny(*some, 0.7, length=0.05, model="soft_finger", torsional_friction=-1)
    with pytest.raises(InvalidArgumentError, match="length must be greater than 0 m, not 0"):
        ferrari_canny(*some, 0.7, length=0)


@pytest.mark.parametrize(("model", "friction"), [("frictionless", 0.7), ("hard_finger", 0.0)])
def test_nothing_holds_a_ball_without_friction(model, friction):
    rng = np.random.default_rng(0)
    for n in (5, 10, 20):
        nhat = rng.normal(size=(n, 3))
        nhat /= np.linalg.norm(nhat, axis=1, keepdims=True)
        assert min_weight_margin(0.05 * nhat, nhat, friction, model=model) == 0
        assert ferrari_canny(0.05 * nhat, nhat, friction, length=0.05, model=model) == 0
        assert not least_norm_margin(0.05 * nhat, nhat, friction, model=model) > 0
