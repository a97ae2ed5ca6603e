"""a verb and the words after it -> what it does, its knobs, its options and theirs. Text is that of conf/, with its comments."""

from __future__ import annotations

import re
import shutil
import textwrap
from collections.abc import Mapping, Sequence

from sysid_bench import conf
from sysid_bench.completion import groups_of, read, read_text
from sysid_bench.nouns import InputError

WIDEST = 120


def menu() -> str:
    """Every verb with one line and one example."""
    lines = [
        *_column(
            "sysid-bench VERB [key=value ...]",
            37,
            "second-order mechanical systems, identified from sampled data",
        ),
        "",
    ]
    for verb, (what, example) in conf.verbs().items():
        lines += [*_column(f"  {verb}", 13, what), *_column("", 13, f"$ {example}", " \\", 17)]
    return "\n".join([*lines, "", *(line for call, what in FOOT for line in _column(call, 37, what))])


FOOT = (
    (
        "sysid-bench VERB --help",
        "every knob of a verb, its options, and the knobs of those that it takes by default",
    ),
    ("sysid-bench VERB plant=X --help", "the knobs of another option, with units and values"),
    ("sysid-bench VERB ... --cfg", "the resolved config, without running it"),
    ("sysid-bench VERB ... plugins=DIR", "with options of your own: DIR/conf and the packages in DIR"),
    ("source <(sysid-bench --completion)", "in bash or zsh: Tab completes verbs, options and knobs"),
)


def _width() -> int:
    """That of the terminal, 80 at least; of a file, the widest."""
    return max(80, min(shutil.get_terminal_size((WIDEST, 24)).columns, WIDEST))


def _column(head: str, at: int, words: str, joint: str = "", hang: int | None = None) -> list[str]:
    """`head`, then `words` from column `at` on (further lines from `hang`), each line but the last ended by `joint`."""
    lines = textwrap.wrap(
        words,
        _width() - len(joint),
        initial_indent=f"{head:<{at}}",
        subsequent_indent=" " * (at if hang is None else hang),
        break_long_words=False,
        break_on_hyphens=False,
    )
    return [*(line + joint for line in lines[:-1]), lines[-1]]


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
    own = (conf.home().conf / f"{verb}.yaml").read_text().rstrip().splitlines()
    head = [*_column("#", 2, own[0][2:], hang=2), *_column("#", 2, own[1][2:], " \\", 6)]
    body = [part for line in own[2:] for part in fitted(line)]
    return "\n".join([*head, *body, *_options(verb, defaults, options, plugins)])


def _in_full(group: str, name: str, plugins: conf.Plugins) -> str:
    """One option's yaml as it is set from a command line: group.knob."""
    found = read_text(f"{group}/{name}.yaml", plugins).rstrip().splitlines()
    shown = [line for line in found if not line.startswith("_target_")]
    return "\n".join(
        [
            f"{group}={name}, its knobs as {group}.KNOB=VALUE:",
            "",
            *(part for line in shown for part in fitted(f"  {line}")),
        ]
    )


def fitted(line: str, width: int | None = None) -> list[str]:
    """A line of a yaml; a comment that does not fit the width (None: the terminal's) goes on below itself."""
    width = width or _width()
    found = re.match(r"(\s*|.*\S\s+)# (.*)", line)
    if len(line) <= width or found is None:
        return [line]
    at = min(len(found[1]), width - 30)
    above = [] if at == len(found[1]) else [found[1].rstrip()]
    first, *rest = textwrap.wrap(found[2], width - at - 2, break_on_hyphens=False)
    start = " " * at if above else found[1]
    return [*above, f"{start}# {first}", *(f"{'':{at}}# {part}" for part in rest)]


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
    return _column(f"  {head}", 16, ", ".join(names))
