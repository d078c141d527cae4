"""An optional compiled implementation of what takes most of a tick, the extra `fast` (numba).

Each function has a reference, with which it agrees: labels but for ties, goals within 1e-9 of the
object's size, estimates to rounding. `default_kernels` chooses one of the two for a planner, which
passes it to its systems.

| here | reference |
|---|---|
| `labels` | `regions.safe_regions.label_candidates` |
| `predicates` | `regions.constraints.Predicates.limits_at` |
| `projection` | `geometry.surface.ObjectSurface.project` and `project_into` |
| `goals`, `closed_forms`, `spectra`, `margins` | `contacts.centroids.region_goals`, `best_points` |
| `margins` | `regions.independent_regions.slip_radii_within` |
| `cones` | `quality.force_closure.largest_minimum` |
| `pose_steps` | `estimation.pose_filter.filter_step` and `merged` |
| `alignment` | `estimation.surface_alignment.align_pose` |
| `hand` | `forward_kinematics`, `clearances` and `next_velocities` of `grasping` |
| `meetings` | `grasping.interception.choose_meeting` |
| `tip_steps` | `straight_step`, `hand_goals` and `goal_velocities` of `grasping` |

**One description.** A region is an intersection: the weighted Voronoi cell of its contact,
half-spaces (forbidden points, neighbouring fingertips, the nearest points of obstacles), and
predicates of single candidates (closed faces, reach, fingertips clear of obstacles). Once a tick
`compute_safe_regions` writes all of it into plain arrays, `RegionBounds`. Both implementations read
these arrays, so that a constraint is described in one place. All solids are boxes with
rounded edges, with infinite bounds for half-spaces, and share one formula for their distance.

**Blocks.** Candidates never move in the object's frame. At construction they are sorted into
compact blocks, of up to 64 candidates on small surfaces and up to 632 on one with 100,000, each
with a bounding box of its positions and of its normals. In a tick a block finds the contacts that
may own its candidates, then discards what cannot divide it: a half-space that
contains the box; an obstacle farther away than the box is large. This works because power distances
differ by a linear function, and a distance changes no faster than its point: the value at the box's
middle, plus or minus the size of the box, decides the whole block. Only what is left is tested for
all candidates of the block at once, such as half-spaces that cut it at the boundary of a region.

**Reasons.** If regions come out tiny, their cells are counted by the same function, called once
more: for each limit, how many candidates of the cell it excludes.

**Projection.** The same blocks bound the distance to the patches, and balls around triangles bound
the distance to each triangle.

**Weights.** Measures of the complete grasp matrix have closed forms or converge in a few Newton
steps (see `closed_forms`), those of other contact models come from Jacobi rotations (see
`spectra`), and the margin solves one 7 x 7 system for each place (see `margins`). Candidates of a
region are copied next to each other, and loops run over many of them without branches, so that the
compiler makes vector instructions of them. Blends add up the weights of their strategies.

**Compilation.** Functions with signatures are compiled when they are imported, that is when a
planner is made, never in a tick; only the strategies that a planner has are imported. Functions
without signatures become part of those that call them. All use single elements of arrays, since
array expressions take longer to compile. A literal argument makes numba compile a function once
more.
"""

import importlib.util
import os

from drake_pregrasp.fast.kernels import REFERENCE, Kernels

SWITCH = "DRAKE_PREGRASP_FAST"
"""Environment variable; the value 0 chooses the reference even if numba is installed."""


def numba_is_installed() -> bool:
    """Returns whether numba, the extra `fast`, can be imported, without importing it."""
    return importlib.util.find_spec("numba") is not None


def installed_kernels() -> list[Kernels]:
    """Returns the reference, then the compiled functions if numba is installed."""
    if not numba_is_installed():
        return [REFERENCE]
    # Imported only here, because numba takes a third of a second.
    from drake_pregrasp.fast.compiled_kernels import COMPILED

    return [REFERENCE, COMPILED]


def default_kernels() -> Kernels:
    """Returns the compiled functions if numba is installed and `SWITCH` is not 0."""
    return REFERENCE if os.environ.get(SWITCH) == "0" else installed_kernels()[-1]
