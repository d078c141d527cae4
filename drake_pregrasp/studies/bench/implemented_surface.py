"""A surface whose kernel is of the implementation that one asks for."""

from dataclasses import dataclass, fields

from drake_pregrasp.geometry.surface import ObjectSurface
from drake_pregrasp.kernels import TickKernel, make_kernel


@dataclass(frozen=True, eq=False)
class ImplementedSurface(ObjectSurface):
    """A surface with a kernel that was chosen, in place of the fastest there is.

    Attributes:
        own_kernel: The kernel, of the same candidates.
    """

    own_kernel: TickKernel

    @property
    def kernel(self) -> TickKernel:
        """As of `ObjectSurface`."""
        return self.own_kernel


def implemented(surface: ObjectSurface, implementation: str) -> ImplementedSurface:
    """Returns the same surface with a kernel of its own, which is made here.

    Args:
        surface: The surface.
        implementation: Name of the kernel.

    Raises:
        InvalidArgumentError: If there is no such implementation, or it isn't installed.
    """
    given = {own.name: getattr(surface, own.name) for own in fields(ObjectSurface) if own.init}
    kernel = make_kernel(
        surface.p_OQ, surface.nhat_OQ, surface.areas, surface.p_OCoM, implementation=implementation
    )
    return ImplementedSurface(**given, own_kernel=kernel)
