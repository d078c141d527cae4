"""What the selection of contact goals starts from, and what it comes to."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

from drake_pregrasp.planning.arrays import BoolArray, FloatArray
from drake_pregrasp.planning.contact_status import is_active
from drake_pregrasp.planning.remembered_projection import RememberedProjection
from drake_pregrasp.planning.safe_regions import SafeRegions
from drake_pregrasp.planning.surface import ObjectSurface


@dataclass(frozen=True, eq=False)
class SelectionInput:
    """What a strategy may look at when it weighs candidate points.

    Attributes:
        surface: The object's surface, in the frame of its estimated pose. Its centre of mass is
            there by definition the mean mu of Eq. 3.
        p_OC: Contact points as they are, shape (n, 3), in metres.
        regions: Their safe regions.
        covariance_O: Sigma of Eq. 3, expressed in O, shape (3, 3), in m².
    """

    surface: ObjectSurface
    p_OC: FloatArray
    regions: SafeRegions
    covariance_O: FloatArray

    @cached_property
    def project(self) -> RememberedProjection:
        """Projects points onto the surface, each once a tick."""
        return RememberedProjection(self.surface)

    @cached_property
    def known_limits(self) -> dict[tuple[int, bytes], tuple[int, int]]:
        """What keeps a contact from a point, and its cause, where that has been asked for."""
        return {}


WeightFunction = Callable[[SelectionInput], FloatArray]
"""Maps a selection's input to log(b_n) for each candidate, shape (N,), up to a constant."""


@dataclass(frozen=True)
class KernelStrategy:
    """A weight function that kernels know as well.

    Attributes:
        log_weights: The weight function.
        kind: What kernels call it, one of their `KINDS`.
        stretch: Whether it stretches its weights over each region.
    """

    log_weights: WeightFunction
    kind: str
    stretch: bool

    def __call__(self, selection: SelectionInput) -> FloatArray:
        """Returns log(b_n) for each candidate, shape (N,), up to a constant."""
        return self.log_weights(selection)


@dataclass(frozen=True, eq=False)
class ContactGoals:
    """Contact goals of one tick, in the object frame.

    Attributes:
        p_OC: Contact points, shape (n, 3), in metres.
        status: A `ContactStatus` for each, shape (n,).
        causes: Index of the contact or obstacle behind it, or `NO_CAUSE`, shape (n,).
    """

    p_OC: FloatArray
    status: FloatArray
    causes: FloatArray

    @property
    def active(self) -> BoolArray:
        """Mask of the active contacts, shape (n,)."""
        return is_active(self.status)
