"""a verb and the words after it -> what it does, its knobs, its options and theirs. Text is that of conf/, with its comments."""

from __future__ import annotations

import textwrap
from collections.abc import Mapping, Sequence

from sysid_bench import conf
from sysid_bench.completion import groups_of, read, read_text
from sysid_bench.nouns import InputError

WIDTH = 140


def menu() -> str:
    """Every verb with one line and one example."""
    lines = [
        "sysid-bench VERB [key=value ...]      second-order mechanical systems, identified from sampled data",
        "",
    ]
    for verb, (what, example) in conf.verbs().items():
        lines += [f"  {verb:<10} {what}", f"  {'':<10} $ {example}"]
    return "\n".join([*lines, "", FOOT])


FOOT = """\
sysid-bench VERB --help           every knob of a verb, its options, and the knobs of those that it takes by default
sysid-bench VERB plant=X --help   the knobs of another option, with units and values
sysid-bench VERB ... --cfg        the resolved config, without running it
source <(sysid-bench --completion)   in bash or zsh: Tab completes verbs, options and knobs"""


def of_verb(verb: str, words: Sequence[str]) -> str:
    """The verb's config with its comments; its options; the knobs of the options in `words` in full, of the others by name.

    Raises InputError for an option that does not exist.
    """
    overrides, plugins = conf.split_plugins([word for word in words if "=" in word])
    options = conf.groups(plugins)
    defaults = groups_of(read(f"{verb}.yaml", plugins))
    asked = dict(word.split("=", 1) for word in overrides if word.split("=")[0] in defaults)
    for group, name in asked.items():
        if name not in options.get(group, []):
            raise InputError(f"{group}={name}: no such option. {group} has: {', '.join(options[group])}.")
    if asked:
        return "\n\n".join(_in_full(group, name, plugins) for group, name in asked.items())
    own = (conf.home().conf / f"{verb}.yaml").read_text().rstrip()
    return "\n".join([own, *_options(verb, defaults, options, plugins)])


def _in_full(group: str, name: str, plugins: conf.Plugins) -> str:
    """One option's yaml as it is set from a command line: group.knob."""
    found = read_text(f"{group}/{name}.yaml", plugins).rstrip().splitlines()
    shown = [line for line in found if not line.startswith("_target_")]
    return "\n".join(
        [f"{group}={name}, its knobs as {group}.KNOB=VALUE:", "", *(f"  {line}" for line in shown)]
    )


def _options(
    verb: str, defaults: Mapping[str, str], options: Mapping[str, Sequence[str]], plugins: conf.Plugins
) -> list[str]:
    lines = ["", "options:"] if defaults else []
    for group, default in defaults.items():
        lines += _row(f"{group}=", options[group])
        knobs = [f"{group}.{knob}" for knob in read(f"{group}/{default}.yaml", plugins) if knob != "_target_"]
        if knobs:
            lines += _row("", [f"{default} has {knobs[0]}", *knobs[1:]])
    if verb == "sweep":
        lines += _row("experiment=", conf.studies(plugins))
    if defaults:
        group = next(iter(defaults))
        lines += ["", f"Knobs with units and values: sysid-bench {verb} {group}={options[group][0]} --help"]
    return lines


def _row(head: str, names: Sequence[str]) -> list[str]:
    indent = " " * 16
    return textwrap.wrap(", ".join(names), WIDTH, initial_indent=f"  {head:<14}", subsequent_indent=indent)
