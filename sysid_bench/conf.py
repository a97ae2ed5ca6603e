"""verb and overrides -> plain config. With __main__ the only file that knows Hydra."""

from __future__ import annotations

import importlib.util
import re
import sys
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

from sysid_bench.conf_kinds import check_kinds
from sysid_bench.conf_words import one_message
from sysid_bench.nouns import InputError

PACKAGE = Path(__file__).resolve().parent
REPOSITORY = PACKAGE.parent
# Files and free text: handed over as written, never parsed by Hydra's grammar (commas, =, spaces).
VERBATIM = frozenset(
    "record records_dir model train test out estimate to path results_dir reference only plugins "
    "effects_path dbc report screenshot truth".split()
)


# Groups whose option may be a file of the user's: what `gap` writes as experiment.yaml.
NODE_GROUPS = frozenset({"excitation"})


@dataclass(frozen=True)
class Home:
    """Where configs and studies are read from: the repository, or the installed package's copies."""

    conf: Path
    experiments: Path


def home() -> Home:
    root = REPOSITORY if (REPOSITORY / "conf" / "sweep.yaml").is_file() else PACKAGE / "shipped"
    return Home(root / "conf", root / "experiments")


@dataclass(frozen=True)
class Plugins:
    """Folders of the user's own options: `DIR/conf/...` and the packages in DIR, named explicitly."""

    folders: tuple[Path, ...] = ()
    packages: tuple[str, ...] = ()

    @classmethod
    def named(cls, text: str | None) -> Plugins:
        """`text`: folders or installed packages, separated by commas. Raises InputError for what is neither."""
        folders, packages = [], []
        for name in filter(None, (text or "").split(",")):
            folder, found = _plugin(name.strip())
            folders.append(folder)
            packages.extend(found)
        return cls(tuple(folders), tuple(packages))


def _plugin(name: str) -> tuple[Path, list[str]]:
    folder = Path(name).expanduser()
    if folder.is_dir():
        folder = folder.resolve()
        if str(folder) not in sys.path:
            sys.path.insert(0, str(folder))
        return folder, sorted(p.parent.name for p in folder.glob("*/__init__.py"))
    spec = importlib.util.find_spec(name) if re.fullmatch(r"\w+", name) else None
    if spec is None or not spec.submodule_search_locations:
        raise InputError(f"plugins={name}: wanted a folder or an installed package; there is neither.")
    return Path(spec.submodule_search_locations[0]), [name]


def verbs() -> dict[str, tuple[str, str]]:
    """verb -> (one line, example), from the first two comment lines of conf/<verb>.yaml."""
    found = {}
    for path in sorted(home().conf.glob("*.yaml")):
        lines = [line[1:].strip() for line in path.read_text().splitlines() if line.startswith("#")]
        if len(lines) >= 2:
            found[path.stem] = (lines[0], lines[1])
    return found


def groups(plugins: Plugins = Plugins()) -> dict[str, list[str]]:
    """group -> option names, over the suite's conf/ and those of the plugins."""
    found: dict[str, set[str]] = {}
    for root in (home().conf, *(f / "conf" for f in plugins.folders)):
        for path in root.glob("*/**/*.yaml"):
            relative = path.relative_to(root)
            found.setdefault(relative.parts[0], set()).add(
                relative.with_suffix("").as_posix().split("/", 1)[1]
            )
    return {group: sorted(options) for group, options in sorted(found.items())}


def studies(plugins: Plugins = Plugins()) -> list[str]:
    """Names that `experiment=` takes."""
    roots = [home().experiments, *(f / "experiments" for f in plugins.folders)]
    return sorted(p.relative_to(r).with_suffix("").as_posix() for r in roots for p in r.glob("**/*.yaml"))


def split_plugins(overrides: Sequence[str]) -> tuple[list[str], Plugins]:
    """Take `plugins=...` out of the overrides."""
    texts = [o.split("=", 1)[1] for o in overrides if o.startswith("plugins=")]
    return [o for o in overrides if not o.startswith("plugins=")], Plugins.named(",".join(texts))


def compose(verb: str, overrides: Sequence[str] = (), plugins: Plugins = Plugins()) -> dict[str, Any]:
    """The resolved config of a verb as plain dicts, lists, numbers and strings.

    `choices` says which option each group has.
    Raises InputError with Hydra's own words made into one message.
    """
    files = {k: v for k, _, v in (text.partition("=") for text in overrides) if _is_node_file(k, v)}
    wanted = [_override(verb, text, plugins) for text in overrides if text.partition("=")[0] not in files]
    cfg = _composed(verb, wanted, plugins)
    for group, path in files.items():
        cfg[group], cfg["choices"][group] = _node(path), path
    check_kinds(cfg, _own_file(verb))
    return cfg


