"""The measures Q_MSV, Q_GII and Q_VEW, the classification (Eq. 8-9), and hand-centric measures."""

import math
from dataclasses import dataclass, fields

import numpy as np

from drake_pregrasp.arrays import FloatArray
from drake_pregrasp.errors import InvalidArgumentError
from drake_pregrasp.geometry.rotations import skew

CONTACT_MODELS = ("complete", "hard_finger", "soft_finger", "frictionless")
"""Names of the contact models."""

_COLUMNS = {
    "complete": (3, 3),
    "hard_finger": (3, 0),
    "soft_finger": (3, 1),
    "frictionless": (1, 0),
}

NEED_NORMALS = ("soft_finger", "frictionless")
"""Contact models whose measures depend on the normals at the contacts."""

QUALITY_MEASURES = ("q_msv", "q_gii", "q_vew")
"""Measures of the paper's Table II, by their names in `GraspQuality`."""

_WRENCH_SIZE = 6
_RANK_TOLERANCE = 1e-9
_I = np.eye(3)
_TINY = np.finfo(float).tiny
_LEAST_RATIO = 1e-2  # Of sigma_min to sigma_max, if eigenvalues of M Mᵀ tell sigma to 12 digits.


def grasp_matrix(
    p_CoMC: FloatArray, nhat: FloatArray | None, model: str, *, length: float = 1.0
) -> FloatArray:
    """Returns G = [G_1 ... G_n], which maps contact forces to the wrench on the object.

    For the complete model G_i = [[I, 0], [[r_i]x, I]]. It gives the values of Table II, and all
    singular values are near sqrt(n).

    Args:
        p_CoMC: Lever arms r_i from the centre of mass to the contacts, shape (n, 3), in metres, in
            any frame, because singular values do not depend on it.
        nhat: Outward unit normals at the contacts, in the same frame, shape (n, 3). The complete
            model does not use them. Without normals, the forces of a hard finger are expressed in
            the frame's axes, which gives the same singular values.
        model: One of `CONTACT_MODELS`.
        length: Unit of the lever arms, in metres. Torques and moments are divided by it, so that G
            has no unit.

    Returns:
        The matrix, shape (6, kn), for k columns per contact; force rows first.

    Raises:
        InvalidArgumentError: If there is no such model, it needs normals, or the length is not
            above 0.
    """
    if not length > 0:
        raise InvalidArgumentError(f"length must be greater than 0 m, not {length}")
    blocks = contact_blocks(p_CoMC / length, nhat, model)
    n, _, k = blocks.shape
    G: FloatArray = blocks.transpose(1, 0, 2).reshape(6, n * k)
    return G


def contact_blocks(p_CoMC: FloatArray, nhat: FloatArray | None, model: str) -> FloatArray:
    """Returns the G_i of `grasp_matrix` for sets of contacts at once, shape (..., 6, k).

    Args:
        p_CoMC: Lever arms, shape (..., 3), in the unit of length of the result.
        nhat: Outward unit normals, shape (..., 3).
        model: One of `CONTACT_MODELS`.

    Raises:
        InvalidArgumentError: If there is no such model, or it needs normals.
    """
    if model not in CONTACT_MODELS:
        raise InvalidArgumentError(
            f"no contact model {model!r}; there are: {', '.join(CONTACT_MODELS)}"
        )
    if nhat is None and model in NEED_NORMALS:
        raise InvalidArgumentError(f"the contact model {model} needs the normals nhat")
    if nhat is None or model == "complete":
        axes, torques = _I, skew(p_CoMC)
    else:
        axes = contact_axes(nhat)
        if model == "frictionless":
            axes = axes[..., :1]
        torques = skew(p_CoMC) @ axes
    num_forces, num_moments = _COLUMNS[model]
    blocks = np.zeros((*p_CoMC.shape[:-1], 6, num_forces + num_moments))
    blocks[..., :3, :num_forces] = axes
    blocks[..., 3:, :num_forces] = torques
    blocks[..., 3:, num_forces:] = axes[..., :num_moments]
    return blocks


def characteristic_length(length: float, model: str, longest_arm: float) -> float:
    """Returns the unit of the lever arms in measures, in metres.

    Args:
        length: The unit, or 0 for the default: one metre for the complete model, as in the paper's
            tables, and the longest lever arm for the others.
        model: One of `CONTACT_MODELS`.
        longest_arm: Longest lever arm on the object, in metres.
    """
    return length or (1.0 if model == "complete" else longest_arm)


def longest_arm(p_CoMC: FloatArray) -> float:
    """Returns the longest of lever arms, shape (..., 3), in metres; it is always above zero."""
    squares = np.add.reduce(p_CoMC * p_CoMC, axis=-1)
    return max(math.sqrt(squares.max(initial=0.0)), _TINY)


