"""composed config -> Study: every option that axes and cases name, looked up once."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import yaml

from sysid_bench import conf
from sysid_bench.knobs import check_knobs
from sysid_bench.nouns import InputError
from sysid_bench.plan import Option, Study, with_knob

GROUPS = ("plant", "excitation", "noise", "sampling", "source", "method", "analysis")


def study_of(cfg: Mapping[str, Any], overrides: Mapping[str, Any] = {}) -> Study:
    """The study that a composed sweep config describes.

    `overrides`: dotted keys that the command line set; they hold for swept options too, where these have the
    knob. Raises InputError for unknown options and knobs.
    """
    plugins = cfg.get("plugins") or conf.Plugins()
    _check_shapes(cfg)
    cfg = _at_scale(cfg)
    cfg["axes"] = {key: _listed(key, values, plugins) for key, values in cfg["axes"].items()}
    base = {g: Option(cfg["choices"].get(g) or g, cfg[g]) for g in GROUPS if cfg.get(g) is not None}
    points = [
        *cfg["cases"],
        *({key: value} for key, values in cfg["axes"].items() for value in values),
    ]
    names = {(key, value) for point in points for key, value in point.items() if "." not in key}
    options = {(g, name): _option(g, name, base, overrides, plugins) for g, name in sorted(names)}
    study = cfg["study"]
    check_knobs(Study, study)
    return Study(
        name=study["name"], question=study["question"], kind=study["kind"], repetitions=study["repetitions"],
        seed=study["seed"], base=base, options=options, axes=cfg["axes"], cases=cfg["cases"],
        only=_pairs(cfg.get("only")), packages=plugins.packages,
    )  # fmt: skip


def _check_shapes(cfg: Mapping[str, Any]) -> None:
    """Raises InputError where a part of the study is not the mapping or list that it must be."""
    for key in ("study", "axes", "full"):
        if not isinstance(cfg[key], Mapping):
            raise InputError(f"{key} must be a mapping, key: value; got {cfg[key]!r:.60}.")
    cases = cfg["cases"] or []
    if not isinstance(cases, list) or not all(isinstance(case, Mapping) for case in cases):
        raise InputError(f"cases must be a list of mappings, each setting some keys; got {cases!r:.60}.")


def command_line_knobs(overrides: Iterable[str]) -> dict[str, Any]:
    """`group.knob=value` among the words of a command line, values read as YAML."""
    found = {}
    for word in overrides:
        key, _, value = word.partition("=")
        if key.split(".")[0] in GROUPS and "." in key:
            found[key] = yaml.safe_load(value)
    return found


def _listed(key: str, values: Any, plugins: conf.Plugins) -> Sequence[Any]:
    if values == "all" and key in GROUPS:
        return conf.groups(plugins).get(key, [])
    if not isinstance(values, list):
        raise InputError(f"axes.{key} must be a list (or, for a group, the word all); got {values!r}.")
    return values


def _option(
    group: str, name: str, base: Mapping[str, Option], overrides: Mapping[str, Any], plugins: conf.Plugins
) -> Option:
    if group not in GROUPS:
        raise InputError(f"{group!r} is not a group that a study can sweep; it can: {', '.join(GROUPS)}.")
    if group in base and base[group].name == name:
        return base[group]
    option = Option(name, conf.option(group, name, plugins))
    for key, value in overrides.items():
        head, _, path = key.partition(".")
        if head == group and path.split(".")[0] in option.node:
            option = Option(name, with_knob(option, group, path, value))
    return option


def _at_scale(cfg: Mapping[str, Any]) -> dict[str, Any]:
    """scale=full: the study's `full` keys replace the normal ones."""
    scale = cfg.get("scale", "normal")
    if scale not in ("normal", "full"):
        raise InputError(f"scale must be normal or full; got {scale!r}.")
    changed = {
        **cfg,
        "study": dict(cfg["study"]),
        "axes": _flat(cfg["axes"]),
        "cases": list(cfg["cases"] or []),
    }
    for key, value in cfg["full"].items() if scale == "full" else ():
        head, _, rest = key.partition(".")
        if head not in ("study", "axes"):
            raise InputError(f"full.{key}: only study.* and axes.* keys can change with the scale.")
        changed[head][rest] = value
    return changed


def _flat(axes: Mapping[str, Any]) -> dict[str, Any]:
    """Axes by dotted key; a command line's axes.sampling.h_s=[...] comes as nested mappings."""
    found: dict[str, Any] = {}
    for key, value in axes.items():
        parts = (
            {f"{key}.{k}": v for k, v in _flat(value).items()} if isinstance(value, Mapping) else {key: value}
        )
        found |= parts
    return found


def _pairs(text: str | None) -> dict[str, str]:
    pairs = {}
    for word in (text or "").split():
        key, equals, value = word.partition("=")
        if not equals:
            raise InputError(f"only={text!r}: wanted words KEY=VALUE; got {word!r}.")
        pairs[key] = value
    return pairs
