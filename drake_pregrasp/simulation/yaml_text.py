"""YAML from strangers: read as plain data, in bounded time and memory.

Anchors, merges (`<<`) and tags work as in Drake's own loader, which reads a tag as the key `_tag`
of a mapping. But nothing is taken over before it is known to be small once all aliases are written
out, and no key may be there twice.
"""

from collections.abc import Iterator
from typing import Any

import yaml
from pydrake.common.yaml import yaml_load_typed
from yaml.composer import Composer
from yaml.constructor import SafeConstructor
from yaml.resolver import Resolver

from drake_pregrasp.errors import ScenarioError

MAX_BYTES = 1_000_000
"""Bytes of a YAML file."""

MAX_VALUES = 100_000
"""Values in a YAML file, with all aliases written out."""

MAX_DEPTH = 32
"""Levels of lists and mappings in each other."""

MAX_DIGITS = 64
"""Characters of a whole number: no key needs more, and long ones take long to convert."""

TAG_KEY = "_tag"
"""Key under which a mapping's tag is kept, as in Drake's own loader."""

_SHOWN = 60  # Characters of a key in a message.
_SCANNER = getattr(yaml, "CSafeLoader", yaml.SafeLoader)
_DUMPER = getattr(yaml, "CSafeDumper", yaml.SafeDumper)
_MERGE = "tag:yaml.org,2002:merge"


def parse_yaml(source: str, text: str) -> Any:
    """Returns what a YAML text holds: mappings, lists, texts, numbers, and the like.

    Args:
        source: What the text was read from, for the message.
        text: YAML.

    Raises:
        ScenarioError: If it is no YAML, or too much of it.
    """
    if len(text) > MAX_BYTES:
        raise ScenarioError(source, "", f"has more than {MAX_BYTES} characters; make it smaller")
    try:
        return _Loader(_bounded_events(source, text), source).get_single_data()
    except ScenarioError:
        raise
    except Exception as error:  # Constructors raise whatever dates and numbers do.
        problem = _words(error)
        raise ScenarioError(source, "", f"is no YAML: {problem}") from error


def without_private(data: Any) -> Any:
    """Returns data without those keys of a mapping that start with `_`, which anchors are under."""
    if not isinstance(data, dict):
        return data
    return {key: value for key, value in data.items() if not str(key).startswith("_")}


def dump_yaml(data: Any) -> str:
    """Returns the text of data from `parse_yaml`: in its order, with its tags."""
    text: str = yaml.dump(data, Dumper=_Dumper, allow_unicode=True, sort_keys=False)
    return text


def load_typed(schema: type, data: Any, defaults: Any) -> Any:
    """Returns an instance of a schema, from data that has been checked against it.

    Args:
        schema: A dataclass.
        data: A mapping, from `parse_yaml`.
        defaults: An instance, for the keys that it lacks.
    """
    # Drake's loader takes text only. This text is plain: no tags, and no alias that isn't small.
    text = yaml.dump(data, Dumper=_DUMPER, allow_unicode=True, default_flow_style=True)
    return yaml_load_typed(schema=schema, data=text, defaults=defaults)


def _words(error: Exception) -> str:
    """Returns what is wrong, and on which line if the error knows, without its excerpts."""
    if isinstance(error, yaml.MarkedYAMLError) and error.problem:
        mark = error.problem_mark
        return error.problem if mark is None else f"line {mark.line + 1}: {error.problem}"
    return " ".join(str(error).split()) or type(error).__name__


def _bounded_events(source: str, text: str) -> Iterator[yaml.Event]:
    depth, values = 0, 0
    for event in yaml.parse(text, Loader=_SCANNER):
        if isinstance(event, yaml.CollectionStartEvent):
            depth += 1
        elif isinstance(event, yaml.CollectionEndEvent):
            depth -= 1
        if isinstance(event, yaml.NodeEvent):
            values += 1
        if depth > MAX_DEPTH:
            raise ScenarioError(source, "", f"is nested more than {MAX_DEPTH} levels deep")
        if values > MAX_VALUES:
            raise ScenarioError(source, "", f"has more than {MAX_VALUES} values; make it smaller")
        yield event


