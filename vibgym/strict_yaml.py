"""YAML that means one thing and stays small: PyYAML's safe loader, where what it lets pass in silence is refused.

See :func:`vibgym.config.load_yaml` for the rules.
"""

from __future__ import annotations

import re
from typing import Any

import yaml
from yaml.composer import Composer
from yaml.reader import Reader

from vibgym import checks

MOST_BYTES = 1_000_000
"""Of a file."""

DEEPEST = 50
"""Levels of nesting."""

MOST_NODES = 110_000
"""Values, keys included, once every alias is written out: all seeds of the longest evaluation fit; reading takes a second."""

UNFIT = re.compile("[\x00-\x08\x0b-\x1f\x7f-\x9f\ud800-\udfff]")
"""What no text holds, escaped or not: control characters but tab and line feed, and lone surrogates."""

# libyaml, which every wheel has, reads five times as fast; composing stays in Python, where nesting has an end.
BASES: Any = (Composer, yaml.CSafeLoader) if yaml.__with_libyaml__ else (yaml.SafeLoader,)


def load(content: bytes, name: str) -> Any:
    """The value of a file's only document.

    Args:
        content: of the file; of one that is too large, more than :data:`MOST_BYTES` are enough.
        name: of the file, for errors.

    Raises:
        ValueError: the content breaks a rule; names file and line.
    """
    if len(content) > MOST_BYTES:
        raise checks.refuse(name, f"more than {MOST_BYTES} bytes", f"files of at most {MOST_BYTES} bytes")
    try:
        text = content.decode("utf-8")
    except UnicodeDecodeError as error:
        line = content.count(b"\n", 0, error.start) + 1
        raise checks.refuse(f"{name}, line {line}", content[error.start : error.end], "valid YAML in UTF-8") from None
    unfit = Reader.NON_PRINTABLE.search(text)
    if unfit:
        line = text.count("\n", 0, unfit.start()) + 1
        raise checks.refuse(f"{name}, line {line}", unfit.group(), "valid YAML, without control characters")
    loader = None
    try:
        loader = _Loader(text)
        return loader.get_single_data()
    except _Refused as error:
        raise checks.refuse(f"{name}, line {error.line}", error.value, error.allowed) from None
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark or error.context_mark
        line = 1 if mark is None else mark.line + 1
        reason = ", ".join(each for each in (error.context, error.problem) if each)
        raise checks.refuse(f"{name}, line {line}", reason, "valid YAML") from None
    except (yaml.YAMLError, ValueError, OverflowError) as error:  # such as an escape beyond the last character
        line = 1 if loader is None else loader.begun + 1
        raise checks.refuse(f"{name}, line {line}", str(error), "valid YAML") from None


class _Refused(Exception):
    """What is wrong with a node, where, and what would be right."""

    def __init__(self, node: yaml.Node, value: object, allowed: str) -> None:
        super().__init__(value)
        self.line = node.start_mark.line + 1
        self.value, self.allowed = value, allowed


class _Loader(*BASES):
    """The safe loader, which refuses what :func:`load` says."""

    def __init__(self, text: str) -> None:
        BASES[-1].__init__(self, text)
        Composer.__init__(self)
        self._depth = self._nodes = self.begun = 0

    def compose_node(self, parent: Any, index: Any) -> Any:
        mark = self.peek_event().start_mark
        self.begun = mark.line
        self._depth += 1
        self._nodes += 1
        if self._depth > DEEPEST + 1:
            raise yaml.MarkedYAMLError(problem=f"more than {DEEPEST} levels of nesting", problem_mark=mark)
        if self._nodes > MOST_NODES:
            raise yaml.MarkedYAMLError(problem=f"more than {MOST_NODES} values", problem_mark=mark)
        node = super().compose_node(parent, index)
        self._depth -= 1
        return node

    def compose_mapping_node(self, anchor: Any) -> Any:
        node = super().compose_mapping_node(anchor)
        seen = set()
        for key_node, _ in node.value:
            if not isinstance(key_node, yaml.ScalarNode):
                raise _Refused(key_node, _text_of(key_node), "keys that are texts or numbers")
            merges = key_node.tag == "tag:yaml.org,2002:merge"
            key = (key_node.value,) if merges else self.construct_object(key_node)
            if key in seen:
                raise _Refused(key_node, f"{checks.shown(key_node.value)} once more", "every key once in a mapping")
            seen.add(key)
        return node

    def get_single_node(self) -> Any:
        node = super().get_single_node()
        if node is not None:
            _check_size(node, {}, set())
        return node

    def construct_object(self, node: Any, deep: bool = False) -> Any:
        try:
            value = super().construct_object(node, deep)
        except (yaml.YAMLError, _Refused):
            raise
        except Exception as error:
            # Constructors trust their patterns: there is a 31st of February, and !!int of nothing.
            kind = str(node.tag).rpartition(":")[2]
            raise _Refused(node, _text_of(node), f"a value of type {kind} ({error})") from None
        if isinstance(value, str) and UNFIT.search(value):
            raise _Refused(node, value, "text without control characters and lone surrogates")
        if isinstance(value, int) and abs(value) >= 2**1024:
            raise _Refused(node, _text_of(node), "numbers below 2^1024")
        return value


def _text_of(node: Any) -> str:
    return node.value if isinstance(node, yaml.ScalarNode) else f"a {node.tag.rpartition(':')[2]}"


def _check_size(node: Any, sizes: dict[int, tuple[int, int]], above: set[int]) -> tuple[int, int]:
    """How many nodes a node stands for, with every alias written out, and how deep they are nested."""
    if id(node) in above:
        raise _Refused(node, "an anchor that contains itself", "values that end")
    if id(node) not in sizes:
        above.add(id(node))
        total = depth = 1
        for each in node.value if isinstance(node, yaml.CollectionNode) else ():
            for one in each if isinstance(each, tuple) else (each,):
                more, below = _check_size(one, sizes, above)
                total, depth = total + more, max(depth, below + 1)
                if total > MOST_NODES or depth > DEEPEST + 1:
                    got = f"{total} values and {depth} levels, aliases written out"
                    raise _Refused(
                        one if len(above) == 1 else node, got, f"at most {MOST_NODES} values and {DEEPEST} levels"
                    )
        above.remove(id(node))
        sizes[id(node)] = total, depth
    return sizes[id(node)]
