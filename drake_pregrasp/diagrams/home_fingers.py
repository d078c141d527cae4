"""Fingers of a hand whose palm is at home: what they reach, and where their links are."""

import math
from collections.abc import Callable, Iterator, Sequence
from functools import cached_property

import numpy as np
from pydrake.geometry import SceneGraphInspector
from scipy.spatial import cKDTree

from drake_pregrasp.arrays import FloatArray
from drake_pregrasp.contacts.contact_pairs import Pair
from drake_pregrasp.diagrams.palm_base import CarrierOrArm
from drake_pregrasp.errors import InvalidArgumentError
from drake_pregrasp.grasping.grasp_state import BASE
from drake_pregrasp.regions.finger_measures import (
    ARRIVED,
    FingerChain,
    FingerLinks,
    FingerMeasures,
)
from drake_pregrasp.systems.hand_kinematics import HandKinematics, finite_limits
from drake_pregrasp.systems.hand_scene import (
    BallFunction,
    LinkBalls,
    inner_balls,
    link_balls,
    palm_and_finger_balls,
)

_LARGEST_STEP = 0.012  # Largest distance to another place that a finger reaches, in metres.


class HomeFingers:
    """Fingers of a hand on its palm, which is at home at yaw 0. All places are in the frame A.

    Args:
        kinematics: Kinematics of the hand.
        inspector: Inspector of the SceneGraph with the hand alone.
        base: Carrier or arm of the palm.
        home: Positions of all joints at home, shape (nq,).
        tip_radii: Radii of the fingertips, shape (n,), in metres.
        radius: Radius around the object's centre of mass of the places to measure, in metres.

    Attributes:
        p_HT: Fingertips at home, shape (n, 3), in metres.
        chains: Kinematics of each finger.
    """

    def __init__(
        self,
        kinematics: HandKinematics,
        inspector: SceneGraphInspector,
        base: CarrierOrArm,
        home: FloatArray,
        tip_radii: FloatArray,
        radius: float,
    ) -> None:
        self._kinematics, self._inspector = kinematics, inspector
        self._X_AW, self._home = base.X_AW, home
        self._tip_radii, self._radius = tip_radii, radius
        pose = kinematics.pose(home)
        self.p_HT: FloatArray = (self._X_AW @ pose.p_WT.T).T
        R_AW, p_AW = self._X_AW.rotation().matrix(), self._X_AW.translation()
        w, v = np.split(R_AW @ pose.screws.reshape(2, 3, -1), 2)
        screws = np.concatenate([w[0], v[0] + np.cross(p_AW, w[0], axisb=0, axisc=0)]).T
        lower, upper = finite_limits(kinematics.lower, kinematics.upper, home)
        limits = home, lower, upper, kinematics.efforts
        own = [kinematics.own_joints(finger) for finger in range(len(self.p_HT))]
        is_endless = ~np.isfinite(kinematics.upper - kinematics.lower)
        for joint in np.concatenate(own).tolist():
            if is_endless[joint] and not screws[joint, :3].any():
                name = kinematics.plant.GetPositionNames()[joint]
                raise InvalidArgumentError(f"joint {name} slides without limits; give it a <limit>")
        self.chains = [
            FingerChain(screws[j], tip, *(limit[j] for limit in limits))
            for j, tip in zip(own, self.p_HT, strict=True)
        ]

    @cached_property
    def workspaces(self) -> list[cKDTree]:
        """Places of each fingertip, at evenly drawn positions of the finger's own joints."""
        return [chain.workspace for chain in self.chains]

    def workspace_gaps(self, p_HT: FloatArray, largest: float = np.inf) -> FloatArray:
        """Returns how far places of each fingertip are from those that its joints reach.

        It is 0 where they reach, and inf beyond the largest gap. Fingers with fewer than three
        joints reach the places on a line or a surface. The carrier brings it to places beside, so
        only the way along the joints' directions at home counts.

        Args:
            p_HT: Centres of each fingertip, shape (n, k, 3), in metres.
            largest: Largest gap that is sought, in metres; the search is shorter for small ones.

        Returns:
            The gaps, shape (n, k), in metres.
        """
        gaps = []
        for tree, step, chain, p in zip(
            self.workspaces, self._steps, self.chains, p_HT, strict=True
        ):
            bound = math.nextafter(step + largest, math.inf)  # Which is itself left out.
            distances, _ = tree.query(chain.along(p), distance_upper_bound=bound)
            gaps.append(np.maximum(0.0, distances - step))
        return np.array(gaps)

    def link_gaps(
        self, finger: int, p_HT: FloatArray, distance: Callable[[FloatArray], FloatArray]
    ) -> FloatArray:
        """Returns the least gaps of a finger's links to an object, without its fingertip.

        They are those of `FingerLinks.gaps`, shape (k,), in metres.

        Args:
            finger: Index of the finger.
            p_HT: Places of its tip, shape (k, 3), in metres.
            distance: As for `FingerLinks.gaps`.
        """
        return self._links[finger].gaps(self.chains[finger].along(p_HT), distance)

    def compliance(self, finger: int, p_HT: FloatArray) -> FloatArray:
        """Returns the compliance of a fingertip as its joints' drives yield, shape (3, 3), in m/N.

        The finger is in the posture closest to home; the base and shared joints are rigid. The
        compliance is NaN where its own joints do not get there.

        Args:
            finger: Index of the finger.
            p_HT: Centre of its tip, shape (3,), in metres.
        """
        chain = self.chains[finger]
        place = chain.along(p_HT[None])
        tips, jacobians = chain.tips(chain.postures(place))
        if np.linalg.norm(tips - place) > ARRIVED:
            return np.full((3, 3), np.nan)
        stiffness = self._kinematics.stiffness[self._kinematics.own_joints(finger)]
        compliance: FloatArray = (jacobians[0] / stiffness) @ jacobians[0].T
        return compliance

    def opening(self, jaws: Sequence[Pair]) -> float:
        """Returns the largest distance of contacts between jaws, in metres; inf without jaws."""
        widths = [np.inf]
        for pair in jaws:
            both = [pair.first, pair.second]
            line = np.subtract(*self.p_HT[both])
            line /= np.linalg.norm(line)
            first, second = (self.workspaces[i].data @ line for i in both)
            widths.append(np.max(first) - np.min(second) - np.sum(self._tip_radii[both]))
        return float(min(widths))

    @cached_property
    def measures(self) -> FingerMeasures:
        """Measures of the fingers around an object, in the palm's frame U.

        U is the frame A turned with the palm. Only the finger's own joints count.
        """
        return FingerMeasures.around(self._radius, self.chains)

    def depth(self, yaw: float) -> float:
        """Returns how far palm and fingers reach below the axis of a palm from the side, in metres.

        Args:
            yaw: Yaw of the palm, in radians. At yaw 0, x of A points down.
        """
        p_HB, radii = self._outer_balls
        down = p_HB[:, 0] * np.cos(yaw) - p_HB[:, 1] * np.sin(yaw)
        return float(np.max(down + radii))

    def lowest_of_palm(self, radius: float) -> float:
        """Returns the least z of links without a finger, in metres; inf if none are near the axis.

        Args:
            radius: Distance from the palm's axis within which they count, in metres.
        """
        balls = [link.balls for link in self._balls(link_balls) if link.finger == BASE]
        x, y, z, radii = np.concatenate([np.empty((0, 4)), *balls]).T
        is_near = np.hypot(x, y) - radii < radius
        return float(np.min((z - radii)[is_near], initial=np.inf))

    @cached_property
    def _steps(self) -> list[float]:
        gaps = [tree.query(tree.data, k=2)[0][:, 1] for tree in self.workspaces]
        return [min(_LARGEST_STEP, 2 * float(np.quantile(gap, 0.9))) for gap in gaps]

    @cached_property
    def _links(self) -> list[FingerLinks]:
        balls: list[list[tuple[int, FloatArray]]] = [[] for _ in self.chains]
        for link in self._balls(inner_balls):
            if link.finger != BASE and not link.is_tip:
                balls[link.finger].append((link.joints, link.balls))
        return [FingerLinks(*part) for part in zip(self.chains, balls, strict=True)]

    @cached_property
    def _outer_balls(self) -> tuple[FloatArray, FloatArray]:
        """Balls inside the links that touch their surfaces: centres, and radii."""
        balls = np.concatenate([link.balls for link in self._balls(link_balls)])
        return balls[:, :3], balls[:, 3]

    def _balls(self, balls_of: BallFunction) -> Iterator[LinkBalls]:
        links = palm_and_finger_balls(
            self._kinematics, self._inspector, self._tip_radii, self._home, balls_of
        )
        for link in links:
            centers, radii = np.split(link.balls, [3], axis=1)
            yield link._replace(balls=np.column_stack([(self._X_AW @ centers.T).T, radii]))
