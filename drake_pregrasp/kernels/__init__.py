"""Kernels: the regions of Eq. 1 and the centroids of Eq. 4 of one tick, as fast as may be.

All candidates of a surface never move in O, so what depends on them alone is made once: they are
sorted face by face, cut across the longest side again and again (`sorting`) into compact blocks of
64 (`blocks`), with boxes around blocks and around groups of them. Places are relative to the centre
of mass.

**Regions are intersections of half-spaces.** Subtracting |q|² from both sides, Eq. 1 is linear in q
(`region_planes`):

    |c_i - q|² - h_i <= |c_k - q|² - h_k   is   (c_k - c_i)·q <= (|c_k|² - h_k - |c_i|² + h_i)/2,
    |c_i - q|² <= |z_j - q|² - w_ij        is   (z_j - c_i)·(q - c_i) <= d (d - R_j),

with d = |z_j - c_i| and w_ij of Eq. 2. Over a box with midpoint m and half edges e, n·q lies
between n·m - |n|·e and n·m + |n|·e, with |n| element by element. If the first is above b, the whole
box is outside; if the second is not, the plane doesn't matter inside the box. A box that no plane
cuts is inside as a whole; one that some do cut is opened, and only those planes are asked again. A
plane decides a box only if it clears it by more than rounding could move it; points are asked
themselves. So labels equal those of Eq. 1 but where two sides of it agree to rounding.

**Weights need no decomposition.** With t_o = sum r and B_o = sum (|r|² I - r rᵀ) over the other
active contacts, and the moved one at q, the extreme singular values follow from t = t_o + q and
B = B_o + |q|² I - q qᵀ by the closed form of `extreme_singular_values`. For Eq. 7, let S be the
scatter of the n - 1 others about their mean m, K = (n + tr S) I - S, d = q - m, alpha = (n - 1)/n
and a = alpha |d|². Moving the last contact adds alpha d dᵀ to the scatter, so that

    det(G Gᵀ)/n³ = det(K + a I - alpha d dᵀ) = det(K + a I) - alpha dᵀ adj(K + a I) d
                 = e_3 + e_2 a + alpha (a dᵀ K d - dᵀ adj(K) d),

with e_3 = det K and e_2 = tr adj(K), because det(K + a I) = e_3 + e_2 a + tr(K) a² + a³ and
adj(K + a I) = adj(K) + a (tr(K) I - K) + a² I: the terms in tr(K) a² and a³ cancel.

The root x of x² + x mu(x) = tau, see there, is found by steps that solve a quadratic, or, once near
it, by plain Newton steps, x <- ((1 + mu') x² + tau)/((2 + mu') x + mu), which need no square root.
They go on until no point moves by more than 1e-7 of itself: the rest is the square of that.

**One pass is enough for stretched centroids.** Eq. 4 with weights b - min b over areas A needs min
b, which is known at the end only. With any reference b_0 of the region's own,

    sum A (b - min b) q = sum A (b - b_0) q + (b_0 - min b) sum A q,

and the same without q. The reference is what keeps the differences from rounding. A Gaussian's
largest exponent is not known either: sums are kept relative to the largest so far, and scaled down
when it grows.

**Inside a region few points stand in for many** (`stand_ins`). Let a part of a flat face be one
contact's. On the 8 x 8 places of Chebyshev's extremes in its rectangle, with Lagrange's polynomials
L_k, weights and moments are nearly those of the polynomial through their values there:

    sum A b ~ sum_k a_k b(x_k),   sum A b q ~ sum_k a_k b(x_k) x_k,   a_k = sum_q A_q L_k(q).

The areas a_k are made once. So 64 points, of whatever area, do what a block does. They are used
where their error is small. For the Gaussian it is bounded by its 8th derivative, which is a Hermite
polynomial times it. For the others it is estimated by the last two of their Chebyshev coefficients
along each line, since those of an analytic function fall geometrically, and those of a kink, as at
double singular values, like k^-2, so that the last ones show it; beside kinks it was up to four
times as much. The part is taken if that is at most 2e-10 of the mean weight, else its quarters are
tried, and at last its blocks. If all together exceed 2.4e-10 of the sum of weights, so that four
times that might be 1e-9, all candidates are weighed. The least weight is one of a candidate: with r
the rest beside the bilinear function through the corners, and Lebesgue's constant Lambda,

    b >= min of the corners - Lambda² max_k |r_k| - error

holds in the part, and it is opened if that is below the least so far.

**Projections leave out what is too far** (`ground`, `compiled.projection`). Each candidate has a
patch of triangles that reaches no farther from it than rho, and is on it. So the nearest candidate
of a region bounds the distance to its ground by d: boxes and candidates farther away than d + rho
are left out, and triangles of which a corner is farther away than d and their longest edge.

**What is kept between ticks** is the last partition, returned again if nothing has changed. Which
boxes were decided is not: with all those decisions known for nothing the search takes only a tenth
less (contacts that have not moved, 2,304 to 1,000,000 candidates), since most of it is at borders.
Nor are faces clipped to polygons by the planes before their boxes are asked: that took 20 us more
a tick than it saved (5 contacts, 200 forbidden points, 4 faces), since a few boxes tell most planes
apart.

`NumpyKernel` goes through the tree of boxes level by level, weighs all candidates, and needs
nothing else. `NumbaKernel` goes depth first, in code that is compiled once and kept on disk.
"""

from drake_pregrasp.kernels.choice import make_kernel, numba_is_installed, warm_up
from drake_pregrasp.kernels.ground import Ground
from drake_pregrasp.kernels.partition import Partition
from drake_pregrasp.kernels.tick_kernel import TickKernel
from drake_pregrasp.kernels.triangles import closest_points
from drake_pregrasp.kernels.weighting import FLAT, KINDS, Weighting

__all__ = [
    "FLAT",
    "KINDS",
    "Ground",
    "Partition",
    "TickKernel",
    "Weighting",
    "closest_points",
    "make_kernel",
    "numba_is_installed",
    "warm_up",
]
