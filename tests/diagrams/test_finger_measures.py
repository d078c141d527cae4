"""What fingers can do at contacts: by Drake's kinematics, by lattices, and as limits of regions."""

from dataclasses import replace

import numpy as np
import pytest
from conftest import usable_hands
from five_finger_hand import HAND, RING
from pydrake.multibody.tree import JacobianWrtVariable
from selections import CUBE, selection_of

from drake_pregrasp import InvalidArgumentError
from drake_pregrasp.config.limits_config import LimitsConfig
from drake_pregrasp.contacts.assignment import assign_fingers_round
from drake_pregrasp.contacts.centroids import best_points
from drake_pregrasp.contacts.selection_input import SelectionInput
from drake_pregrasp.contacts.strategies import make_strategy
from drake_pregrasp.diagrams.hand_model import HandModel
from drake_pregrasp.quality.grasp_quality import posture_measures
from drake_pregrasp.regions.constraints import Limit, RegionConstraints
from drake_pregrasp.regions.finger_measures import FINGER_MEASURES, FingerMeasures
from drake_pregrasp.regions.safe_regions import compute_safe_regions
from drake_pregrasp.simulation.hand_file import load_hand
from drake_pregrasp.simulation.scenario_file import load_resolved
from drake_pregrasp.simulation.simulation_diagram import make_diagram
from drake_pregrasp.systems.hand_kinematics import hand_links
from drake_pregrasp.systems.hand_scene import link_balls

R_TIP = HAND.tip_radii[0]
MEASURES = FingerMeasures.around(
    np.max(np.linalg.norm(CUBE.p_OQ, axis=1)) + R_TIP, HAND.fingers.chains
)


def drake_finger(hand, finger, q_own):
    """The fingertip's centre and the Jacobian of its own joints in A, by Drake."""
    kinematics, own = hand.kinematics, hand.kinematics.own_joints(finger)
    q = hand.base.at_home(hand.fingers_home)
    q[own] = q_own
    plant, frame = kinematics.plant, kinematics.frames[finger]
    context, world = plant.CreateDefaultContext(), plant.world_frame()
    plant.SetPositions(context, q)
    J = plant.CalcJacobianTranslationalVelocity(
        context, JacobianWrtVariable.kV, frame, np.zeros(3), world, world
    )
    p_WT = frame.CalcPoseInWorld(context).translation()
    return hand.base.X_AW @ p_WT, hand.base.X_AW.rotation() @ J[:, own]


@pytest.mark.slow
@pytest.mark.parametrize("name", usable_hands())
def test_chains_of_every_hand_move_as_in_drake(name):
    hand = HandModel(load_hand(f"package://drake_pregrasp/{name}.yaml"))
    for finger, chain in enumerate(hand.fingers.chains):
        q = np.random.default_rng(finger).uniform(chain.lower, chain.upper, (20, len(chain.home)))
        tips, jacobians = chain.tips(q)
        for q_own, tip, J in zip(q, tips, jacobians, strict=True):
            p, J_drake = drake_finger(hand, finger, q_own)
            np.testing.assert_allclose(tip, p, atol=1e-12)
            np.testing.assert_allclose(J, J_drake, atol=1e-12)
        near = chain.postures(tips)
        reached, J = chain.tips(near)
        assert np.max(np.linalg.norm(reached - tips, axis=1)) < 2e-3
        # No motion of the joints that leaves the fingertip where it is leads closer to home.
        closer = (np.eye(len(chain.home)) - np.linalg.pinv(J) @ J) @ (chain.home - near)[:, :, None]
        inner = np.all((near > chain.lower) & (near < chain.upper), axis=1)
        assert np.median(np.linalg.norm(closer[inner], axis=1)) < 0.05


@pytest.mark.slow
@pytest.mark.parametrize("name", usable_hands())
def test_links_of_every_hand_are_as_near_to_a_plane_as_in_drake(name):
    hand = HandModel(load_hand(f"package://drake_pregrasp/{name}.yaml"))
    plant, inspector = hand.kinematics.plant, hand.diagram.scene_graph().model_inspector()
    links = hand_links(plant, hand.kinematics.frames, hand.tip_radii, inspector)
    context, generator = plant.CreateDefaultContext(), np.random.default_rng(0)
    for finger, chain in enumerate(hand.fingers.chains):
        tip = chain.tips(generator.uniform(chain.lower, chain.upper)[None])[0][0]
        normal = generator.normal(size=3)
        normal /= np.linalg.norm(normal)
        gaps = hand.fingers.link_gaps(finger, tip[None], lambda p, n=normal, p_0=tip: (p - p_0) @ n)
        q = hand.base.at_home(hand.fingers_home)
        q[hand.kinematics.own_joints(finger)] = chain.postures(tip[None])[0]
        plant.SetPositions(context, q)
        expected = np.inf
        for geometry, link in links.items():
            if link.finger == finger and not link.is_tip:
                *p_BS, radii = link_balls(inspector, geometry).T
                p_AS = hand.base.X_AW @ link.frame.CalcPoseInWorld(context) @ np.array(p_BS)
                expected = min(expected, np.min(normal @ (p_AS - tip[:, None]) - radii))
        assert gaps[0] == pytest.approx(expected, abs=1e-9) or gaps[0] == -np.inf


