"""What the outcomes of the study depend on, for its folder to say."""

from dataclasses import asdict
from typing import Any

import numpy as np

from drake_pregrasp.simulation.hand_file import load_hand
from drake_pregrasp.studies.static_versus_dynamic.scene import BOX, HAND, SCENES, SPACING, Scene
from drake_pregrasp.studies.static_versus_dynamic.start import START_SETTINGS
from drake_pregrasp.version import __version__


def study_settings() -> dict[str, Any]:
    """Returns the settings, as JSON can say them."""
    return {
        "version": __version__,
        "object": asdict(BOX),
        "spacing": SPACING,
        "hand": asdict(load_hand(HAND)),
        "grasp": asdict(SCENES["nominal"].grasp()),
        "start": START_SETTINGS,
        "conditions": {name: _said(scene) for name, scene in SCENES.items()},
    }


def _said(scene: Scene) -> dict[str, Any]:
    said = dict(vars(scene))
    said["yaw_range"] = [bound if np.isfinite(bound) else None for bound in scene.yaw_range]
    said["area"] = [
        {
            "kind": type(moving.solid).__name__,
            **{name: np.asarray(value).tolist() for name, value in vars(moving.solid).items()},
            "velocity": moving.velocity.tolist(),
        }
        for moving in scene.area
    ]
    return said
