"""Choosing all contacts at once, anew each time, by continuous optimisation over flat faces.

Both methods maximise Q_MSV² of the hand, the smallest eigenvalue lambda of G Gᵀ:

- SLSQP (Kraft, DFVLR-FB 88-28, 1988) from many starts: contacts stay on the faces they start on;
- differential evolution (Storn & Price, J. Global Optimization 11, 1997) over all faces.

With v = (u, w) the unit eigenvector of lambda, in forces and moments,

    lambda = |Gᵀ v|² = sum_i |e_i|² + n |w|²,   e_i = u - r_i x w,

so that it grows with r_i as -2 w x e_i; the eigenvector's own change counts in second order only.
"""

from dataclasses import dataclass

import numpy as np
from scipy.optimize import differential_evolution, minimize

from drake_pregrasp.arrays import FloatArray, IntArray
from drake_pregrasp.geometry.box_surface import face_normal
from drake_pregrasp.studies.global_selection import grasp_grams

_SPREAD_OF_SCORES = 1e-6  # Of a population at rest, relative; random ones are within 1e-2.


@dataclass(frozen=True, eq=False)
class Faces:
    """Rectangles on which contacts may be.

    Attributes:
        centers: Relative to the centre of mass, shape (F, 3), in metres.
        axes: Unit vectors u and v along the edges, shape (F, 2, 3).
        halves: Half edges along u and v, the same for all, shape (2,), in metres.
    """

    centers: FloatArray
    axes: FloatArray
    halves: FloatArray

    def points(self, faces: IntArray, uv: FloatArray) -> FloatArray:
        """Returns points of faces, shape (..., n, 3), by coordinates in metres, (..., n, 2)."""
        p: FloatArray = self.centers[faces] + np.sum(uv[..., None] * self.axes[faces], axis=-2)
        return p


def side_faces(edge: float, clearance: float) -> Faces:
    """Returns the sides of a cube one round, without the strips along its top and bottom.

    Args:
        edge: Of the cube, in metres.
        clearance: Width of the strips, in metres.
    """
    normals = np.array([face_normal(face) for face in ("+x", "+y", "-x", "-y")])
    z = np.array([0.0, 0.0, 1.0])
    axes = np.stack([np.cross(z, normals), np.tile(z, (4, 1))], axis=1)
    return Faces(edge / 2 * normals, axes, np.array([edge / 2, edge / 2 - clearance]))


def least_eigenvalue(p_CoMC: FloatArray) -> tuple[float, FloatArray]:
    """Returns Q_MSV² of contacts, shape (n, 3), and its gradient, of the same shape, in 1/m."""
    values, vectors = np.linalg.eigh(np.sum(grasp_grams(p_CoMC), axis=0))
    u, w = vectors[:3, 0], vectors[3:, 0]
    gradient: FloatArray = -2 * np.cross(w, u - np.cross(p_CoMC, w))
    return float(values[0]), gradient


def slsqp_choice(
    faces: Faces,
    contacts: int,
    generator: np.random.Generator,
    *,
    starts: int = 10,
    gradient: bool = True,
) -> FloatArray:
    """Returns the best contacts that SLSQP finds, shape (n, 3), relative to the centre of mass.

    Args:
        faces: Where contacts may be.
        contacts: How many to choose, n.
        generator: Of the starts.
        starts: How many.
        gradient: Whether SLSQP is told the gradient, or has to make it out of differences.
    """
    best, chosen = -np.inf, np.empty((contacts, 3))
    for _ in range(starts):
        on = generator.integers(len(faces.centers), size=contacts)
        loss = _Loss(faces, on)
        result = minimize(
            loss.with_gradient if gradient else loss.value,
            generator.uniform(-1, 1, 2 * contacts),
            jac=gradient,
            method="SLSQP",
            bounds=[(-1, 1)] * (2 * contacts),
        )
        if -result.fun > best:
            best, chosen = -result.fun, loss.points(np.clip(result.x, -1, 1))
    return chosen


@dataclass(frozen=True, eq=False)
class _Loss:
    """-Q_MSV² over coordinates in halves of the faces that the contacts are on."""

    faces: Faces
    on: IntArray

    def points(self, x: FloatArray) -> FloatArray:
        return self.faces.points(self.on, x.reshape(-1, 2) * self.faces.halves)

    def value(self, x: FloatArray) -> float:
        return -float(np.linalg.eigvalsh(np.sum(grasp_grams(self.points(x)), axis=0))[0])

    def with_gradient(self, x: FloatArray) -> tuple[float, FloatArray]:
        value, gradient = least_eigenvalue(self.points(x))
        along = np.einsum("nij,nj->ni", self.faces.axes[self.on], gradient)
        return -value, -(along * self.faces.halves).ravel()


def evolved_choice(faces: Faces, contacts: int, generator: np.random.Generator) -> FloatArray:
    """Returns the best contacts of differential evolution, as `slsqp_choice` does.

    Each contact has two coordinates: how far round the faces it is, whose whole part is the face,
    and how high. A whole population is judged at once.

    Args:
        faces: Where contacts may be.
        contacts: How many to choose.
        generator: Of the population.
    """

    def points(x: FloatArray) -> FloatArray:
        around, height = x.T.reshape(-1, contacts, 2).transpose(2, 0, 1)
        on = np.minimum(around.astype(int), len(faces.centers) - 1)
        uv = np.stack([2 * (around - on) - 1, height], axis=-1) * faces.halves
        return faces.points(on, uv)

    def loss(x: FloatArray) -> FloatArray:
        sets = points(x)
        grams = np.sum(grasp_grams(sets.reshape(-1, 3)).reshape(*sets.shape[:2], 6, 6), axis=1)
        values: FloatArray = -np.linalg.eigvalsh(grams)[:, 0]
        return values

    result = differential_evolution(
        loss,
        [(0, len(faces.centers)), (-1, 1)] * contacts,
        seed=generator,
        vectorized=True,
        updating="deferred",
        polish=False,
        tol=_SPREAD_OF_SCORES,
    )
    chosen: FloatArray = points(result.x[:, None])[0]
    return chosen
