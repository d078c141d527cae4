"""The check that contact goals lie on the object, against the mesh itself."""

import numpy as np

from drake_pregrasp.errors import ContactError
from drake_pregrasp.planning.selection_input import ContactGoals
from drake_pregrasp.planning.surface import CONTACT_TOLERANCE, ObjectSurface


def verify_contacts(surface: ObjectSurface, goals: ContactGoals) -> None:
    """Checks active goals against the whole mesh and against the allowed surface.

    Args:
        surface: The object's surface.
        goals: Contact goals in O.

    Raises:
        ContactError: If one is farther off than `CONTACT_TOLERANCE`; the message says how far.
    """
    contacts = np.flatnonzero(goals.active)
    if len(contacts) == 0:
        return
    p_OC = goals.p_OC[contacts]
    nearest, _ = surface.project(p_OC)
    off_ground = np.linalg.norm(nearest - p_OC, axis=1)
    for contact, height, way in zip(contacts, surface.distance(p_OC), off_ground, strict=True):
        if not abs(height) <= CONTACT_TOLERANCE:
            side = "inside" if height < 0 else "off"
            raise ContactError(f"contact {contact} is {1e3 * abs(height):.3g} mm {side} the object")
        if not way <= CONTACT_TOLERANCE:
            raise ContactError(f"contact {contact} is {1e3 * way:.3g} mm off the allowed surface")
