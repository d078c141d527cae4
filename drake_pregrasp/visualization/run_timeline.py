"""Timeline of a run in words: states over time and captions of events, for pages with a scene."""

import base64
import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from drake_pregrasp.contacts.selection_input import ContactStatus, describe_status
from drake_pregrasp.estimation.pose_track import TrackingStatus
from drake_pregrasp.grasping.catch_limits import describe_catch_limit
from drake_pregrasp.grasping.grasp_state import GraspPhase, describe_give_up
from drake_pregrasp.quality.grasp_quality import QUALITY_MEASURES
from drake_pregrasp.systems.grasp_quality_monitor import GraspQualityView
from drake_pregrasp.systems.loggers import GraspRecord, TickRecord
from drake_pregrasp.visualization.drawing import contact_color, hex_color

_PICTURES = 6000  # Largest number of pictures that are kept: those of a camera over ten minutes.

OVERLAY = Path(__file__).with_name("run_timeline.html")
"""Part of a page that shows a timeline."""

_TRACKING = {
    TrackingStatus.WAITING: "waiting for the first measurement",
    TrackingStatus.TRACKING: "tracked",
    TrackingStatus.COASTING: "not confirmed: goals follow the prediction",
    TrackingStatus.LOST: "lost from sight: goals are held",
}
_PHASES = {
    GraspPhase.APPROACH: "approaches",
    GraspPhase.TRACK: "follows the object",
    GraspPhase.CLOSE: "closes",
    GraspPhase.SQUEEZE: "squeezes",
    GraspPhase.LIFT: "lifts",
    GraspPhase.HOLD: "holds",
    GraspPhase.BACK_OFF: "backs off",
}


class RunTimeline:
    """Collects what a run has to tell, from the records of its loggers.

    Args:
        title: Title of the run.
        num_contacts: Number of contacts n.
        fingertips: Name of the fingertip of each contact; empty without a hand.
        static_end: End of the phase in which initial contacts are held, in seconds; 0 for none.
        obstacle_names: Names of obstacles by their indices; other obstacles have none.
        camera: How the page's camera follows the object, as the fields of `CameraView`; empty for a
            camera that stays.
        waits: Whether a hand waits elsewhere until it can meet the object.

    Attributes:
        states: Present texts by the names of their rows: `0` to `n - 1` for contacts, `object`,
            `hand`, `meeting` if a hand waits, and the names of measures.
        has_closed: Whether a hand closes on the object, or holds it, at present.
        finger_names: Name of each finger, with the frame of its fingertip if a hand has it.
    """

    def __init__(
        self,
        title: str,
        num_contacts: int,
        *,
        fingertips: Sequence[str] = (),
        static_end: float = 0.0,
        obstacle_names: Mapping[int, str] | None = None,
        camera: Mapping[str, list[float]] | None = None,
        waits: bool = False,
    ) -> None:
        self._waits = waits
        self._title, self._obstacle_names = title, dict(obstacle_names or {})
        self._camera = dict(camera or {})
        frames = [f" ({frame})" for frame in fingertips] or num_contacts * [""]
        self.finger_names = [f"finger {i}{frame}" for i, frame in enumerate(frames)]
        self._colors = [hex_color(contact_color(i)) for i in range(num_contacts)]
        self._static_end, self._time, self._was_tracked = static_end, 0.0, False
        self._kinds: list[float] = [ContactStatus.INACTIVE] * num_contacts
        self.has_closed = False
        self.states: dict[str, str] = {}
        self._changes: list[tuple[float, str, str]] = []
        self._events: list[tuple[float, str]] = []
        self._pictures: list[tuple[float, int, str]] = []
        self._newest: dict[int, str] = {}

    def add_tick(self, record: TickRecord) -> None:
        """Adds a planning tick."""
        time, before = record.time, self._time
        self._time = time
        if before < self._static_end <= time:
            self.tell("contacts adapt")
        status = TrackingStatus(record.tracking_status)
        was_tracked = self._was_tracked
        self._set("object", _TRACKING[status], is_event=was_tracked)
        self._was_tracked |= status == TrackingStatus.TRACKING
        view = GraspQualityView(record.grasp_quality)
        for name in QUALITY_MEASURES:
            value = getattr(view, name)
            self._set(name, f"{value:.4f}" if np.isfinite(value) else "none")
        for contact, (kind, cause) in enumerate(
            zip(record.contact_status, record.contact_causes, strict=True)
        ):
            words = describe_status(kind, cause, self._obstacle_names)
            was_active, is_active = self._kinds[contact] > 0, kind > 0
            self._kinds[contact] = kind
            self._set(str(contact), words)
            if was_active != is_active and was_tracked:  # As it is found, all get one.
                news = "has a goal again" if is_active else words
                name = self.finger_names[contact]
                self.tell(f"{name} {news}" if kind != 0 else f"{name}: {news}")

    def add_grasp(self, record: GraspRecord) -> None:
        """Adds a control tick of a hand."""
        phase, _, reason, detail = record.report
        words = _PHASES[GraspPhase(int(phase))]
        self.has_closed = GraspPhase.CLOSE <= phase <= GraspPhase.HOLD
        if why := describe_give_up(int(reason), detail):
            words += f", because {why}"
        self._time = max(self._time, record.time)
        self._set("hand", words, is_event=True)
        if self._waits:
            self._set("meeting", _describe_meeting(phase, *record.catch_certificate[:2]))

    def add_picture(self, time: float, camera: int, png: bytes) -> None:
        """Adds the picture of a camera, given by its index, at a time in seconds."""
        source = "data:image/png;base64," + base64.b64encode(png).decode()
        self._newest[camera] = source
        if len(self._pictures) < _PICTURES:
            self._pictures.append((time, camera, source))

    def tell(self, text: str) -> None:
        """Adds a caption at the present time."""
        self._events.append((self._time, text))

    def _set(self, row: str, text: str, *, is_event: bool = False) -> None:
        """Sets a row's text; a change may have a caption too."""
        if self.states.get(row) == text:
            return
        self.states[row] = text
        self._changes.append((self._time, row, text))
        if is_event:
            self.tell(f"{row} {text}")

    def data(self) -> dict[str, Any]:
        """Returns the whole timeline as the overlay reads it."""
        told = {"changes": self._changes, "events": self._events, "pictures": self._pictures}
        return self._page() | told

    def now(self) -> dict[str, Any]:
        """Returns the present states and the last events only."""
        changes = [(0.0, row, text) for row, text in list(self.states.items())]
        pictures = [(0.0, camera, source) for camera, source in list(self._newest.items())]
        told = {"events": self._events[-8:], "pictures": pictures}
        return self._page() | {"changes": changes} | told

    def _page(self) -> dict[str, Any]:
        texts = {"title": self._title, "names": self.finger_names, "colors": self._colors}
        return texts | {"time": self._time, "camera": self._camera}

    def added_to(self, page: str) -> str:
        """Returns a page of Meshcat with the timeline over its scene."""
        text = json.dumps(self.data()).replace("<", "\\u003c")
        script = f"<script>playRecording({text});</script>"
        start, end, rest = page.rpartition("</body>")
        return f"{start}{OVERLAY.read_text(encoding='utf-8')}{script}{end}{rest}"


def _describe_meeting(phase: float, limit: float, time: float) -> str:
    if phase != GraspPhase.APPROACH:
        return "done"
    if why := describe_catch_limit(limit):
        return f"not possible, because {why}"
    return f"planned at {time:.1f} s"