@lru_cache(maxsize=32)
def _own_file(verb: str) -> dict[str, Any]:
    """What conf/<verb>.yaml itself says."""
    import yaml

    return yaml.safe_load((home().conf / f"{verb}.yaml").read_text())


def _is_node_file(key: str, value: str) -> bool:
    """True where a group is given a file in place of an option: excitation=gap/experiment.yaml."""
    return key in NODE_GROUPS and value.endswith((".yaml", ".yml"))


def _node(path: str) -> dict[str, Any]:
    """The node that a file holds: `_target_` and knobs, as a file of conf/<group>/ does. Raises InputError."""
    from sysid_bench.files.yaml_text import read_yaml

    node, _ = read_yaml(path, "option")
    if not isinstance(node.get("_target_"), str):
        raise InputError(
            f"{path}: wanted an option's file with _target_: sysid_bench.<shelf>.<file>.<Class>."
        )
    return dict(node)


def option(group: str, name: str, plugins: Plugins = Plugins()) -> dict[str, Any]:
    """The resolved node of one option of one group, e.g. option("method", "arx")."""
    known = groups(plugins).get(group, [])
    if name not in known:
        raise InputError(f"{group}={name}: no such option. {group} has: {', '.join(known) or 'none'}.")
    return _composed(None, [f"+{group}={name}"], plugins)[group]


def _override(verb: str, text: str, plugins: Plugins) -> str:
    key, equals, value = text.partition("=")
    if not equals:
        raise InputError(f"{text!r} is not an override; wanted KEY=VALUE, for instance noise.snr_db=15.")
    if key == "experiment":
        if value.removesuffix(".yaml") not in studies(plugins):
            raise InputError(f"experiment={value}: no such study. There are: {', '.join(studies(plugins))}.")
        return f"+experiments={value.removesuffix('.yaml')}" if verb == "sweep" else text
    if value.strip() == "[]" and key in groups(plugins):
        raise InputError(f"{key}=[]: one option is wanted. {key} has: {', '.join(groups(plugins)[key])}.")
    if key.lstrip("+") in VERBATIM and value not in ("null", ""):
        escaped = value.replace("\\", "\\\\").replace('"', '\\"').replace("${", "\\${")
        return f'{key}="{escaped}"'
    return f"++{text}" if key.startswith("axes.") else text


def _composed(
    name: str | None, overrides: Iterable[str], plugins: Plugins, complete: bool = True
) -> dict[str, Any]:
    from hydra import compose as hydra_compose
    from hydra import initialize_config_dir
    from hydra.errors import HydraException
    from omegaconf import OmegaConf, open_dict
    from omegaconf.errors import OmegaConfBaseException
    from yaml import YAMLError

    where = home()
    overrides = list(overrides)
    own = [f / "conf" for f in plugins.folders if (f / "conf").is_dir()]
    roots = [*own, *_study_roots(overrides, plugins)]
    searchpath = "hydra.searchpath=[" + ",".join(f'"file://{r}"' for r in roots) + "]"
    try:
        with initialize_config_dir(version_base="1.3", config_dir=str(where.conf)):
            cfg = hydra_compose(name, overrides=[searchpath, *overrides], return_hydra_config=True)
            choices: Any = OmegaConf.to_container(cfg.hydra.runtime.choices)
            with open_dict(cfg):
                del cfg["hydra"]
            plain: Any = OmegaConf.to_container(cfg, resolve=True, throw_on_missing=complete)
    except (HydraException, OmegaConfBaseException, YAMLError, ValueError, TypeError, KeyError) as problem:
        known = _known(name, overrides, plugins) if complete else None
        raise InputError(one_message(name or "option", problem, known, groups(plugins))) from None
    assert isinstance(plain, dict) and isinstance(choices, dict)
    chosen = {group: name for group, name in choices.items() if not group.startswith("hydra/")}
    return {**plain, "choices": chosen}


def _study_roots(overrides: Iterable[str], plugins: Plugins) -> list[Path]:
    """Folders that hold the study asked for. No others: Hydra takes every folder in them for a group."""
    names = [o.removeprefix("+experiments=") for o in overrides if o.startswith("+experiments=")]
    roots = (home().experiments.parent, *plugins.folders)
    return [r for r in roots for name in names if (r / "experiments" / f"{name}.yaml").is_file()]


def _known(name: str | None, overrides: Iterable[str], plugins: Plugins) -> dict[str, Any] | None:
    """The config with none of the overrides but the choices of options: what there was to be set."""
    available = groups(plugins)
    kept = [o for o in overrides if o.partition("=")[2] in available.get(o.partition("=")[0], [])]
    try:
        return _composed(name, kept, plugins, complete=False) if kept != list(overrides) else None
    except InputError:
        return None
