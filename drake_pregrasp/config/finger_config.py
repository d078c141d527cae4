"""Configuration of what happens to fingers in a run: losses, returns, and their capability."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from drake_pregrasp.arrays import FloatArray


@dataclass
class DamageEvent:
    """Loss of contacts during a run, for good or for a time."""

    # Time of the loss, in seconds.
    at: float = field(default=0.0, metadata={"required": True, "at_least": 0})

    # Indices of the lost contacts in initial_contacts.
    contacts: list[int] = field(
        default_factory=list, metadata={"required": True, "min_length": 1, "at_least": 0}
    )

    # Time at which the contacts come back, in seconds; 0 for never.
    until: float = field(default=0.0, metadata={"at_least": 0})

    def holds_at(self, time: float) -> bool:
        """Returns whether the contacts are lost at a time in seconds."""
        return self.at <= time and not 0 < self.until <= time


@dataclass
class CapabilityProfile:
    """Capability of a contact's finger over time, linear between given times."""

    # Index of the contact in initial_contacts.
    contact: int = field(default=0, metadata={"required": True, "at_least": 0})

    # Times that increase, in seconds.
    times: list[float] = field(
        default_factory=list, metadata={"required": True, "min_length": 1, "at_least": 0}
    )

    # Capability at each of these times, from 1 for a sound finger to 0 for a lost one: its
    # strength, the energy that is left, or what heat or wear leave of them.
    values: list[float] = field(
        default_factory=list,
        metadata={"required": True, "min_length": 1, "at_least": 0, "at_most": 1},
    )


def remaining_contacts(damage: Sequence[DamageEvent], n: int, time: float = math.inf) -> list[int]:
    """Returns the contacts of n that are not lost at a time in seconds; by default, at the end."""
    lost = {c for event in damage if event.holds_at(time) for c in event.contacts}
    return [i for i in range(n) if i not in lost]


def capability_at(profiles: Sequence[CapabilityProfile], n: int, time: float) -> FloatArray:
    """Returns the capability of each of n fingers at a time in seconds, shape (n,)."""
    capability = np.ones(n)
    for profile in profiles:
        capability[profile.contact] = np.interp(time, profile.times, profile.values)
    return capability
