"""The checked configuration of a system, with keywords of earlier releases folded in."""

import dataclasses
import warnings
from collections.abc import Mapping
from typing import Any, TypeVar

from drake_pregrasp.config.validation import check_fields

Config = TypeVar("Config")


def config_with(
    config: Config | None,
    default: Config,
    keywords: Mapping[str, Any],
    owner: object,
    names: Mapping[str, str] | None = None,
) -> Config:
    """Returns the configuration of a system after a check of its ranges.

    Args:
        config: Configuration from the caller, or None.
        default: Configuration that the keywords change.
        keywords: Deprecated keywords with their values.
        owner: System whose constructor is called.
        names: Dotted path of the field for each keyword that has another name than its field.

    Raises:
        TypeError: If a keyword is unknown, or given in addition to a configuration.
        InvalidArgumentError: If a field is out of its range.
    """
    system, said = type(owner).__name__, ", ".join(keywords)
    if keywords and config is not None:
        raise TypeError(f"{system} accepts {said} in its config, not as keywords too")
    for keyword, value in keywords.items():
        path = (names or {}).get(keyword, keyword)
        try:
            default = _changed(default, path.split("."), value)
        except (TypeError, AttributeError) as error:
            raise TypeError(f"{system} has no argument {keyword}") from error
    if keywords:
        place = f"give {said} in a {type(default).__name__}"
        message = f"{system}: {place}; as keywords they are deprecated"
        warnings.warn(message, DeprecationWarning, stacklevel=3)
    config = default if config is None else config
    check_fields(config)
    return config


def _changed(config: Any, path: list[str], value: Any) -> Any:
    name, *rest = path
    if rest:
        value = _changed(getattr(config, name), rest, value)
    return dataclasses.replace(config, **{name: value})
