"""Contact models: which forces and moments a fingertip passes on to the object.

At a contact stands a frame whose first axis is the inward normal n; t and o complete it. A model
selects, out of the complete set of three forces and three moments there, the ones that are passed
on (Prattichizzo & Trinkle, "Grasping", Springer Handbook of Robotics, 2nd edition, ch. 38):

- `complete`: all six, along the axes of the frame of the lever arms. It needs no normals.
- `hard_finger`: a point with friction, the forces along n, t and o.
- `soft_finger`: the same, and the moment about n.
- `frictionless`: the force along n alone.
"""

import numpy as np

from drake_pregrasp.arrays import FloatArray
from drake_pregrasp.errors import InvalidArgumentError

CONTACT_MODELS = ("complete", "hard_finger", "soft_finger", "frictionless")
"""The contact models, by name."""

_COLUMNS = {
    "complete": (3, 3),
    "hard_finger": (3, 0),
    "soft_finger": (3, 1),
    "frictionless": (1, 0),
}

NEED_NORMALS = ("soft_finger", "frictionless")
"""Those whose measures depend on the normals at the contacts."""


def grasp_matrix(
    p_CoMC: FloatArray, nhat: FloatArray | None, model: str, *, length: float = 1.0
) -> FloatArray:
    """Returns G = [G_1 ... G_n], from what the contacts pass on to the wrench on the object.

    For the complete model G_i = [[I, 0], [[r_i]x, I]]; with it Table II's values come out, and
    all singular values are near sqrt(n).

    Args:
        p_CoMC: Lever arms r_i from the centre of mass to the contacts, shape (n, 3), in metres,
            expressed in any one frame: singular values do not depend on it.
        nhat: Outward unit normals at the contacts, in that frame, shape (n, 3). The complete
            model doesn't use them; the hard finger's t and o may be any axes, so that without
            normals its forces are along those of the frame.
        model: One of `CONTACT_MODELS`.
        length: Unit of the lever arms, in metres: torques and moments count in newtons times it,
            so that G has no unit.

    Returns:
        Shape (6, kn), k being the model's number of columns for a contact; force rows first.

    Raises:
        InvalidArgumentError: If there is no such model, it needs normals, or the length isn't > 0.
    """
    if not length > 0:
        raise InvalidArgumentError(f"length must be greater than 0 m, not {length}")
    blocks = contact_blocks(p_CoMC / length, nhat, model)
    n, _, k = blocks.shape
    G: FloatArray = blocks.transpose(1, 0, 2).reshape(6, n * k)
    return G


def contact_blocks(p_CoMC: FloatArray, nhat: FloatArray | None, model: str) -> FloatArray:
    """Returns the G_i of `grasp_matrix` for sets of contacts at once, in metres and newtons.

    Args:
        p_CoMC: Lever arms, shape (..., 3).
        nhat: Outward unit normals, shape (..., 3).
        model: One of `CONTACT_MODELS`.

    Returns:
        Shape (..., 6, k).

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
        axes, torques = np.eye(3), skew(p_CoMC)
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


def contact_axes(nhat: FloatArray) -> FloatArray:
    """Returns the axes of the contact frames, the inward normal n, t and o, as columns.

    Args:
        nhat: Outward unit normals, shape (..., 3).

    Returns:
        Rotation matrices, shape (..., 3, 3).
    """
    helper = np.eye(3)[np.argmin(np.abs(nhat), axis=-1)]
    t = np.cross(nhat, helper)
    t /= np.linalg.norm(t, axis=-1, keepdims=True)
    return np.stack([-nhat, t, np.cross(-nhat, t)], axis=-1)


def skew(r: FloatArray) -> FloatArray:
    """Returns [r]x with [r]x a = r x a, shape (..., 3, 3), of vectors, shape (..., 3)."""
    x, y, z = r[..., 0], r[..., 1], r[..., 2]
    matrices = np.zeros((*r.shape, 3))
    matrices[..., 2, 1], matrices[..., 0, 2], matrices[..., 1, 0] = x, y, z
    matrices[..., 1, 2], matrices[..., 2, 0], matrices[..., 0, 1] = -x, -y, -z
    return matrices
