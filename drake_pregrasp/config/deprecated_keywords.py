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
    if not keywords:
        config = default if config is None else config
        check_fields(config)
        return config
    said = ", ".join(keywords)
    if config is not None:
        raise TypeError(f"{type(owner).__name__} accepts {said} in its config, not as keywords too")
    for keyword, value in keywords.items():
        path = (names or {}).get(keyword, keyword)
        try:
            default = _changed(default, path.split("."), value)
        except (TypeError, AttributeError) as error:
            raise TypeError(f"{type(owner).__name__} has no argument {keyword}") from error
    warnings.warn(
        f"{type(owner).__name__}: give {said} in a {type(default).__name__}; as keywords they are"
        " deprecated",
        DeprecationWarning,
        stacklevel=3,
    )
    check_fields(default)
    return default


def _changed(config: Any, path: list[str], value: Any) -> Any:
    name, *rest = path
    if rest:
        value = _changed(getattr(config, name), rest, value)
    return dataclasses.replace(config, **{name: value})
