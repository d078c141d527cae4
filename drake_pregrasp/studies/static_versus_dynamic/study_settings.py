"""What the outcomes of the study depend on, for its folder to say."""

from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from drake_pregrasp.resources import resource_folder
from drake_pregrasp.simulation.hand_file import load_hand
from drake_pregrasp.studies.file_digest import digest_files
from drake_pregrasp.studies.static_versus_dynamic.scene import BOX, HAND, SCENES, SPACING, Scene
from drake_pregrasp.studies.static_versus_dynamic.start import START_SETTINGS
from drake_pregrasp.studies.static_versus_dynamic.trial_diagram import PLANT
from drake_pregrasp.version import __version__

_PLANT = (
    "time_step",
    "contact_model",
    "discrete_contact_approximation",
    "sap_near_rigid_threshold",
)
_FLOORS = ("planning", "systems", "diagrams")
_MODULES = (
    "grasp_outcome.py",
    "outcome.py",
    "planned_start.py",
    "reassignment.py",
    "scene.py",
    "start.py",
    "still_hand.py",
    "trial.py",
    "trial_diagram.py",
    "trial_goals.py",
)


def study_settings() -> dict[str, Any]:
    """Returns the settings, as JSON can say them."""
    return {
        "version": __version__,
        "object": asdict(BOX),
        "spacing": SPACING,
        "hand": asdict(load_hand(HAND)),
        "grasp": asdict(SCENES["nominal"].grasp()),
        "start": START_SETTINGS,
        "plant": {name: getattr(PLANT, name) for name in _PLANT},
        "source": source_digest(),
        "conditions": {name: _said(scene) for name, scene in SCENES.items()},
    }


def source_digest() -> str:
    """Returns a digest of the source that outcomes come from: of these, any change may matter."""
    folder = Path(__file__).parents[2]
    files = [file for floor in _FLOORS for file in sorted((folder / floor).rglob("*.py"))]
    files += [folder / "studies" / "static_versus_dynamic" / name for name in _MODULES]
    files.append(resource_folder("models") / "five_finger_hand.sdf")
    return digest_files(files)


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
