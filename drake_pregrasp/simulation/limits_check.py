"""What no single key of the limits shows."""

import numpy as np

from drake_pregrasp.diagrams.limits_config import LimitsConfig
from drake_pregrasp.errors import InvalidArgumentError, ScenarioError
from drake_pregrasp.planning.arrays import FloatArray
from drake_pregrasp.planning.surface import ObjectSurface


def check_limits(
    source: str, limits: LimitsConfig, num_contacts: int, surface: ObjectSurface
) -> None:
    """Raises a `ScenarioError` if limits contradict each other, or the object.

    Args:
        source: Where the scenario is from, for the message.
        limits: Loaded, with keys and types checked.
        num_contacts: n.
        surface: The object's.
    """
    key = "planner.limits"
    for name in ("tip_radii", "reach", "forbidden_faces"):
        count = len(getattr(limits, name))
        if count not in (0, num_contacts):
            raise ScenarioError(
                source,
                f"{key}.{name}",
                f"{count} elements must be none or one for each of the {num_contacts} contacts",
            )
    for index, reach in enumerate(limits.reach):
        try:
            reach.make_reach()
        except InvalidArgumentError as error:
            raise ScenarioError(source, f"{key}.reach[{index}]", str(error)) from error
    if max(limits.tip_gap, limits.standoff) > 0 and not limits.tip_radii:
        name = "tip_gap" if limits.tip_gap > 0 else "standoff"
        problem = f"{getattr(limits, name)} needs tip_radii, whose tips it keeps clear"
        raise ScenarioError(source, f"{key}.{name}", problem)
    longest = float(np.linalg.norm(surface.mesh.extents))
    for index, pair in enumerate(limits.pairs):
        pair_key = f"{key}.pairs[{index}]"
        for contact in (pair.first, pair.second):
            if contact >= num_contacts:
                problem = f"there is no contact {contact}; there are 0 to {num_contacts - 1}"
                raise ScenarioError(source, pair_key, problem)
        if pair.first == pair.second:
            raise ScenarioError(source, pair_key, f"contact {pair.first} can't follow itself")
        if pair.distance > longest:
            raise ScenarioError(
                source,
                f"{pair_key}.distance",
                f"{pair.distance} is more than the object's own {longest:.3g} m",
            )
        if limits.tip_radii:
            room = limits.tip_radii[pair.first] + limits.tip_radii[pair.second]
            if pair.distance < room:
                raise ScenarioError(
                    source,
                    f"{pair_key}.distance",
                    f"{pair.distance} contradicts tip_radii, which keep the two {room:.3g} m apart",
                )
    try:
        limits.make_limits(period=1.0, friction=1.0)
    except InvalidArgumentError as error:
        raise ScenarioError(source, f"{key}.pairs", str(error)) from error
    if limits.deadband > longest:
        raise ScenarioError(
            source,
            f"{key}.deadband",
            f"{limits.deadband} is more than the object's own {longest:.3g} m: no goal would move",
        )
    _check_room(source, limits, surface)


def check_reach(
    source: str, limits: LimitsConfig, p_HO: FloatArray, surface: ObjectSurface
) -> None:
    """Raises a `ScenarioError` if a finger of a hand that follows can never reach the object.

    Args:
        source: Where the scenario is from, for the message.
        limits: With the reach of each finger.
        p_HO: The object's origin in the hand's frame, shape (3,), in metres.
        surface: The object's.
    """
    farthest = float(np.max(np.linalg.norm(surface.p_OQ, axis=1)))
    for index, reach in enumerate(limits.reach):
        # The hand doesn't turn, but the object may: only the distance of its origin is sure.
        solid = reach.make_reach().solid
        gap = -np.inf if solid is None else float(solid.distance(p_HO[None])[0]) - farthest
        if gap > 0:
            raise ScenarioError(
                source,
                f"planner.limits.reach[{index}]",
                f"the object is never nearer to it than {gap:.3g} m: move or enlarge it",
            )


def _check_room(source: str, limits: LimitsConfig, surface: ObjectSurface) -> None:
    """Fingertips need room, if not on the ground itself, then over its convex hull."""
    if not limits.tip_radii:
        return
    largest = max(limits.tip_radii)
    extent = float(np.max(surface.mesh.extents))
    if largest > extent:
        raise ScenarioError(
            source,
            "planner.limits.tip_radii",
            f"{largest} is more than the object's own {extent:.3g} m; radii are in metres",
        )
