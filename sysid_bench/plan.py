"""study -> tasks and cells: the grid, its seeds and its keys. Pure: reads and writes nothing."""

# Configs are values of any type.
# pyright: reportUnknownArgumentType=false, reportUnknownMemberType=false, reportUnknownVariableType=false

from __future__ import annotations

import copy
import hashlib
import itertools
import json
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from sysid_bench.nouns import Cell, InputError, Task
from sysid_bench.versions import code_version

MOST_CELLS = 10**7  # of one study: more is a slip of the pen, and its plan would fill the memory
SCHEMA = 1  # of a row; raise it when the meaning of a column changes
RECORD_GROUPS = ("plant", "excitation", "noise", "sampling", "source")
SEEDING_GROUPS = ("plant", "excitation", "noise", "source")
KINDS = {"identify": (RECORD_GROUPS, "method"), "analysis": (("plant", "sampling"), "analysis")}


@dataclass(frozen=True)
class Option:
    """One option of a config group: its name and its resolved node."""

    name: str
    node: Mapping[str, Any]


@dataclass(frozen=True)
class Study:
    """A question and its grid, resolved: nothing is looked up after this.

    base     group -> the option where no axis says otherwise
    options  (group, name) -> option, all that axes and cases name
    axes     key -> values; a key is a group ("method") or a knob ("sampling.h_s")
    cases    points of one more axis, each setting several keys
    only     key -> value (as text): the part of the grid that is wanted
    """

    name: str
    question: str
    kind: str
    repetitions: int
    seed: int
    base: Mapping[str, Option]
    options: Mapping[tuple[str, str], Option]
    axes: Mapping[str, Sequence[Any]]
    cases: Sequence[Mapping[str, Any]] = ()
    only: Mapping[str, str] = field(default_factory=dict[str, str])
    packages: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        if self.kind not in KINDS:
            raise InputError(f"study.kind must be one of {', '.join(KINDS)}; got {self.kind!r}.")
        if self.repetitions < 1:
            raise InputError(f"study.repetitions must be at least 1; got {self.repetitions}.")
        for key, values in self.axes.items():
            if not isinstance(values, (list, tuple)) or not values:
                raise InputError(f"axes.{key} must be a list of at least one value; got {values!r}.")
        cells = self.repetitions * max(1, len(self.cases)) * math.prod(map(len, self.axes.values()))
        if cells > MOST_CELLS:
            raise InputError(
                f"the grid has {cells:.3g} cells; one study takes at most {MOST_CELLS:.0e}. Split it."
            )


def tasks(study: Study) -> Iterator[Task]:
    """The grid of a study, record by record, in the order of its axes; repetitions innermost."""
    groups, solver_group = KINDS[study.kind]
    for group in (*groups, solver_group):
        named = group in study.base or group in study.axes
        if not named and not all(group in case for case in study.cases or ({},)):
            raise InputError(f"a study of kind {study.kind} needs {group}=...")
    for point, solver_points in _points(study, solver_group):
        chosen = _choose(study, point, groups)
        solvers = [(_choose(study, p, (solver_group,))[solver_group], p) for p in solver_points]
        for repetition in range(study.repetitions):
            task = _task(study, chosen, point, solvers, repetition)
            if task.cells:
                yield task


def _points(study: Study, solver_group: str) -> list[tuple[dict[str, Any], list[dict[str, Any]]]]:
    """Points of the grid that decide a record, each with the points of its solvers: cases that differ only in
    the solver share their records."""
    found: dict[str, tuple[dict[str, Any], list[dict[str, Any]]]] = {}
    for case in study.cases or ({},):
        for values in itertools.product(*study.axes.values()):
            point = {**case, **dict(zip(study.axes, values))}
            solver = {k: v for k, v in point.items() if k.split(".")[0] == solver_group}
            record = {k: v for k, v in point.items() if k not in solver}
            found.setdefault(text_of(record), (record, []))[1].append(solver)
    return list(found.values())


def _choose(study: Study, point: Mapping[str, Any], groups: Sequence[str]) -> dict[str, Option]:
    """The options of a grid point: group keys choose, dotted keys then set knobs."""
    chosen = {g: study.base[g] for g in groups if g in study.base}
    for key, value in point.items():
        if "." not in key:
            chosen[key] = study.options[key, value]
    for key, value in point.items():
        if "." in key:
            group, path = key.split(".", 1)
            if group not in chosen:
                raise InputError(f"axis {key}: no group {group!r} in this study; it has {', '.join(chosen)}.")
            chosen[group] = Option(chosen[group].name, with_knob(chosen[group], group, path, value))
    return chosen


