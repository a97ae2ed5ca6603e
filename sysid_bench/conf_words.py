"""what Hydra says of a wrong call -> one message: what came, what there is, the way out."""

from __future__ import annotations

import difflib
import re
from collections.abc import Mapping, Sequence
from typing import Any

SKIPPED = (
    "Config search path",
    "provider=",
    "set env",
    "full_key:",
    "object_type=",
    "To append",
    "You might want",
)


def one_message(
    verb: str, problem: Exception, known: Mapping[str, Any] | None, options: Mapping[str, Sequence[str]]
) -> str:
    """`known`: the verb's config without the wrong words, where there is one; `options`: group -> its options."""
    lines = [line.strip() for line in str(problem).splitlines() if line.strip()]
    words = " ".join(line for line in lines if not line.startswith(SKIPPED))
    help_ = f"See `sysid-bench {verb} --help`."
    if found := re.search(r"Missing mandatory value: (\S+)", words):
        return f"{verb} needs {found[1]}=...; see `sysid-bench {verb} --help`."
    if found := re.search(r"Could not find '([\w/]+)/([^'/]+)'", words):
        group, option = found[1].removeprefix("/"), found[2]
        if group in options:
            return f"{group}={option}: no such option{_like(option, options[group])} {group} has: {', '.join(options[group])}."
    if found := re.search(r"Could not override '([^']+)'|Key '([^']+)' is not in struct", words):
        key = found[1] or found[2]
        if known is None:
            return f"{verb}: there is no {key} to be set, or not without the option that has it. {help_}"
        return f"{_unknown(verb, key, known)} {help_}"
    return f"{verb}: {words.rstrip('.')}. {help_}"


def _unknown(verb: str, key: str, known: Mapping[str, Any]) -> str:
    """The first part of a dotted key that the config does not have, and what stands there."""
    *parents, _ = key.split(".")
    place: Any = known
    walked: list[str] = []
    for part in parents:
        if not isinstance(place, Mapping) or not isinstance(place.get(part), Mapping):
            break
        place, walked = place[part], [*walked, part]
    names = [k for k in place if k not in ("_target_", "choices")] if isinstance(place, Mapping) else []
    owner = _owner(verb, walked, known)
    missing = ".".join(key.split(".")[len(walked) :])
    said = f"{', '.join(names)}" if names else "none"
    return f"{key}: {owner} has no {missing!r}{_like(missing, names)} It has: {said}."


def _owner(verb: str, walked: Sequence[str], known: Mapping[str, Any]) -> str:
    choice = known.get("choices", {}).get(walked[0]) if len(walked) == 1 else None
    return f"{walked[0]}={choice}" if choice else ".".join(walked) or verb


def _like(wrong: str, names: Sequence[str]) -> str:
    near = difflib.get_close_matches(wrong, names, n=1)
    return f"; did you mean {near[0]}?" if near else "."
