"""Descriptions of hands from YAML files, and their models."""

import functools
from pathlib import Path

import yaml
from pydrake.common.yaml import yaml_load_data, yaml_load_typed

from drake_pregrasp.diagrams.hand_description import HandDescription
from drake_pregrasp.diagrams.hand_model import HandModel
from drake_pregrasp.diagrams.hand_parsing import model_path
from drake_pregrasp.errors import InvalidArgumentError, ScenarioError
from drake_pregrasp.planning.assignment import FREE_TURN
from drake_pregrasp.resources import resolve_path
from drake_pregrasp.simulation.scenario_paths import make_paths_absolute
from drake_pregrasp.simulation.schema_check import check_mapping

_KEPT = 2  # Models: one for looking at it, and one with the wrist's range.


def load_hand(file: str | Path) -> HandDescription:
    """Loads the description of a hand, with its keys, types and ranges checked.

    Args:
        file: A path from the working directory, or `package://drake_pregrasp/...`.

    Raises:
        ScenarioError: If there is anything wrong with it; the message names file, key and value.
    """
    try:
        path = resolve_path(str(file), Path.cwd())
    except InvalidArgumentError as error:
        raise ScenarioError(str(file), "", str(error)) from error
    try:
        data = yaml_load_data(path.read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError) as error:
        problem = getattr(error, "strerror", None) or str(error)
        raise ScenarioError(str(path), "", f"can't be read: {problem}") from error
    except yaml.YAMLError as error:
        problem = " ".join(str(error).split())
        raise ScenarioError(str(path), "", f"is no YAML: {problem}") from error
    check_mapping(str(path), "", data, HandDescription)
    description: HandDescription = yaml_load_typed(
        schema=HandDescription, filename=str(path), defaults=HandDescription()
    )
    make_paths_absolute(description, path.parent)
    return description


def load_hand_model(file: str | Path, yaw_range: tuple[float, float] = FREE_TURN) -> HandModel:
    """Loads a hand and its model; as long as both files stay as they are, the one it made before.

    Args:
        file: As for `load_hand`.
        yaw_range: As for `HandModel`.

    Raises:
        ScenarioError: As `load_hand` does.
        InvalidArgumentError: As `HandModel` does.
    """
    path = model_path(load_hand(file).model)
    own = resolve_path(str(file), Path.cwd())
    return _model(own, own.stat().st_mtime_ns, path, path.stat().st_mtime_ns, yaw_range)


@functools.lru_cache(maxsize=_KEPT)
def _model(
    file: Path, changed: int, model: Path, model_changed: int, yaw_range: tuple[float, float]
) -> HandModel:
    return HandModel(load_hand(file), yaw_range)
