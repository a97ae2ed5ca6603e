"""YAML text -> plain values: numbers, words, lists, mappings; no tags, no aliases, no key twice."""

# json and yaml hand over values of any type.
# pyright: reportUnknownArgumentType=false, reportUnknownMemberType=false, reportUnknownVariableType=false

from __future__ import annotations

import os
import re
from typing import Any

import yaml

from sysid_bench.files.disk import plain, read_text
from sysid_bench.nouns import InputError

MAX_DEPTH = 20
MAX_ITEMS = 200_000
_Safe: Any = getattr(yaml, "CSafeLoader", yaml.SafeLoader)  # libyaml where it is there: ten times faster


class _Loader(_Safe):
    """PyYAML's safe loader that also takes 1e-3 for a number (YAML 1.1 wants 1.0e-3)."""


_Loader.add_implicit_resolver(
    "tag:yaml.org,2002:float", re.compile(r"^[-+]?(\d+\.?\d*|\.\d+)[eE][-+]?\d+$"), list("-+.0123456789")
)


def read_yaml(path: str | os.PathLike[str], what: str) -> tuple[dict[str, Any], dict[str, int]]:
    """(mapping, line of each top-level key) of a YAML file.

    Raises InputError with the line: not YAML, not a mapping, a tag, an alias, a key given twice, or too deep.
    """
    text = read_text(path, what)
    try:
        _check_events(text, f"{what} {path}")
        loader = _Loader(text)
        try:
            node = loader.get_single_node()
            _check_keys(node, f"{what} {path}")
            value = loader.construct_document(node) if node is not None else None
        finally:
            loader.dispose()
    except yaml.MarkedYAMLError as problem:
        mark = problem.problem_mark or problem.context_mark
        where = f"line {mark.line + 1}, column {mark.column + 1}" if mark else "unknown line"
        raise InputError(f"{what} {path}, {where}: not YAML that is read here: {problem.problem}.") from None
    except (yaml.YAMLError, ValueError, OverflowError, RecursionError) as problem:
        if isinstance(problem, InputError):
            raise
        reason = str(problem).splitlines()[0] if str(problem) else type(problem).__name__
        raise InputError(f"{what} {path}: not YAML that is read here: {reason[:160]}.") from None
    if not isinstance(value, dict):
        raise InputError(f"{what} {path}: a mapping `key: value` is wanted; got {type(value).__name__}.")
    return value, {key.value: key.start_mark.line + 1 for key, _ in (node.value if node else ())}


def _check_events(text: str, where: str) -> None:
    """Refuse what could run code or blow up, before anything is built."""
    depth = items = 0
    for event in yaml.parse(text, Loader=_Safe):
        items += 1
        line = f"{where}, line {event.start_mark.line + 1}"
        if isinstance(event, yaml.AliasEvent):
            raise InputError(f"{line}: aliases (*{event.anchor}) are not read; write the value out.")
        if getattr(event, "tag", None) is not None:
            raise InputError(f"{line}: tags ({event.tag[:60]}) are not read; write plain values.")
        if isinstance(event, yaml.CollectionStartEvent):
            depth += 1
        elif isinstance(event, yaml.CollectionEndEvent):
            depth -= 1
        if depth > MAX_DEPTH or items > MAX_ITEMS:
            raise InputError(f"{line}: deeper than {MAX_DEPTH} levels or more than {MAX_ITEMS:,} values.")


def _check_keys(node: yaml.Node | None, where: str) -> None:
    """Refuse keys that are no words and keys that stand twice in one mapping."""
    if isinstance(node, yaml.SequenceNode):
        for item in node.value:
            _check_keys(item, where)
    if isinstance(node, yaml.MappingNode):
        seen: set[str] = set()
        for key, value in node.value:
            line = f"{where}, line {key.start_mark.line + 1}"
            if not isinstance(key, yaml.ScalarNode):
                raise InputError(f"{line}: a key must be a word.")
            if key.value in seen:
                raise InputError(f"{line}: key {key.value!r} is given twice.")
            seen.add(key.value)
            _check_keys(value, where)


def yaml_text(value: Any) -> str:
    """Readable YAML of any value: innermost lists and mappings stay on one line."""
    return yaml.safe_dump(
        plain(value), default_flow_style=None, sort_keys=False, width=100_000, allow_unicode=True
    )
