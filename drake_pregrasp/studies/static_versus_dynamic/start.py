"""What is random in a trial, the same for all arms: where it starts, and which fingers are lost."""

from dataclasses import dataclass

import numpy as np

from drake_pregrasp.arrays import FloatArray
from drake_pregrasp.contacts.assignment import assign_fingers_round
from drake_pregrasp.diagrams.hand_model import HandModel
from drake_pregrasp.errors import InvalidArgumentError
from drake_pregrasp.geometry.surface import ObjectSurface
from drake_pregrasp.studies.static_versus_dynamic.scene import FINGERS, Scene

_LEAST_DISTANCE = 0.024  # Between contacts, in metres.
_HEIGHTS = (-0.030, 0.035)  # Of contacts over the object's centre, in metres.
_MISPLACED = 0.005  # Standard deviation of the object's place, along x and y, in metres.
_MISTURNED = float(np.radians(4))  # Of its angle about z, in radians.

START_SETTINGS = {
    "least_distance": _LEAST_DISTANCE,
    "heights": list(_HEIGHTS),
    "misplaced": _MISPLACED,
    "misturned": _MISTURNED,
}
"""What random starts depend on."""


@dataclass(frozen=True, eq=False)
class Start:
    """Where a trial starts.

    Attributes:
        p_OC: Random contacts in the order of the fingers, in O, shape (n, 3), in metres.
        yaw: The palm's angle for them, in radians.
        misplacement: Of the object on the table, x and y in metres and the angle about z in rad.
        lost: Which fingers will be lost.
        noise_seed: Of the measurements.
    """

    p_OC: FloatArray
    yaw: float
    misplacement: FloatArray
    lost: list[int]
    noise_seed: int


def random_start(scene: Scene, surface: ObjectSurface, hand: HandModel, seed: int) -> Start:
    """Returns where the trial with a seed starts.

    Contacts are drawn on the surface, apart and neither high nor low, until the fingers can be
    assigned to them.

    Args:
        scene: What happens.
        surface: The object's.
        hand: The hand.
        seed: Of all that is random.
    """
    rng = np.random.default_rng([seed, FINGERS])
    misplacement = rng.normal(size=3) * [_MISPLACED, _MISPLACED, _MISTURNED]
    lost = rng.permutation(FINGERS)[: scene.lost_fingers].tolist()
    noise_seed = int(rng.integers(2**31))
    while True:
        p_OC = _apart(surface, rng)
        try:
            order, yaw = assign_fingers_round(
                hand.azimuths,
                np.arctan2(p_OC[:, 1], p_OC[:, 0]),
                largest_offset=hand.largest_offsets,
                yaw_range=scene.yaw_range,
            )
        except InvalidArgumentError:
            continue
        return Start(p_OC[order], yaw, misplacement, lost, noise_seed)


def _apart(surface: ObjectSurface, rng: np.random.Generator) -> FloatArray:
    low, high = _HEIGHTS
    choices = surface.p_OQ[(surface.p_OQ[:, 2] >= low) & (surface.p_OQ[:, 2] <= high)]
    while True:
        p_OC: FloatArray = choices[rng.permutation(len(choices))[:FINGERS]]
        distances = np.linalg.norm(p_OC[:, None] - p_OC, axis=2) + np.eye(FINGERS)
        if np.min(distances) >= _LEAST_DISTANCE:
            return p_OC