class _Loader(Composer, SafeConstructor, Resolver):
    """Makes data of events.

    Args:
        events: In bounds.
        source: For messages.
    """

    def __init__(self, events: Iterator[yaml.Event], source: str) -> None:
        Composer.__init__(self)
        SafeConstructor.__init__(self)
        Resolver.__init__(self)
        self._events = events
        self._source = source
        self._next: yaml.Event | None = None

    def peek_event(self) -> yaml.Event | None:
        """Returns the next event and leaves it there; None at the end."""
        if self._next is None:
            self._next = next(self._events, None)
        return self._next

    def get_event(self) -> yaml.Event | None:
        """Returns the next event."""
        event, self._next = self.peek_event(), None
        return event

    def check_event(self, *kinds: type) -> bool:
        """Returns whether the next event is of one of these kinds."""
        return isinstance(self.peek_event(), kinds)

    def get_single_node(self) -> yaml.Node | None:
        """Returns the document, if its aliases can be written out."""
        node = super().get_single_node()
        if node is not None:
            size, depth = self._size(node, {})
            if size > MAX_VALUES:
                raise self._error(node, f"its aliases make more than {MAX_VALUES} values")
            if depth > MAX_DEPTH:
                raise self._error(node, f"its aliases nest more than {MAX_DEPTH} levels deep")
        return node

    def _size(self, node: yaml.Node, sizes: dict[int, tuple[int, int] | None]) -> tuple[int, int]:
        """Returns how many values a node holds with its aliases written out, and how deep."""
        if isinstance(node, yaml.ScalarNode):
            return 1, 0
        if id(node) in sizes:
            known = sizes[id(node)]
            if known is None:
                raise self._error(node, "an alias holds itself")
            return known
        sizes[id(node)] = None
        if isinstance(node, yaml.MappingNode):
            self._refuse_twins(node)
            parts = [part for pair in node.value for part in pair]
        else:
            parts = node.value
        counts = [self._size(part, sizes) for part in parts]
        size = 1 + sum(count for count, _ in counts)
        depth = 1 + max((depth for _, depth in counts), default=0)
        sizes[id(node)] = size, depth
        return size, depth

    def _refuse_twins(self, node: yaml.MappingNode) -> None:
        seen = set()
        for key, _ in node.value:
            if not isinstance(key, yaml.ScalarNode):
                raise self._error(key, "a list or mapping can't be a key")
            if key.value == TAG_KEY:
                raise self._error(key, f"{TAG_KEY} is no key; write a tag, as in !Box {{...}}")
            if key.tag != _MERGE and (key.tag, key.value) in seen:
                raise self._error(key, f"the key {key.value[:_SHOWN]} is there twice")
            seen.add((key.tag, key.value))

    def _error(self, node: yaml.Node, problem: str) -> ScenarioError:
        return ScenarioError(self._source, "", f"line {node.start_mark.line + 1}: {problem}")

    def construct_number(self, node: yaml.Node) -> int:
        """Returns a whole number."""
        if len(node.value) > MAX_DIGITS:
            raise self._error(node, f"a whole number has more than {MAX_DIGITS} characters")
        number: int = self.construct_yaml_int(node)
        return number

    def construct_tagged(self, tag: str, node: yaml.Node) -> dict[Any, Any]:
        """Returns a mapping with its tag."""
        if not isinstance(node, yaml.MappingNode):
            raise self._error(
                node, f"the tag {tag[:_SHOWN]} is of no mapping, as that of !Box {{}} is"
            )
        mapping: dict[Any, Any] = self.construct_mapping(node, deep=True)
        mapping[TAG_KEY] = tag
        return mapping


_Loader.add_constructor("tag:yaml.org,2002:int", _Loader.construct_number)
_Loader.add_multi_constructor("", _Loader.construct_tagged)


class _Dumper(yaml.SafeDumper):
    """Writes mappings with their tags."""

    def represent_tagged(self, data: dict[Any, Any]) -> yaml.Node:
        """Returns the node of a mapping."""
        rest = {key: value for key, value in data.items() if key != TAG_KEY}
        return self.represent_mapping(data.get(TAG_KEY, Resolver.DEFAULT_MAPPING_TAG), rest)


_Dumper.add_representer(dict, _Dumper.represent_tagged)
