"""conf/ -> the reference pages of the site: every verb and every option, with its knobs, units and defaults.

A hook of MkDocs: the pages exist only while the site is built, so they cannot fall behind the configs.
"""

from __future__ import annotations

import inspect
from collections.abc import Iterator

from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files

from sysid_bench import conf
from sysid_bench.build import target_class
from sysid_bench.help import fitted

WIDTH = 88  # what the page shows of a line of code

GROUPS = {
    "plant": "Plants",
    "excitation": "Excitations",
    "noise": "Noises",
    "sampling": "Sampling",
    "source": "Sources of records",
    "method": "Methods",
    "effect": "Effects",
    "analysis": "Analyses",
    "rig": "Rigs",
    "bus": "Buses",
    "campaign": "Campaigns",
    "executor": "Executors",
}


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Add the generated pages."""
    for name, text in (("verbs", verbs()), ("options", options())):
        files.append(File.generated(config, f"reference/{name}.md", content=text))
    return files


def verbs() -> str:
    """Every verb: what it does, an example, its config with comments."""
    lines = [
        "# Verbs",
        "",
        "`sysid-bench VERB key=value ...`; `--help` prints what stands here, `--cfg` the resolved config.",
    ]
    for verb, (what, example) in conf.verbs().items():
        body = (conf.home().conf / f"{verb}.yaml").read_text().splitlines()[2:]
        lines += ["", f"## {verb}", "", what, "", f"    {example}", "", *_yaml(body)]
    return "\n".join([*lines, ""])


def options() -> str:
    """Every option of every group: its class's words and its yaml."""
    lines = ["# Options", "", "`group=option` chooses one, `group.knob=value` sets a knob of it.", ""]
    groups = conf.groups()
    for group in [*GROUPS, *sorted(set(groups) - set(GROUPS))]:
        if group in groups:
            lines += [f"## {GROUPS.get(group, group)}: `{group}=`", ""]
            lines += [line for name in groups[group] for line in _option(group, name)]
    return "\n".join(lines)


def _option(group: str, name: str) -> Iterator[str]:
    text = (conf.home().conf / group / f"{name}.yaml").read_text().splitlines()
    yield from (f"### {group}={name}", "")
    target = conf.option(group, name).get("_target_")
    if target and group not in ("plant", "rig"):
        words = inspect.getdoc(target_class(target)) or ""
        yield from (f"    {line}".rstrip() for line in words.splitlines())
        yield ""
    yield from _yaml(text)


def _yaml(lines: list[str]) -> list[str]:
    return ["```yaml", *(part for line in lines for part in fitted(line, WIDTH)), "```", ""]
