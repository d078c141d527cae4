"""Sets of objects of the study, and the objects of a set that fit a hand."""

import itertools
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from pydrake.common.yaml import yaml_load_typed

from drake_pregrasp.config.grasp_config import GraspConfig
from drake_pregrasp.config.limits_config import LimitsConfig
from drake_pregrasp.config.object_config import Mesh, ObjectConfig
from drake_pregrasp.diagrams.hand_model import HandModel
from drake_pregrasp.errors import InvalidArgumentError
from drake_pregrasp.geometry.random_objects import MASS, NUM_OBJECTS, check_installed, object_url
from drake_pregrasp.geometry.shapes import Shape
from drake_pregrasp.resources import MODELS_URL, resource_folder
from drake_pregrasp.simulation.hand_file import load_hand, made_hand

FIT_IN_WORDS = (
    "An object fits a hand if some horizontal width of it is between the least and the largest"
    " opening of the hand, and its top is high enough above the table for a fingertip. The least"
    " opening is the diameter of a fingertip. The largest one is the largest distance between two"
    " places on opposite sides that fingers can touch, with room for their standoffs."
)

_LEVEL = 0.02  # Largest height of a fingertip over or under the centre of mass, in metres.
_OPPOSITE = float(np.cos(np.radians(30)))  # Largest angle from opposite sides.
_HALF_TURN = np.radians(np.arange(0, 180, 5))  # Azimuths of an object's widths.

Objects = Mapping[str, ObjectConfig]
"""Objects of a set by their names."""


def _random() -> Objects:
    return {f"{k:03d}": Mesh(object_url(k), mass=MASS) for k in range(NUM_OBJECTS)}


SETS_FILE = Path(__file__).with_name("object_sets.yaml")
"""File with the sets of shipped objects."""


@dataclass
class _ShippedSets:
    household: dict[str, ObjectConfig] = field(default_factory=dict)
    primitives: dict[str, ObjectConfig] = field(default_factory=dict)


_SHIPPED: _ShippedSets = yaml_load_typed(schema=_ShippedSets, filename=str(SETS_FILE))

SETS: dict[str, Callable[[], Objects]] = {
    "random": _random,
    "household": lambda: _SHIPPED.household,
    "primitives": lambda: _SHIPPED.primitives,
}
"""Functions that return the objects of the sets."""


def hand_file(hand: str) -> str:
    """Returns the file of a hand: a path that ends with `.yaml`, or that of a shipped hand.

    Raises:
        InvalidArgumentError: If there is no such shipped hand.
    """
    if hand.endswith(".yaml"):
        return hand
    there = sorted(path.stem for path in resource_folder("models").glob("*.yaml"))
    if hand not in there:
        raise InvalidArgumentError(
            f"{hand}: no such hand; there are: {','.join(there)}, or the path of a .yaml file"
        )
    return f"{MODELS_URL}{hand}.yaml"


def hand_name(hand: str) -> str:
    """Returns the name of a hand in tables."""
    return Path(hand).stem


def opening(hand: HandModel) -> tuple[float, float]:
    """Returns the least and the largest opening of a hand, in metres; see `FIT_IN_WORDS`."""
    contacts = []
    for tip, places in zip(hand.description.fingertips, hand.workspaces, strict=True):
        p_HT = places.data[np.abs(places.data[:, 2]) < _LEVEL]
        outward = p_HT * [1.0, 1.0, 0.0]
        outward /= np.linalg.norm(outward, axis=1, keepdims=True)
        p_HC = p_HT - (tip.radius + GraspConfig.standoff) * outward
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


def drawn_objects(name: str, hand: str, count: int, seed: int, pool: range) -> list[str]:
    """Returns objects of a set that fit a hand, drawn without repetition, in the order of the draw.

    Objects that are not accepted as meshes do not fit.

    Args:
        name: Key of `SETS`.
        hand: Hand, as for `hand_file`.
        count: Number of drawn objects; all that fit if there are not more.
        seed: Seed of the draw.
        pool: Indices of the objects in the set to draw from.

    Raises:
        InvalidArgumentError: If the objects or the hand are not installed.
    """
    objects, limits = list(SETS[name]().items()), opening(made_hand(load_hand(hand_file(hand))))
    indices = np.array([k for k in pool if k < len(objects)], dtype=int)
    order = np.random.default_rng(seed).permutation(indices).tolist()
    fitting = (objects[k][0] for k in order if _is_accepted(objects[k][1], limits))
    return list(itertools.islice(fitting, count))


def _is_accepted(config: ObjectConfig, limits: tuple[float, float]) -> bool:
    try:
        return fits(config.make_shape(), limits)
    except InvalidArgumentError:
        check_installed()
        return False