def with_knob(option: Option, group: str, path: str, value: Any) -> dict[str, Any]:
    """The option's node with one knob set. Raises InputError for a knob that is not written in its yaml."""
    node = copy.deepcopy(dict(option.node))
    inner: Any = node
    *parents, last = path.split(".")
    for name in parents:
        inner = inner.get(name) if isinstance(inner, dict) else None
    if not isinstance(inner, dict) or last not in inner:
        known = [k for k in option.node if k != "_target_"]
        raise InputError(f"{group}={option.name} has no knob {path!r}; it has {', '.join(known) or 'none'}.")
    inner[last] = value
    return node


def _task(
    study: Study,
    chosen: Mapping[str, Option],
    point: Mapping[str, Any],
    solvers: Sequence[tuple[Option, dict[str, Any]]],
    repetition: int,
) -> Task:
    parts = {group: text_of(option.node) for group, option in chosen.items()}
    labels = {group: option.name for group, option in chosen.items() if group != "sampling"}
    labels |= {key: value for key, value in point.items() if "." in key}
    sampling = chosen["sampling"].node
    labels |= {f"sampling.{key}": _as(kind, sampling[key], key) for key, kind in (("h_s", float), ("N", int))}
    if "snr_db" in chosen.get("noise", Option("", {})).node:
        labels |= {"noise.snr_db": _label(chosen["noise"].node["snr_db"])}
    seed = seed_of(study.seed, labels, repetition)
    record_key = digest(SCHEMA, parts, seed, [_code(option) for option in chosen.values()])
    cells = tuple(
        cell
        for option, solver_point in solvers
        if _wanted(
            study.only, (cell := _cell(study, option, solver_point, labels, record_key, repetition)).labels
        )
    )
    return Task(
        study.name, study.kind, parts, seed, repetition, labels, cells, record_key, study.packages
    )  # fmt: skip


def _as(kind: type, value: Any, key: str) -> Any:
    try:
        return kind(value)
    except (TypeError, ValueError, OverflowError):
        raise InputError(f"sampling.{key} must be a number; got {value!r:.60}.") from None


def _cell(
    study: Study,
    option: Option,
    point: Mapping[str, Any],
    labels: Mapping[str, Any],
    record_key: str,
    repetition: int,
) -> Cell:
    solver = text_of(option.node)
    group = KINDS[study.kind][1]
    own = {group: option.name} | {key: _label(value) for key, value in point.items() if "." in key}
    judge = code_version("sysid_bench.run")
    key = digest(record_key, solver, _code(option), judge)
    return Cell(key, solver, {**labels, **own, "repetition": repetition})


def _label(value: Any) -> Any:
    """A table cell must be one number or word: lists become text."""
    return value if isinstance(value, (int, float, str, bool)) or value is None else json.dumps(value)


def _wanted(only: Mapping[str, str], labels: Mapping[str, Any]) -> bool:
    return all(_same(labels.get(key), value) for key, value in only.items())


def _same(label: Any, text: str) -> bool:
    if isinstance(label, (int, float)) and not isinstance(label, bool):
        try:
            return float(text) == float(label)
        except ValueError:
            return False
    return str(label) == text


def command(experiment: str, cell_labels: Mapping[str, Any], axes: Sequence[str]) -> str:
    """The command line that reproduces one cell."""
    part = " ".join(f"{key}={cell_labels[key]}" for key in (*axes, "repetition") if key in cell_labels)
    return f"sysid-bench sweep experiment={experiment} 'only={part}'"


def seed_of(root: int, labels: Mapping[str, Any], repetition: int) -> int:
    """One seed per (plant, excitation, noise, source, sampling, repetition): the same for every method."""
    wanted = {k: v for k, v in labels.items() if k in SEEDING_GROUPS or k.startswith("sampling.")}
    return int(digest(root, wanted, repetition)[:15], 16)


def text_of(node: Mapping[str, Any]) -> str:
    return json.dumps(node, sort_keys=True, separators=(",", ":"))


def digest(*parts: Any) -> str:
    """Hash of resolved content, never of key order."""
    return hashlib.sha256(json.dumps(parts, sort_keys=True).encode()).hexdigest()[:32]


def _code(option: Option) -> list[str]:
    """Versions of the code behind every `_target_` of a node."""
    return sorted(code_version(target.rpartition(".")[0]) for target in _targets(option.node))


def _targets(node: Any) -> Iterator[str]:
    if isinstance(node, Mapping):
        if "_target_" in node:
            yield str(node["_target_"])
        for value in node.values():
            yield from _targets(value)
    elif isinstance(node, (list, tuple)):
        for value in node:
            yield from _targets(value)
