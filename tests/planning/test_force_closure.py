import numpy as np
import pytest

from drake_pregrasp.planning.force_closure import min_weight_margin

AROUND = 0.05 * np.array([[1.0, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0]])


def test_a_symmetric_grasp_has_the_whole_margin():
    assert min_weight_margin(AROUND, AROUND / 0.05, 0.7) == pytest.approx(1)


def test_contacts_on_one_side_have_none():
    r = np.array([[0.05, 0.02, 0.02], [0.05, -0.02, 0.02], [0.05, 0, -0.02]])
    assert min_weight_margin(r, np.tile([1.0, 0, 0], (3, 1)), 0.7) == pytest.approx(0, abs=1e-9)


def test_two_contacts_cannot_resist_a_turn_about_their_line():
    assert min_weight_margin(AROUND[:2], AROUND[:2] / 0.05, 0.7) == 0


def test_more_friction_keeps_force_closure(p_OC, surface):
    _, normals = surface.project(p_OC)
    margins = [min_weight_margin(p_OC, normals, mu) for mu in (0.05, 0.7, 1.0)]
    assert margins[0] == pytest.approx(0, abs=1e-9)
    assert all(margin > 0 for margin in margins[1:])


def test_margin_does_not_depend_on_the_unit_of_length(p_OC, surface):
    _, normals = surface.project(p_OC)
    assert min_weight_margin(1000 * p_OC, normals, 0.7) == pytest.approx(
        min_weight_margin(p_OC, normals, 0.7), rel=1e-7
    )


def test_no_contact_has_no_margin():
    assert min_weight_margin(np.empty((0, 3)), np.empty((0, 3)), 0.7) == 0
