"""The compiled functions of a hand agree with their references in numpy."""

import numpy as np
import pytest

from drake_pregrasp.fast import numba_is_installed
from drake_pregrasp.grasping.clearances import Clearances, Links, NearPairs, clearances
from drake_pregrasp.grasping.grasp_state import BASE, NOT_BLOCKED
from drake_pregrasp.grasping.joint_velocities import JointLimits, next_velocities

if not numba_is_installed():
    pytest.skip("needs the extra fast", allow_module_level=True)
from drake_pregrasp.fast.hand import compiled_clearances, compiled_next_velocities

N, M, NQ = 3, 8, 11  # Fingers, links, joints.


def random_pairs(rng, k):
    normals = rng.normal(size=(k, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    # Other fingers, the object, or the rest.
    link, other = rng.integers(0, M, k), rng.choice([0, 1, M, M, M, M + 1], k)
    return NearPairs(link, other, rng.uniform(-0.01, 0.025, k), rng.normal(size=(k, 3)), normals)


@pytest.mark.parametrize("seed", range(40))
def test_clearances_are_those_of_the_reference(seed):
    rng = np.random.default_rng(seed)
    finger, is_tip = rng.integers(BASE, N, M), rng.random(M) < 0.4
    moves = np.vstack([rng.random((M, NQ)) < 0.5, np.zeros((2, NQ))]).astype(float)
    is_tip &= finger != BASE
    links = Links(finger, is_tip, (rng.random(M) < 0.7) & (finger != BASE), moves)
    others = rng.normal(size=(6, NQ)), rng.normal(size=6), rng.random(N) < 0.5 * (seed % 3)
    near = random_pairs(rng, 1 + seed % 14)
    expected = clearances(links, near, *others)
    for name, found in compiled_clearances(links, near, *others)._asdict().items():
        np.testing.assert_allclose(found, getattr(expected, name), atol=1e-12, err_msg=name)


@pytest.mark.parametrize("seed", range(40))
def test_velocities_are_those_of_the_reference(seed):
    """With loose limits, or with some that stop the joints, and with a degenerate Jacobian."""
    rng = np.random.default_rng(seed)
    J, V = rng.normal(size=(6, NQ)), rng.normal(size=6)
    if seed % 4 == 3:
        J[1] = J[0]
    room = (10.0, 0.5, 0.02)[seed % 3]
    limits = JointLimits(np.full(NQ, -room), np.full(NQ, room), np.full(NQ, 5.0), np.full(NQ, room))
    clear = Clearances(rng.normal(size=(3, NQ)), rng.normal(-room, 0.1, size=3), np.arange(3))
    q, v_last = rng.uniform(-room, room, (2, NQ))
    arguments = q, v_last, J, V, rng.normal(size=NQ), limits, clear
    (expected, blocked), (found, also) = (
        function(*arguments) for function in (next_velocities, compiled_next_velocities)
    )
    np.testing.assert_allclose(found, expected, atol=1e-9)
    assert also == blocked
    assert seed % 12 or blocked == NOT_BLOCKED
