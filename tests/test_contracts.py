"""Every option of every shelf keeps its promises; a new file is tested unasked."""

import importlib

import pytest

from sysid_bench import conf
from sysid_bench.contracts import check_defaults, check_option

OPTIONS = [(group, name) for group, names in conf.groups().items() for name in names]


@pytest.mark.parametrize(("group", "name"), OPTIONS, ids=lambda value: value)
def test_option_keeps_its_promises(group: str, name: str) -> None:
    check_option(group, name)


@pytest.mark.parametrize("group", sorted(conf.groups()))
def test_the_plain_option_repeats_the_defaults_of_its_class(group: str) -> None:
    for name in conf.groups()[group]:
        node = conf.option(group, name)
        if str(node["_target_"]).split(".")[-2] == name:
            check_defaults(node)


@pytest.mark.parametrize("verb", sorted(conf.verbs()))
def test_every_verb_has_two_lines_and_a_door(verb: str) -> None:
    what, example = conf.verbs()[verb]
    assert what and example.startswith(f"sysid-bench {verb}")
    assert callable(importlib.import_module(f"sysid_bench.doors.{verb}").main)


def test_smoke_runs_every_method_of_the_suite() -> None:
    """Peers (other packages) and the method for one Lagrangian of the user's have studies of their own."""
    elsewhere = ("peer_", "discrete_lagrangian")
    methods = {name for name in conf.groups()["method"] if not name.startswith(elsewhere)}
    assert set(conf.compose("sweep", ["experiment=smoke"])["axes"]["method"]) == methods