def contact_axes(nhat: FloatArray) -> FloatArray:
    """Returns the axes of the contact frames as columns of matrices, shape (..., 3, 3).

    They are the inward normal n, and two tangents t and o.

    Args:
        nhat: Outward unit normals, shape (..., 3).
    """
    helper = np.eye(3)[np.argmin(np.abs(nhat), axis=-1)]
    t = np.cross(nhat, helper)
    t /= np.linalg.norm(t, axis=-1, keepdims=True)
    return np.stack([-nhat, t, np.cross(-nhat, t)], axis=-1)


@dataclass(frozen=True)
class GraspQuality:
    """Quality of a set of contacts; zeros where there is no contact.

    Attributes:
        q_msv: Smallest singular value of the grasp matrix G, zero if it has too few columns.
        q_gii: Grasp isotropy index: smallest over largest singular value.
        q_vew: Volume of the wrench ellipsoid, sqrt(det(G Gᵀ)).
        graspable: 1 if N(G) is not trivial, else 0.
        indeterminate: 1 if N(Gᵀ) is not trivial, else 0.
    """

    q_msv: float
    q_gii: float
    q_vew: float
    graspable: float
    indeterminate: float

    def to_vector(self) -> FloatArray:
        """Returns the values in the order of the attributes."""
        return np.array(list(vars(self).values()))

    @staticmethod
    def names() -> list[str]:
        """Returns the attributes' names in their order."""
        return [field.name for field in fields(GraspQuality)]


def grasp_quality(
    p_CoMC: FloatArray,
    nhat: FloatArray | None = None,
    *,
    model: str = "complete",
    length: float = 1.0,
) -> GraspQuality:
    """Measures a grasp by the grasp matrix of a contact model, and classifies it (Eq. 8-9).

    With the complete model, two contacts or more would always be graspable, because 6n > 6 columns
    have rank 6. The classification then uses the hard-finger model.

    Args:
        p_CoMC: Lever arms of the active contacts, as for `grasp_matrix`.
        nhat: Outward unit normals at the active contacts, as for `grasp_matrix`.
        model: One of `CONTACT_MODELS`.
        length: Unit of the lever arms in the measures, as for `grasp_matrix`; the paper's is 1 m.

    Raises:
        InvalidArgumentError: As for `grasp_matrix`.
    """
    G = grasp_matrix(p_CoMC, nhat, model, length=length)
    if len(p_CoMC) == 0:
        return GraspQuality(0.0, 0.0, 0.0, graspable=0.0, indeterminate=1.0)
    # The first columns of each contact, at most three, are forces; a hard finger, by which the
    # complete model is classified, has no others.
    blocks = G.reshape(_WRENCH_SIZE, len(p_CoMC), -1)
    blocks = (blocks[:, :, :3] if model == "complete" else blocks).copy()
    # Their torques are divided by the longest lever arm, so that ranks do not depend on units.
    blocks[3:, :, :3] *= length / longest_arm(p_CoMC)
    H = blocks.reshape(_WRENCH_SIZE, -1)
    sigma, sigma_of_H = _singular_values(G, H)
    rank = np.count_nonzero(sigma_of_H > _RANK_TOLERANCE)
    return GraspQuality(
        q_msv=float(sigma[-1]),
        q_gii=float(sigma[-1] / sigma[0]),
        q_vew=float(np.multiply.reduce(sigma)),
        graspable=float(rank < H.shape[1]),  # Eq. 9: N(G) is not {0}.
        indeterminate=float(rank < _WRENCH_SIZE),  # Eq. 8: N(Gᵀ) is not {0}.
    )


def _singular_values(*matrices: FloatArray) -> list[FloatArray]:
    """Returns the singular values of matrices with six rows, largest first, shape (6,) each."""
    squares = np.linalg.eigvalsh(np.array([M @ M.T for M in matrices]))
    found = [np.sqrt(np.maximum(square[::-1], 0.0)) for square in squares]
    for sigma, M in zip(found, matrices, strict=True):
        if not sigma[-1] > _LEAST_RATIO * sigma[0]:  # The root magnifies rounding.
            exact = np.linalg.svd(M, compute_uv=False)
            sigma[:] = 0.0  # Fewer than six columns leave singular values of zero.
            sigma[: len(exact)] = exact
    return found


def posture_measures(J: FloatArray) -> FloatArray:
    """Returns the hand-centric measures of Jacobians, shape (..., 3), that Roa & Suárez collect.

    - Distance to a singularity: the smallest singular value.
    - Manipulability: the product of the singular values, sqrt(det(J Jᵀ)), which is the volume of
      the manipulability ellipsoid up to a constant (Yoshikawa, 1985).
    - Uniformity of transformation: the smallest over the largest singular value, the inverse of the
      condition number (Salisbury & Craig, 1982), so that larger is better.

    Args:
        J: Jacobians with at least as many columns as rows, shape (..., r, k), not zero.
    """
    sigma = np.linalg.svd(J, compute_uv=False)
    smallest, largest = sigma[..., -1], sigma[..., 0]
    return np.stack([smallest, np.prod(sigma, axis=-1), smallest / largest], axis=-1)
