"""Motions of an object as the pose filter assumes them, and measurements of them."""

import numpy as np
from scipy.spatial.transform import Rotation


def sampled_motion(rng, noise, dt, steps=40):
    """Returns positions, velocities, orientations and angular velocities at each step."""
    L = np.linalg.cholesky(np.array([[dt**3 / 3, dt**2 / 2], [dt**2 / 2, dt]]))
    fall = np.array([0, 0, -noise.gravity])
    p, v = np.zeros(3), rng.normal(scale=noise.initial_velocity, size=3)
    R, w = Rotation.identity(), rng.normal(scale=noise.initial_angular_velocity, size=3)
    motion = []
    for _ in range(steps):
        motion.append((p, v, R, w))
        dp, dv = noise.acceleration * L @ rng.normal(size=(2, 3))
        turn, dw = noise.angular_acceleration * L @ rng.normal(size=(2, 3))
        p, v = p + v * dt + fall * dt**2 / 2 + dp, v + fall * dt + dv
        R, w = Rotation.from_rotvec(w * dt + turn) * R, w + dw
    p, v, R, w = zip(*motion, strict=True)
    return np.array(p), np.array(v), Rotation.concatenate(R), np.array(w)


def measured(rng, p, R, noise, p_OCoM=(0.0, 0.0, 0.0)):
    """Returns the measured positions of O and its measured orientations, for centres of mass p."""
    R_z = Rotation.from_rotvec(rng.normal(scale=noise.orientation, size=p.shape)) * R
    return p - R.apply(p_OCoM) + rng.normal(scale=noise.position, size=p.shape), R_z


def normalized_squares(belief, p, v, R, w):
    """Returns eᵀ P⁻¹ e of the position with its velocity, and of the orientation with its rate."""
    theta = (R * Rotation.from_matrix(belief.R_WO[0]).inv()).as_rotvec()
    e = np.concatenate([theta, p - belief.p_WCoM[0], np.append(w, v) - belief.V_WCoM[0]])
    translation = np.r_[3:6, 9:12]
    rotation = np.r_[0:3, 6:9]
    return tuple(
        e[part] @ np.linalg.solve(belief.P[0][np.ix_(part, part)], e[part])
        for part in (translation, rotation)
    )
