"""Reads untrusted YAML as plain data, in bounded time and memory.

PyYAML's safe loader reads the text. This module adds limits on size and depth with all aliases
expanded, rejects duplicate keys, and stores a mapping's tag under the key `_tag`, like Drake's own
loader.
"""

from pathlib import Path
from typing import Any

import yaml
from pydrake.common.yaml import yaml_load_typed

from drake_pregrasp.errors import InvalidArgumentError, ScenarioError
from drake_pregrasp.resources import read_bounded_text

try:
    from yaml import CSafeDumper as SafeDumper
    from yaml import CSafeLoader as SafeLoader
except ImportError:  # PyYAML was built without libyaml.
    from yaml import SafeDumper, SafeLoader

MAX_BYTES = 1_000_000
"""Largest size of a YAML file, in bytes."""

MAX_VALUES = 100_000
"""Largest number of values in a YAML file, with all aliases expanded."""

MAX_DEPTH = 32
"""Largest nesting depth of lists and mappings."""

MAX_DIGITS = 64
"""Largest number of characters of an integer: the conversion of long integers is slow."""

TAG_KEY = "_tag"
"""Key that stores a mapping's tag, as in Drake's own loader."""

_SHOWN = 60  # Largest number of characters of a key in a message.
_INT, _MAP, _MERGE = (f"tag:yaml.org,2002:{kind}" for kind in ("int", "map", "merge"))


def parse_yaml(source: str, text: str) -> Any:
    """Returns the content of a YAML text: mappings, lists, strings, numbers.

    Args:
        source: Name of the text's origin, for error messages.
        text: YAML text.

    Raises:
        ScenarioError: If the text is not valid YAML, or exceeds a limit.
    """
    if len(text) > MAX_BYTES:
        raise ScenarioError(source, "", f"has more than {MAX_BYTES} characters; make it smaller")
    try:
        _check_events(source, text)
        loader = _Loader(text)
        node = loader.get_single_node()
        if node is None:
            return None
        _check_document(source, node)
        return loader.construct_document(node)
    except ScenarioError:
        raise
    except Exception as error:  # Constructors raise various types for dates and numbers.
        problem = " ".join(str(error).split()) or type(error).__name__
        if isinstance(error, yaml.MarkedYAMLError) and error.problem:
            mark = error.problem_mark
            problem = f"line {mark.line + 1}: {error.problem}" if mark else error.problem
        raise ScenarioError(source, "", f"is not valid YAML: {problem}") from error


def read_text(path: Path) -> str:
    """Returns the text of a YAML file.

    Raises:
        ScenarioError: If the file cannot be read, or exceeds a limit.
    """
    try:
        return read_bounded_text(path, MAX_BYTES)
    except InvalidArgumentError as error:
        raise ScenarioError("", "", str(error)) from error


def parse_entries(source: str, text: str) -> Any:
    """Returns the content of a YAML text without keys that start with `_`, used for anchors."""
    data = parse_yaml(source, text)
    if not isinstance(data, dict):
        return data
    return {key: value for key, value in data.items() if not str(key).startswith("_")}


def dump_yaml(data: Any) -> str:
    """Returns data from `parse_yaml` as YAML text, in its order and with its tags."""
    return str(yaml.dump(data, Dumper=_Dumper, allow_unicode=True, sort_keys=False))


def load_typed(schema: type, data: Any, defaults: Any) -> Any:
    """Returns an instance of a schema from data that was checked against the schema.

    Args:
        schema: Dataclass of the instance.
        data: Mapping from `parse_yaml`.
        defaults: Instance with the values of missing keys.
    """
    # Drake's loader accepts only text. The text's aliases are small.
    return yaml_load_typed(schema=schema, data=dump_yaml(data), defaults=defaults)


def _check_events(source: str, text: str) -> None:
    """Checks depth and size iteratively, before recursive code reads the text."""
    depth, values = 0, 0
    for event in yaml.parse(text, Loader=SafeLoader):
        depth += isinstance(event, yaml.CollectionStartEvent)
        depth -= isinstance(event, yaml.CollectionEndEvent)
        values += isinstance(event, yaml.NodeEvent)
        if depth > MAX_DEPTH:
            raise ScenarioError(source, "", f"is nested more than {MAX_DEPTH} levels deep")
        if values > MAX_VALUES:
            raise ScenarioError(source, "", f"has more than {MAX_VALUES} values; make it smaller")