def test_links_do_not_get_where_the_joints_do_not():
    places = HAND.p_HT[0] + np.array([[0.0, 0.0, 0.0], [0.5, 0.0, 0.0]])
    gaps = HAND.fingers.link_gaps(0, places, lambda p: np.full(len(p), 0.1))
    assert 0 < gaps[0] < 0.1
    assert gaps[1] == -np.inf


@pytest.mark.parametrize("finger", [0, 3])
def test_a_force_moves_a_fingertip_by_its_compliance(finger):
    """In balance the drives' torques K_p (q_d - q) are those of the force, J^T f."""
    p_HT = HAND.p_HT[finger] + [0.002, -0.003, 0.004]
    compliance, chain = HAND.fingers.compliance(finger, p_HT), HAND.fingers.chains[finger]
    q = chain.postures(p_HT[None])
    stiffness = HAND.kinematics.stiffness[HAND.kinematics.own_joints(finger)]
    for f in 1e-3 * np.eye(3):
        torques = chain.tips(q)[1][0].T @ f
        moved = chain.tips(q + torques / stiffness)[0][0] - chain.tips(q)[0][0]
        np.testing.assert_allclose(compliance @ f, moved, rtol=1e-3, atol=1e-9)
    assert np.isnan(HAND.fingers.compliance(finger, p_HT + 0.5)).all()


@pytest.mark.parametrize(("height", "passes"), [(0.03, False), (-0.03, True)])
def test_links_pass_through_a_plate_between_fingertip_and_palm(height, passes):
    for finger, tip in enumerate(HAND.p_HT):
        plate = tip[2] + height
        gaps = HAND.fingers.link_gaps(
            finger, tip[None], lambda p, z=plate: np.abs(p[:, 2] - z) - 0.001
        )
        assert (gaps[0] > 0.01) if passes else (gaps[0] < 0)


def reached_candidates(finger):
    """Candidates that a finger reaches, and its exact postures there."""
    chain, p_UT = HAND.fingers.chains[finger], CUBE.p_OQ + R_TIP * CUBE.nhat_OQ
    q = chain.postures(p_UT)
    gaps = np.linalg.norm(chain.tips(q)[0] - p_UT, axis=1)
    inner = np.all((q > chain.lower + 0.2) & (q < chain.upper - 0.2), axis=1)
    own = np.flatnonzero((gaps < 1e-5) & inner)
    assert len(own) > 100
    return own, q[own]


@pytest.mark.parametrize("finger", [0, 2])
def test_lattices_are_drakes_kinematics(finger):
    own, q = reached_candidates(finger)
    chain, nhat = HAND.fingers.chains[finger], CUBE.nhat_OQ[own]
    tips = CUBE.p_OQ[own] + R_TIP * nhat
    *of_jacobian, joint_range, force = MEASURES.at(np.full(len(own), finger), tips, nhat).T
    J = np.array([drake_finger(HAND, finger, q_own)[1] for q_own in q])
    for values, exact in zip(of_jacobian, posture_measures(J).T, strict=True):
        errors = np.abs(values - exact) / np.max(exact)
        assert np.quantile(errors, 0.9) < 0.03
        assert np.max(errors) < 0.2  # Near stretched postures, where they are curved.
    ranges = np.minimum(q - chain.lower, chain.upper - q) / (chain.upper - chain.lower)
    np.testing.assert_allclose(joint_range, ranges.min(axis=1), atol=0.03)

    # A little more than this force along the inward normal needs more than a joint's torque.
    torques = np.einsum("mij,mi->mj", J, -nhat) * force[:, None]
    loads = np.max(np.abs(torques) / chain.efforts, axis=1)
    assert np.all(1.02 * loads > 1)
    assert np.all(0.98 * loads < 1)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["five_finger_hand", "allegro_hand"])
def test_measures_between_nodes_are_as_exact_as_stated(name):
    hand = HandModel(load_hand(f"package://drake_pregrasp/{name}.yaml"))
    lattices, errors = FingerMeasures.around(0.12, hand.fingers.chains), []
    for finger, chain in enumerate(hand.fingers.chains):
        tips = chain.workspace.data
        tips = tips[np.linalg.norm(tips, axis=1) < 0.12][::5]
        reached, J = chain.tips(chain.postures(tips))
        exact = posture_measures(J)
        fingers = np.full(len(tips), finger)
        measures = lattices.at(fingers, tips, np.tile([0.0, 0, 1], (len(tips), 1)))[:, :3]
        own = np.abs(measures - exact) / np.max(exact, axis=0)
        errors.append(own[np.linalg.norm(reached - tips, axis=1) < 1e-3])
    errors = np.concatenate(errors)
    assert np.nanmax(errors) < 0.2
    assert np.all(np.nanquantile(errors, 0.95, axis=0) < 0.08)


