"""A cup with a wall of 3 mm, which several tests share."""

from drake_pregrasp.geometry.shapes import revolved_shape

RADIUS, HEIGHT, WALL = 0.035, 0.09, 0.003
PROFILE = [
    [0, 0],
    [RADIUS, 0],
    [RADIUS, HEIGHT],
    [RADIUS - WALL, HEIGHT],
    [RADIUS - WALL, WALL],
    [0, WALL],
]
CUP = revolved_shape(PROFILE)
