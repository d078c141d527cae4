"""Log of a run as an MCAP file that Foxglove shows: poses, goals, regions and measures."""

import base64
import contextlib
import json
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from drake_pregrasp.arrays import FloatArray, IntArray
from drake_pregrasp.geometry.surface import ObjectSurface

OBJECT_FRAME = "object"
"""Name of the object's true frame, which a `PoseStream` can replay."""

_REGION_PERIOD = 0.095  # Least time between drawings of regions, most of a file: 10 Hz, with slack.
_GOAL_SIZE = 0.012  # Diameter of the ball of a goal, in metres.
_INACTIVE = 0.25  # Opacity of the goal of an inactive contact.
_OBJECT_COLOR = (0.75, 0.75, 0.75, 0.6)

_POINT = np.dtype([("p_OQ", "<f4", 3), ("color", "u1", 4)])
_UINT8, _FLOAT32 = 1, 7  # Foxglove's numeric types.
_FIELDS = {"x": 0, "y": 4, "z": 8, "red": 12, "green": 13, "blue": 14, "alpha": 15}  # And offsets.
_SCENE_LISTS = "metadata arrows cubes spheres cylinders lines triangles texts models"


class McapLog:
    """Writes ticks of a run as JSON messages with Foxglove's schemas.

    Topics are `/tf` (frames `object` and `object_estimated` in `world`), `/object` (its shape),
    `/goals`, `/regions`, ten times a second, and `/measures`: the columns of `log.csv`.

    Args:
        path: File to write; an existing one is replaced.
        surface: Surface of the object.
        colors: Red, green and blue of each contact, from 0 to 1, shape (n, 3).

    Attributes:
        path: File that is written.
    """

    def __init__(self, path: Path, surface: ObjectSurface, colors: FloatArray) -> None:
        self.path, self._surface = path, surface
        self._colors = np.column_stack([colors, np.ones(len(colors))])
        self._channels: dict[str, int] = {}
        self._drawn = -math.inf

    def open(self) -> None:
        """Opens the file, before the first tick.

        Raises:
            OSError: If the file cannot be written.
        """
        from mcap.writer import Writer

        with contextlib.ExitStack() as stack:
            self._file = stack.enter_context(self.path.open("wb"))
            self._writer = Writer(self._file)
            self._writer.start(library="drake_pregrasp")
            stack.pop_all()  # The file stays open.

    def close(self) -> None:
        """Ends the file, which is whole after any number of ticks.

        Raises:
            OSError: If the file cannot be written.
        """
        with self._file:
            self._writer.finish()

    def append(self, row: Mapping[str, float], labels: IntArray) -> None:
        """Adds a tick.

        Args:
            row: Values of the columns of `log.csv`.
            labels: Region that each candidate of the surface lies in, or -1, shape (N,).

        Raises:
            OSError: If the file cannot be written.
        """
        self._time = round(row["time"] * 1e9)
        if not self._channels:
            shape = _triangles(self._surface)
            self._write_scene("/object", OBJECT_FRAME, triangles=[shape], frame_locked=True)
        frames = {OBJECT_FRAME: "wo", "object_estimated": "wo_estimated"}
        transforms = [
            {
                **self._stamp,
                "parent_frame_id": "world",
                "child_frame_id": frame,
                "translation": _vector([row[f"{axis}_{name}"] for axis in "xyz"]),
                "rotation": _vector([row[f"q{axis}_{name}"] for axis in "xyzw"]),
            }
            for frame, name in frames.items()
        ]
        self._write("/tf", "foxglove.FrameTransforms", transforms=transforms)
        balls = [self._ball(row, contact) for contact in range(len(self._colors))]
        self._write_scene("/goals", "world", spheres=balls)
        if row["time"] - self._drawn > _REGION_PERIOD:
            self._drawn = row["time"]
            self._write_regions(labels)
        # JSON has no NaN.
        finite = {name: x if math.isfinite(x) else None for name, x in row.items()}
        self._write("/measures", "drake_pregrasp.Measures", **self._stamp, **finite)

    @property
    def _stamp(self) -> dict[str, Any]:
        sec, nsec = divmod(self._time, 10**9)
        return {"timestamp": {"sec": sec, "nsec": nsec}}

    def _write(self, topic: str, schema: str, **message: Any) -> None:
        if topic not in self._channels:
            text = json.dumps(_schema(message)).encode()
            number = self._writer.register_schema(name=schema, encoding="jsonschema", data=text)
            self._channels[topic] = self._writer.register_channel(
                topic=topic, message_encoding="json", schema_id=number
            )
        data = json.dumps(message).encode()
        self._writer.add_message(self._channels[topic], self._time, data, self._time)

    def _write_scene(self, topic: str, frame: str, **parts: Any) -> None:
        lists: dict[str, list[Any]] = {name: [] for name in _SCENE_LISTS.split()}
        entity = {
            **self._stamp,
            "frame_id": frame,
            "id": topic,
            "lifetime": {"sec": 0, "nsec": 0},
            "frame_locked": False,
            **lists,
            **parts,
        }
        self._write(topic, "foxglove.SceneUpdate", deletions=[], entities=[entity])

    def _ball(self, row: Mapping[str, float], contact: int) -> dict[str, Any]:
        place = [row[f"c{contact}_{axis}"] for axis in "xyz"]
        opacity = 1.0 if row[f"c{contact}_active"] else _INACTIVE
        return {
            "pose": _pose(place),
            "size": _vector([_GOAL_SIZE] * 3),
            "color": _color([*self._colors[contact, :3], opacity]),
        }

    def _write_regions(self, labels: IntArray) -> None:
        inside = np.flatnonzero(labels >= 0)
        points = np.empty(len(inside), dtype=_POINT)
        points["p_OQ"] = self._surface.p_OQ[inside]
        points["color"] = np.round(255 * self._colors[labels[inside]])
        self._write(
            "/regions",
            "foxglove.PointCloud",
            **self._stamp,
            frame_id=OBJECT_FRAME,
            pose=_pose([0.0] * 3),
            point_stride=_POINT.itemsize,
            fields=[
                {"name": name, "offset": offset, "type": _UINT8 if offset >= 12 else _FLOAT32}
                for name, offset in _FIELDS.items()
            ],
            data=base64.b64encode(points.tobytes()).decode(),
        )


def _vector(values: Sequence[float]) -> dict[str, float]:
    return dict(zip("xyzw", values, strict=False))


def _color(values: Sequence[float]) -> dict[str, float]:
    return dict(zip("rgba", values, strict=True))


def _pose(p: Sequence[float]) -> dict[str, Any]:
    return {"position": _vector(p), "orientation": _vector([0.0, 0.0, 0.0, 1.0])}


def _triangles(surface: ObjectSurface) -> dict[str, Any]:
    return {
        "pose": _pose([0.0] * 3),
        "points": [_vector(vertex) for vertex in surface.mesh.vertices.tolist()],
        "color": _color(_OBJECT_COLOR),
        "colors": [],
        "indices": surface.mesh.faces.ravel().tolist(),
    }


def _schema(value: Any, key: str = "") -> dict[str, Any]:
    """Returns the JSON schema of a message, as far as Foxglove reads it."""
    if isinstance(value, dict):
        properties = {name: _schema(part, name) for name, part in value.items()}
        return {"type": "object", "properties": properties}
    if isinstance(value, list):
        return {"type": "array", "items": _schema(value[0] if value else {})}
    if isinstance(value, str):
        return {"type": "string", **({"contentEncoding": "base64"} if key == "data" else {})}
    names = {bool: "boolean", int: "integer"}
    return {"type": names.get(type(value), "number")}
