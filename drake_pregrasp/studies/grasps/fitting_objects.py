"""Objects that fit a hand, by its opening and their widths."""

import itertools

import numpy as np

from drake_pregrasp.config.limits_config import LimitsConfig
from drake_pregrasp.diagrams.hand_model import HandModel
from drake_pregrasp.geometry.shapes import Shape

FIT_IN_WORDS = (
    "An object fits a hand if some horizontal width of it is between the least and the largest"
    " opening of the hand, and its top is high enough above the table for a fingertip. The least"
    " opening is the diameter of a fingertip. The largest one is the largest distance between two"
    " places on opposite sides that fingers can touch, with room for their standoffs."
)

_LEVEL = 0.02  # Largest height of a fingertip over or under the centre of mass, in metres.
_OPPOSITE = float(np.cos(np.radians(30)))  # Largest angle from opposite sides.
_HALF_TURN = np.radians(np.arange(0, 180, 5))  # Azimuths of an object's widths.


def opening(hand: HandModel, standoff: float) -> tuple[float, float]:
    """Returns the least and the largest opening of a hand, in metres; see `FIT_IN_WORDS`.

    Args:
        hand: Model of the hand.
        standoff: Gap from which a fingertip closes, in metres.
    """
    contacts = []
    for tip, places in zip(hand.description.fingertips, hand.fingers.workspaces, strict=True):
        p_HT = places.data[np.abs(places.data[:, 2]) < _LEVEL]
        outward = p_HT * [1.0, 1.0, 0.0]
        outward /= np.linalg.norm(outward, axis=1, keepdims=True)
        p_HC = p_HT - (tip.radius + standoff) * outward
        can_touch = tip.reach.make_reach().permits(p_HC, outward, p_HT)
        can_touch &= np.sum(p_HC * outward, axis=1) > 0
        contacts.append(p_HC[can_touch, :2])
    widest = 0.0
    for a, b in itertools.combinations(contacts, 2):
        far = np.linalg.norm(a, axis=1)[:, None], np.linalg.norm(b, axis=1)
        is_opposite = a @ b.T < -_OPPOSITE * far[0] * far[1]
        widest = max(widest, float(np.max(np.where(is_opposite, far[0] + far[1], 0), initial=0)))
    return 2 * float(np.max(hand.tip_radii)), widest


def fits(shape: Shape, limits: tuple[float, float]) -> bool:
    """Returns whether an object fits a hand, by `FIT_IN_WORDS`.

    Args:
        shape: The object.
        limits: Least and largest opening of the hand, in metres.
    """
    least, largest = limits
    along = np.stack([np.cos(_HALF_TURN), np.sin(_HALF_TURN), 0 * _HALF_TURN])
    widths = np.ptp(shape.mesh.vertices @ along, axis=0)
    is_high = shape.mesh.extents[2] > least / 2 + LimitsConfig.clearance
    return bool(is_high and np.any((least <= widths) & (widths <= largest)))
