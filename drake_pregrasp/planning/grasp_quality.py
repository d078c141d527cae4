"""Grasp matrices, the measures Q_MSV, Q_GII and Q_VEW, and the classification of Eq. 8-9."""

from dataclasses import astuple, dataclass, fields

import numpy as np

from drake_pregrasp.planning.arrays import FloatArray


@dataclass(frozen=True)
class GraspQuality:
    """Quality of a set of contacts; zeros where there is no contact.

    Attributes:
        q_msv: Smallest singular value of the complete grasp matrix.
        q_gii: Grasp isotropy index: smallest over largest singular value.
        q_vew: Volume of the wrench ellipsoid, sqrt(det(G Gᵀ)).
        graspable: 1 if N(G) of the hard-finger model is not trivial (Eq. 9), else 0.
        indeterminate: 1 if N(Gᵀ) of the hard-finger model is not trivial (Eq. 8), else 0.
    """

    q_msv: float
    q_gii: float
    q_vew: float
    graspable: float
    indeterminate: float

    def to_vector(self) -> FloatArray:
        """Returns the values in the order of the attributes."""
        return np.array(astuple(self))

    @staticmethod
    def names() -> list[str]:
        """Returns the attributes' names in their order."""
        return [field.name for field in fields(GraspQuality)]


def skew(r: FloatArray) -> FloatArray:
    """Returns the matrices [r]x with [r]x a = r x a, shape (n, 3, 3), of vectors, shape (n, 3)."""
    matrices = np.zeros((len(r), 3, 3))
    matrices[:, 2, 1], matrices[:, 0, 2], matrices[:, 1, 0] = r.T
    return matrices - np.swapaxes(matrices, 1, 2)


def complete_grasp_matrix(p_CoMC: FloatArray) -> FloatArray:
    """Returns the complete grasp matrix G = [G_1 ... G_n], before any contact-model selection.

    G_i = [[I, 0], [[r_i]x, I]] maps the wrench (force, torque) at contact i to the one about the
    centre of mass. With it Table II's values come out; all singular values are near sqrt(n).

    Args:
        p_CoMC: Lever arms r_i from the centre of mass to the contacts, shape (n, 3), in metres,
            expressed in any one frame: singular values do not depend on it.

    Returns:
        Shape (6, 6n); force rows first.
    """
    n = len(p_CoMC)
    blocks = np.tile(np.eye(6), (n, 1, 1))
    blocks[:, 3:, :3] = skew(p_CoMC)
    return np.concatenate(list(blocks), axis=1) if n else np.empty((6, 0))


def hard_finger_grasp_matrix(p_CoMC: FloatArray) -> FloatArray:
    """Returns the grasp matrix of point contacts with friction, which transmit forces only.

    The torque rows are divided by the longest lever arm, so that ranks don't depend on units.

    Args:
        p_CoMC: As for `complete_grasp_matrix`.

    Returns:
        Shape (6, 3n); force rows first.
    """
    n = len(p_CoMC)
    complete = complete_grasp_matrix(p_CoMC).reshape(6, n, 6)
    length = max(np.max(np.linalg.norm(p_CoMC, axis=1), initial=0.0), np.finfo(float).tiny)
    complete[3:] /= length
    return complete[:, :, :3].reshape(6, 3 * n)


def grasp_quality(p_CoMC: FloatArray) -> GraspQuality:
    """Measures a grasp by its complete grasp matrix and classifies it by the hard-finger model.

    The classification is run on the hard-finger model because for the complete matrix it is
    vacuous: with two contacts or more, 6n > 6 columns of rank 6 always make it graspable.

    Args:
        p_CoMC: Lever arms of the active contacts, as for `complete_grasp_matrix`.
    """
    n = len(p_CoMC)
    if n == 0:
        return GraspQuality(0.0, 0.0, 0.0, graspable=0.0, indeterminate=1.0)
    sigma = np.linalg.svd(complete_grasp_matrix(p_CoMC), compute_uv=False)
    rank = int(np.linalg.matrix_rank(hard_finger_grasp_matrix(p_CoMC), tol=1e-9))
    return GraspQuality(
        q_msv=float(sigma[-1]),
        q_gii=float(sigma[-1] / sigma[0]),
        q_vew=float(np.prod(sigma)),
        graspable=float(rank < 3 * n),
        indeterminate=float(rank < 6),
    )