@pytest.mark.parametrize("name", FINGER_MEASURES)
def test_weights_lead_to_the_best_place_for_the_finger(name):
    selection = SelectionInput(CUBE, P_OC, limited_regions(), np.eye(3))
    goals = best_points(selection, range(5), make_strategy(name))
    column, tips = FINGER_MEASURES.index(name), CUBE.p_OQ + R_TIP * CUBE.nhat_OQ
    for i in range(5):
        own = selection.regions.members(i)
        values = MEASURES.at(np.full(len(own), i), tips[own], CUBE.nhat_OQ[own])[:, column]
        there = values[np.all(CUBE.p_OQ[own] == goals[i], axis=1)]
        np.testing.assert_allclose(there, [np.nanmax(values)], rtol=1e-9)
    alone = selection_of(CUBE, P_OC)
    with pytest.raises(InvalidArgumentError, match="need the fingers of a hand"):
        best_points(alone, range(5), make_strategy(name))


def limited_regions(**least):
    constraints = RegionConstraints(
        5,
        tip_radii=np.full(5, R_TIP),
        nhat_OQ=CUBE.nhat_OQ,
        nhat_OC=CUBE.project(P_OC)[1],
        finger_measures=replace(MEASURES, least=LimitsConfig(**least).least_measures()),
    )
    return compute_safe_regions(CUBE.p_OQ, P_OC, np.zeros(5), CUBE.forbidden, constraints)


_azimuths = np.arctan2(RING[:, 1], RING[:, 0])
P_OC = RING[assign_fingers_round(HAND.azimuths, _azimuths, largest_offset=np.full(5, np.pi))[0]]


@pytest.mark.parametrize(
    ("name", "levels"),
    [
        ("singularity_distance", [0.03, 0.06]),
        ("manipulability", [1e-4, 1.2e-3]),
        ("uniformity", [0.2, 0.4]),
        ("joint_range", [0.1, 0.3]),
        ("finger_force", [5.5, 8]),
    ],
)
def test_a_larger_least_value_only_takes_candidates_away(name, levels):
    free = limited_regions().labels
    tips = CUBE.p_OQ + R_TIP * CUBE.nhat_OQ
    values = MEASURES.at(free, tips, CUBE.nhat_OQ)[:, FINGER_MEASURES.index(name)]
    sizes = []
    for level in levels:
        regions = limited_regions(**{name: level})
        # What is taken from a region belongs to no other one.
        np.testing.assert_array_equal(regions.labels, np.where(values >= level, free, -1))
        sizes.append(np.sum(regions.labels >= 0))
    assert np.sum(free >= 0) > sizes[0] > sizes[1] > 0
    nothing = limited_regions(manipulability=1.0)
    np.testing.assert_array_equal(nothing.limits, Limit.REACH)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("approach", "name", "least"), [("above", "joint_range", 0.36), ("side", "finger_force", 6.5)]
)
def test_a_limit_moves_start_contacts_to_where_fingers_are_able(approach, name, least):
    """By the palm's pose at the planner's port, which is where the run begins."""
    smallest = []
    for limit in (0.0, least):
        text = f"""{{surface: {{spacing: 0.015}}, motion: {{angular_velocity: 0, yaw: 0.4}},
            initial_contacts: [], grasp: {{approaches: [{approach}]}},
            planner: {{strategy: {name}, limits: {{{name}: {limit}}}}}}}"""
        resolved = load_resolved("grasp_five_finger", text=text)
        surface, hand, start = resolved.surface, resolved.hand, resolved.start
        diagram = make_diagram(resolved)
        planner = diagram.GetSubsystemByName("pregrasp_planner")
        context = planner.GetMyContextFromRoot(diagram.CreateDefaultContext())
        X_WO, X_WU = (
            port.Eval(context)
            for port in (planner.GetOutputPort("X_WO_estimated"), planner.GetInputPort("X_WU"))
        )
        own, X_UO = np.flatnonzero(start.has_contact), X_WU.inverse() @ X_WO
        nhat = surface.project(start.p_OC)[1][own]
        p_OT = start.p_OC[own] + hand.tip_radii[own, None] * nhat
        normals = nhat @ X_UO.rotation().matrix().T
        values = hand.fingers.measures.at(own, (X_UO @ p_OT.T).T, normals)
        smallest.append(values[:, FINGER_MEASURES.index(name)].min())
    assert smallest[0] < least <= smallest[1]
