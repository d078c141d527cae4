"""Kinematics of hands by products of exponentials, in both implementations, against Drake."""

import numpy as np
import pytest
from conftest import usable_hands
from pydrake.multibody.tree import BodyIndex, JacobianWrtVariable

from drake_pregrasp import HandModel, load_hand
from drake_pregrasp.fast import default_kernels, numba_is_installed
from drake_pregrasp.fast.kernels import REFERENCE
from drake_pregrasp.systems.hand_kinematics import HandKinematics

needs_numba = pytest.mark.skipif(not numba_is_installed(), reason="needs the extra fast")


@pytest.fixture(scope="module", params=usable_hands())
def model(request):
    return HandModel(load_hand(f"package://drake_pregrasp/{request.param}.yaml"))


@pytest.fixture(params=["numpy", pytest.param("numba", marks=needs_numba)])
def hand(model, request, monkeypatch):
    monkeypatch.delenv("DRAKE_PREGRASP_FAST", raising=False)
    kernels = REFERENCE if request.param == "numpy" else default_kernels()
    known = model.kinematics
    return HandKinematics(known.plant, known.tip_frames, kernels.hand().forward_kinematics)


@pytest.mark.parametrize("seed", range(3))
def test_poses_screws_and_jacobians_are_those_of_drake(hand, seed):
    plant, q = hand.plant, np.random.default_rng(seed).normal(size=hand.num_positions)
    context, world = plant.CreateDefaultContext(), plant.world_frame()
    plant.SetPositions(context, q)
    pose = hand.pose(q)
    for index in map(BodyIndex, range(plant.num_bodies())):
        X_WB = plant.get_body(index).EvalPoseInWorld(context)
        np.testing.assert_allclose(pose.X_WB[int(index)], X_WB.GetAsMatrix34(), atol=1e-12)
    v = np.random.default_rng(9).normal(size=len(q))
    for tip, frame in enumerate(hand.frames):
        J = plant.CalcJacobianTranslationalVelocity(
            context, JacobianWrtVariable.kV, frame, np.zeros(3), world, world
        )
        np.testing.assert_allclose(pose.J_WT[tip], J, atol=1e-12)
        np.testing.assert_allclose(
            pose.p_WT[tip], frame.CalcPoseInWorld(context).translation(), atol=1e-12
        )
        # What moves all joints moves the fingertip, of which only its own screws count.
        w, v_origin = np.split(pose.screws @ (v * np.any(J, axis=0)), 2)
        np.testing.assert_allclose(v_origin + np.cross(w, pose.p_WT[tip]), J @ v, atol=1e-10)


def test_positions_that_are_not_known_have_no_fingertips(hand):
    pose = hand.pose(np.full(hand.num_positions, np.nan))
    assert np.isnan(pose.p_WT).all()
