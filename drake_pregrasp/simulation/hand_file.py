"""Descriptions of hands from YAML files."""

from pathlib import Path

import yaml
from pydrake.common.yaml import yaml_load_data, yaml_load_typed

from drake_pregrasp.diagrams.hand_description import HandDescription
from drake_pregrasp.errors import InvalidArgumentError, ScenarioError
from drake_pregrasp.resources import resolve_path
from drake_pregrasp.simulation.scenario_paths import make_paths_absolute
from drake_pregrasp.simulation.schema_check import check_mapping


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
