"""Inelastic impacts of a rigid body that are found before it penetrates another one."""

import numpy as np
from scipy.spatial.transform import Rotation

from drake_pregrasp.arrays import FloatArray

_TINY = 1e-12  # Impulse in N s that avoids a division by zero.
_POINTS, _SWEEPS = 30, 20  # Largest numbers of points that hit, and of sweeps over them for each.


def impact(
    points: FloatArray,
    distances: FloatArray,
    normals: FloatArray,
    V: FloatArray,
    M: FloatArray,
    *,
    friction: float,
    time_step: float,
    depth: float,
) -> FloatArray:
    """Returns the change of a body's velocity by which it stops at what it would hit, shape (6,).

    Each point that would be too deep after the time step gets an impulse inside its friction cone,
    which leaves it the velocity that it needs to arrive, and none along the surface if friction
    suffices. The impulses result from projected Gauss-Seidel iterations over the points.

    Args:
        points: Points of the body relative to its centre of mass, shape (k, 3), in metres.
        distances: Signed distances of the points to what they may hit, shape (k,), in metres.
        normals: Unit gradients of the distances, shape (k, 3).
        V: Angular velocity and velocity of the centre of mass, shape (6,), in rad/s and m/s.
        M: Spatial inertia about the centre of mass, shape (6, 6), in kg m^2 and kg.
        friction: Coulomb's coefficient.
        time_step: Time step, in seconds.
        depth: Depth that a point may reach in it, in metres.
    """
    change, lowest = np.zeros(6), np.minimum(distances + depth / 2, -depth)
    mobility = np.linalg.inv(M)
    impulses: dict[int, FloatArray] = {}  # Of each point that hits: along its normal, and across.
    for _ in range(_POINTS):
        w, v = np.split(V + change, 2)
        moved = Rotation.from_rotvec(time_step * w).apply(points)
        excess = distances - lowest + np.sum(normals * (moved - points + time_step * v), axis=1)
        deepest = int(np.argmin(excess))
        if excess[deepest] > -depth / 10:
            break
        impulses.setdefault(deepest, np.zeros(3))
        hits = []
        for k in impulses:
            axes = np.linalg.svd(normals[k : k + 1])[2]
            axes[0] = normals[k]
            J = np.hstack([np.cross(moved[k], axes), axes])
            arrival = np.array([J[0] @ (V + change) - excess[k] / time_step, 0.0, 0.0])
            hits.append((k, J, mobility @ J.T, arrival))
        for _ in range(_SWEEPS):
            for k, J, response, arrival in hits:
                impulse = impulses[k] + (arrival - J @ (V + change)) / np.trace(J @ response)
                impulse[0] = max(0.0, impulse[0])
                across = max(float(np.linalg.norm(impulse[1:])), _TINY)
                impulse[1:] *= min(1.0, friction * impulse[0] / across)
                change += response @ (impulse - impulses[k])
                impulses[k] = impulse
    return change
