"""the words of a command line so far -> what the last one may become. Reads conf/ only, so that Tab stays quick."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import yaml

from sysid_bench import conf

BASH = """\
# bash: source <(sysid-bench --completion)        zsh: autoload -U bashcompinit && bashcompinit, then the same line
_sysid_bench() {
    local line="${COMP_LINE:0:COMP_POINT}" word value
    word="${line##* }"; value="${word#*=}"
    mapfile -t COMPREPLY < <(sysid-bench --complete "$line" 2>/dev/null)
    if [[ ${#COMPREPLY[@]} -eq 0 && "$word" == *=* ]]; then
        compopt -o filenames 2>/dev/null; mapfile -t COMPREPLY < <(compgen -f -- "$value"); return
    fi
    [[ "$word" == *=* && "$COMP_WORDBREAKS" == *=* ]] && COMPREPLY=("${COMPREPLY[@]#"${word%=*}="}")
    [[ ${#COMPREPLY[@]} -eq 1 && "${COMPREPLY[0]}" != *= ]] || compopt -o nospace 2>/dev/null
}
complete -F _sysid_bench sysid-bench
"""


def candidates(line: str) -> list[str]:
    """Whole words that the line's last word may become; none where it is a file's or a number's turn."""
    _, *words = line.split(" ")
    *before, last = words or [""]
    before = [word for word in before if word]
    if not before:
        return [verb for verb in conf.verbs() if verb.startswith(last)]
    _, plugins = conf.split_plugins(before)
    options = conf.groups(plugins)
    key, equals, value = last.partition("=")
    if not equals:
        return sorted({k for k in keys(before, options, plugins) if k.startswith(last)})
    names = conf.studies(plugins) if key == "experiment" else options.get(key, [])
    return [f"{key}={name}" for name in names if name.startswith(value)]


def keys(words: Sequence[str], options: Mapping[str, Sequence[str]], plugins: conf.Plugins) -> Iterator[str]:
    """`key=` of a verb: its own, its groups, and the knobs of the chosen options."""
    config = read(f"{words[0]}.yaml", plugins)
    yield from ("plugins=", "--help", "--cfg")
    chosen = dict(word.split("=", 1) for word in words[1:] if "=" in word)
    for group, default in groups_of(config).items():
        yield f"{group}="
        yield from (
            f"{group}.{knob}="
            for knob in read(f"{group}/{chosen.get(group, default)}.yaml", plugins)
            if knob != "_target_"
        )
    for key, value in config.items():
        if key != "defaults":
            inner = value if isinstance(value, dict) and key not in options else {}
            yield f"{key}="
            yield from (f"{key}.{name}=" for name in inner)
    if words[0] == "sweep":
        yield "experiment="


def groups_of(config: Mapping[str, Any]) -> dict[str, str]:
    """group -> default option, of a verb's config."""
    entries = [entry for entry in config.get("defaults") or [] if isinstance(entry, dict)]
    return {key.removeprefix("/"): str(value) for entry in entries for key, value in entry.items()}


def read(name: str, plugins: conf.Plugins) -> dict[str, Any]:
    """A yaml of conf/, the user's own first; empty where there is none."""
    return yaml.safe_load(read_text(name, plugins)) or {}


def read_text(name: str, plugins: conf.Plugins) -> str:
    """Its text."""
    roots = [*(folder / "conf" for folder in plugins.folders), conf.home().conf]
    return next(((root / name).read_text() for root in roots if (root / name).is_file()), "")
