"""Labels over the object with the limits of the contacts."""

from collections.abc import Mapping

import numpy as np
from pydrake.geometry import Meshcat, Rgba
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.systems.framework import Context, EventStatus, LeafSystem

from drake_pregrasp.arrays import FloatArray
from drake_pregrasp.contacts.selection_input import ContactStatus, describe_status
from drake_pregrasp.estimation.pose_track import TrackingStatus
from drake_pregrasp.systems.drawing import NO_REGION_COLOR, contact_color, text_board
from drake_pregrasp.systems.ports import POSE

ROOT = "/drake/contact_status"
"""Meshcat path of the labels."""

_ROW = 1.15  # Distance between two rows, in heights of a label.


class StatusLabels(LeafSystem):
    """Shows the status of each limited contact on a board in the contact's colour.

    A grey board shows the tracking status while the object is not tracked.

    .. pydrake_system::

        name: StatusLabels
        input_ports:
        - X_WO_estimated
        - contact_status
        - contact_causes
        - tracking_status

    Port `X_WO_estimated` accepts a `RigidTransform`: the pose of the object, over which the boards
    are.

    Port `contact_status` accepts a vector of n `ContactStatus` values.

    Port `contact_causes` accepts a vector of n indices, as `CentroidSelector` emits them.

    Port `tracking_status` (optional) accepts a `TrackingStatus`.

    A board is created when it is first needed. In a recording it is hidden until then.

    Args:
        meshcat: Meshcat instance to draw in.
        num_contacts: Number of contacts n.
        publish_period: Seconds between frames, greater than zero.
        hover: Height of the lowest board over the object's origin, in metres.
        yaw: Yaw of the boards, in radians; at zero they are read from the side of -y.
        height: Height of a board, in metres.
        obstacle_names: Names of obstacles by their indices; other obstacles have none.
    """

    def __init__(
        self,
        *,
        meshcat: Meshcat,
        num_contacts: int,
        publish_period: float,
        hover: float,
        yaw: float = 0.0,
        height: float = 0.016,
        obstacle_names: Mapping[int, str] | None = None,
    ) -> None:
        super().__init__()
        self._meshcat = meshcat
        self._hover = hover
        self._R_WB = RotationMatrix.MakeZRotation(yaw)
        self._height = height
        self._obstacle_names = dict(obstacle_names or {})
        # Cache of what Meshcat shows; it is no part of the simulated state.
        self._made: set[str] = set()
        self._shown: list[str | None] = [None] * (num_contacts + 1)  # The object comes last.
        self._X_WO_estimated = self.DeclareAbstractInputPort("X_WO_estimated", POSE)
        self._status = self.DeclareVectorInputPort("contact_status", num_contacts)
        self._causes = self.DeclareVectorInputPort("contact_causes", num_contacts)
        self._tracking_status = self.DeclareVectorInputPort("tracking_status", 1)
        meshcat.Delete(ROOT)
        self.DeclareInitializationPublishEvent(self._forget)
        self.DeclarePeriodicPublishEvent(publish_period, 0.0, self._draw)
        self.DeclareForcedPublishEvent(self._draw)

    def _forget(self, context: Context) -> EventStatus:
        for path in self._made:
            self._meshcat.SetProperty(path, "visible", False, context.get_time())
        self._shown = [None] * len(self._shown)
        return EventStatus.Succeeded()

    def _draw(self, context: Context) -> EventStatus:
        time = context.get_time()
        X_WO: RigidTransform = self._X_WO_estimated.Eval(context)
        p_WB = X_WO.translation() + np.array([0.0, 0.0, self._hover])
        self._meshcat.SetTransform(ROOT, RigidTransform(self._R_WB, p_WB), time)
        status: FloatArray = self._status.Eval(context)
        causes: FloatArray = self._causes.Eval(context)
        rows = 0
        for contact, (kind, cause) in enumerate(zip(status, causes, strict=True)):
            path = None
            if kind != ContactStatus.ACTIVE:
                path = f"{ROOT}/{contact}/{int(kind)}_{int(cause)}"
                words = describe_status(kind, cause, self._obstacle_names)
                self._place(path, f"{contact}: {words}", contact_color(contact), rows, time)
                rows += 1
            self._show(contact, path, time)
        path = None
        tracking = TrackingStatus.TRACKING
        if self._tracking_status.HasValue(context):
            tracking = TrackingStatus(self._tracking_status.Eval(context)[0])
        if tracking != TrackingStatus.TRACKING:
            path = f"{ROOT}/object/{tracking.name.lower()}"
            words = f"object: {tracking.name.lower()}"
            self._place(path, words, NO_REGION_COLOR, rows, time)
        self._show(len(status), path, time)
        return EventStatus.Succeeded()

    def _place(self, path: str, text: str, color: Rgba, row: int, time: float) -> None:
        if path not in self._made:
            board = text_board(text, height=self._height, frame_color=color)
            self._meshcat.SetObject(path, board)
            if time > 0:
                self._meshcat.SetProperty(path, "visible", False, 0.0)
            self._made.add(path)
        X_BR = RigidTransform([0.0, 0.0, row * _ROW * self._height])
        self._meshcat.SetTransform(path, X_BR, time)

    def _show(self, contact: int, path: str | None, time: float) -> None:
        before = self._shown[contact]
        if path == before:
            return
        for shown, visible in ((before, False), (path, True)):
            if shown is not None:
                self._meshcat.SetProperty(shown, "visible", visible, time)
        self._shown[contact] = path
