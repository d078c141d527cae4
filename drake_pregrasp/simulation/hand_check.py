"""Checks of hand descriptions, and proposals for models that have none."""

import dataclasses
import itertools
import os
import typing
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import trimesh
from pydrake.geometry import MeshcatVisualizer, Rgba, Sphere
from pydrake.math import RigidTransform
from pydrake.planning import RobotDiagramBuilder

from drake_pregrasp.config.hand_description import Drive, HandDescription
from drake_pregrasp.config.yaml_text import TAG_KEY, dump_yaml
from drake_pregrasp.diagrams.directive_files import DIRECTIVES, YAML
from drake_pregrasp.diagrams.hand_model import HandModel
from drake_pregrasp.diagrams.hand_parsing import read_model
from drake_pregrasp.diagrams.hand_proposal import HOME_YAWS, propose_hand, usual_place
from drake_pregrasp.diagrams.model_files import CheckedModel
from drake_pregrasp.errors import InvalidArgumentError, PregraspError, problems_of
from drake_pregrasp.grasping.finger_homes import OBJECT_RADIUS
from drake_pregrasp.resources import resolve_path
from drake_pregrasp.simulation.hand_file import hand_data, read_hand
from drake_pregrasp.simulation.recording import start_meshcat
from drake_pregrasp.simulation.schema_check import is_union, mapping_problems
from drake_pregrasp.visualization.drawing import contact_color

_CAMERA = (0.35, -0.45, 0.25)  # Place of the camera relative to the object, in metres.
_PALE = 0.2  # Opacity of a reach.
_OBJECT_COLOR = Rgba(0.5, 0.5, 0.5, 0.3)


@dataclasses.dataclass
class HandCheck:
    """Result of the check of a hand.

    Attributes:
        description: The description; None if it could not be read or proposed.
        model: Model of the hand; None if there are problems.
        problems: All problems that were found, one line each.
        is_proposal: Whether the description is a proposal for a model.
    """

    description: HandDescription | None
    model: HandModel | None
    problems: list[str]
    is_proposal: bool


def check_hand(file: str, *, folders: Sequence[str | Path] | None = None) -> HandCheck:
    """Checks a description of a hand, or proposes one for a model.

    Args:
        file: Description in YAML; or an SDF, a URDF, an MJCF or model directives. It is a path from
            the working directory, or a URL as in `HandDescription.model`.
        folders: Folders that may hold files which it names, besides its own; as for `load_hand`.
    """
    is_proposal = not file.endswith(YAML) or file.endswith(DIRECTIVES)
    description: HandDescription | None = None
    read: CheckedModel | None
    try:
        if is_proposal:
            name = file if "://" in file else str(resolve_path(file, Path.cwd()))
            allowed = None if folders is None else [Path(name).parent, *map(Path, folders)]
            description = propose_hand(name, read := read_model(name, allowed))
        else:
            if problems := _schema_problems(file):
                return HandCheck(None, None, problems, is_proposal)
            description, read = read_hand(file, folders)
        model = HandModel(description, model=read, warns=not is_proposal)
    except PregraspError as error:
        return HandCheck(description, None, problems_of(error), is_proposal)
    return HandCheck(description, model, _home_problems(model), is_proposal)


def _schema_problems(file: str) -> list[str]:
    """Returns the problems of the keys and values of a description, without its model."""
    data = hand_data(resolve_path(file, Path.cwd()))
    found = mapping_problems("", data, HandDescription)
    return [": ".join(filter(None, (key, problem))) for key, problem in found]


def _home_problems(model: HandModel) -> list[str]:
    """Returns the problems of fingertips at home, and of a palm over an object."""
    problems, tips, radii = [], model.description.fingertips, model.tip_radii
    for i, j in itertools.combinations(range(len(tips)), 2):
        between = float(np.linalg.norm(model.p_HT[i] - model.p_HT[j]))
        if between < radii[i] + radii[j]:
            problems.append(
                f"fingertips: at home, the centres of {tips[i].frame} and {tips[j].frame} are"
                f" {1e3 * between:.3g} mm apart; they must be {1e3 * (radii[i] + radii[j]):.3g} mm"
                " apart or more"
            )
    place, misses = usual_place(model), list[str]()
    for yaw in HOME_YAWS:
        try:
            model.home(place, yaw)
            return problems
        except InvalidArgumentError as error:
            misses.append(str(error))
    return [*problems, f"{misses[0]}, and is there at no other yaw; move the base"]


def description_yaml(description: HandDescription, folder: Path) -> str:
    """Returns the YAML text of a description, without the keys that have their default values.

    Args:
        description: Description of the hand.
        folder: Folder of the YAML file, at which the path of the model starts.
    """
    model = description.model
    if "://" not in model:
        model = os.path.relpath(model, folder.resolve())
    return dump_yaml(_plain(dataclasses.replace(description, model=model)))


def _plain(value: Any) -> Any:
    if isinstance(value, list):
        return [_plain(element) for element in value]
    if not dataclasses.is_dataclass(value):
        return value
    fields, kinds = {}, typing.get_type_hints(type(value))
    for f in dataclasses.fields(value):
        own = getattr(value, f.name)
        default = f.default_factory() if callable(f.default_factory) else f.default
        is_shown = isinstance(value, Drive) and own  # A drive shows what it has.
        if own != default or is_shown or f.metadata.get("required"):
            fields[f.name] = _plain(own)
            if is_union(kinds[f.name]):
                fields[f.name][TAG_KEY] = f"!{type(own).__name__}"
    return fields


def hand_page(model: HandModel) -> str:
    """Returns a self-contained page with the hand at home over a ball.

    Fingertips are balls, and the reach of each finger is a surface: the convex hull of the places
    that its joints reach.

    Args:
        model: Model of the hand.

    Raises:
        OutputError: If Drake may not open a port.
    """
    meshcat, builder = start_meshcat(), RobotDiagramBuilder(time_step=0.0)
    model.add_to(builder.plant())
    builder.plant().Finalize()
    MeshcatVisualizer.AddToBuilder(builder.builder(), builder.scene_graph(), meshcat)
    diagram = builder.Build()
    context, plant = diagram.CreateDefaultContext(), diagram.plant()
    plant.SetPositions(plant.GetMyContextFromRoot(context), model.base.at_home(model.fingers_home))
    diagram.ForcedPublish(context)
    X_WA = model.base.X_AW.inverse()
    meshcat.SetObject("object", Sphere(OBJECT_RADIUS), _OBJECT_COLOR)
    meshcat.SetTransform("object", X_WA)
    for finger, (p_HT, radius) in enumerate(zip(model.p_HT, model.tip_radii, strict=True)):
        color, name = contact_color(finger), model.description.fingertips[finger].frame
        meshcat.SetObject(f"fingertips/{name}", Sphere(1.05 * radius), color)
        meshcat.SetTransform(f"fingertips/{name}", X_WA @ RigidTransform(p_HT))
        reached = trimesh.convex.convex_hull(np.array(model.fingers.workspaces[finger].data))
        pale = Rgba(color.r(), color.g(), color.b(), _PALE)
        meshcat.SetTriangleMesh(
            f"reach/{name}", np.array(reached.vertices).T, np.array(reached.faces).T, pale
        )
        meshcat.SetTransform(f"reach/{name}", X_WA)
    p_WO = X_WA.translation()
    meshcat.SetCameraPose(p_WO + np.array(_CAMERA), p_WO)
    return str(meshcat.StaticHtml())