def _check_document(source: str, root: yaml.Node) -> None:
    """Rejects large or cyclic aliases, duplicate keys and long integers."""
    sizes: dict[int, tuple[int, int] | None] = {}
    merged_lists: set[int] = set()
    known_tags = {*_Loader.yaml_constructors, _MERGE}

    def measure(node: yaml.Node) -> tuple[int, int]:
        """Returns the number of values with aliases expanded, and the depth."""
        if node.tag not in known_tags and not isinstance(node, yaml.MappingNode):
            tag = node.tag[:_SHOWN]
            raise error(node, f"the tag {tag} needs a mapping, as in {tag} {{}}")
        if isinstance(node, yaml.ScalarNode):
            if node.tag == _INT and len(node.value) > MAX_DIGITS:
                raise error(node, f"a whole number has more than {MAX_DIGITS} characters")
            return 1, 0
        if id(node) in sizes:
            if (known := sizes[id(node)]) is None:
                raise error(node, "an alias contains itself")
            return known
        sizes[id(node)] = None
        parts = node.value
        if isinstance(node, yaml.MappingNode):
            refuse_bad_keys([key for key, _ in parts])
            for key, merged in parts:  # Which of equal keys counts is not the same in all versions.
                is_list = key.tag == _MERGE and isinstance(merged, yaml.SequenceNode)
                if is_list and id(merged) not in merged_lists:
                    merged_lists.add(id(merged))
                    keys = [k for n in merged.value for k, _ in _pairs(n)]
                    refuse_bad_keys([k for k in keys if k.tag != _MERGE])
            parts = [part for pair in parts for part in pair]
        counts, depths = zip(*map(measure, parts), strict=True) if parts else ((), (0,))
        sizes[id(node)] = size, depth = 1 + sum(counts), 1 + max(depths)
        return size, depth

    def refuse_bad_keys(keys: list[yaml.Node]) -> None:
        seen = set()
        for key in keys:
            if not isinstance(key, yaml.ScalarNode):
                raise error(key, "a list or mapping cannot be a key")
            if key.value == TAG_KEY:
                raise error(key, f"{TAG_KEY} is not a key; write a tag, as in !Box {{...}}")
            if (key.tag, key.value) in seen:
                raise error(key, f"the key {key.value[:_SHOWN]} occurs twice")
            seen.add((key.tag, key.value))

    def error(node: yaml.Node, problem: str) -> ScenarioError:
        return ScenarioError(source, "", f"line {node.start_mark.line + 1}: {problem}")

    size, depth = measure(root)
    if size > MAX_VALUES:
        raise error(root, f"its aliases expand to more than {MAX_VALUES} values")
    if depth > MAX_DEPTH:
        raise error(root, f"its aliases nest more than {MAX_DEPTH} levels deep")


def _pairs(node: yaml.Node) -> list[tuple[yaml.Node, yaml.Node]]:
    return node.value if isinstance(node, yaml.MappingNode) else []


class _Loader(SafeLoader):
    """YAML loader that stores a mapping's tag under the key `_tag`."""

    def construct_tagged(self, tag: str, node: yaml.Node) -> dict[Any, Any]:
        """Returns a mapping with its tag under the key `_tag`."""
        return {**self.construct_mapping(node, deep=True), TAG_KEY: tag}


_Loader.add_multi_constructor("", _Loader.construct_tagged)


class _Dumper(SafeDumper):
    """YAML dumper that writes the tags of mappings."""

    def represent_tagged(self, data: dict[Any, Any]) -> yaml.Node:
        """Returns the YAML node of a mapping with its tag."""
        rest = {key: value for key, value in data.items() if key != TAG_KEY}
        return self.represent_mapping(data.get(TAG_KEY, _MAP), rest)


_Dumper.add_representer(dict, _Dumper.represent_tagged)
