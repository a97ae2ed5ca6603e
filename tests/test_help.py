"""The menu and the help stay within the terminal; an example cut into lines is still one command."""

import shlex

import pytest

from sysid_bench import conf, help

WIDTHS = (80, 100)


@pytest.mark.parametrize("width", WIDTHS)
def test_the_menu_fits_and_its_examples_are_whole(width: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("COLUMNS", str(width))
    menu = help.menu()
    assert max(map(len, menu.splitlines())) <= width
    commands = [
        shlex.split(line.strip()[2:]) for line in menu.replace("\\\n", "").splitlines() if "$ " in line
    ]
    assert commands == [shlex.split(example) for _, example in conf.verbs().values()]


@pytest.mark.parametrize("width", WIDTHS)
def test_the_help_of_every_verb_fits(width: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("COLUMNS", str(width))
    for verb in conf.verbs():
        lines = help.of_verb(verb, []).splitlines()
        assert max(map(len, lines)) <= width, verb


@pytest.mark.parametrize("width", WIDTHS)
def test_the_knobs_of_every_option_fit(width: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("COLUMNS", str(width))
    for group in ("plant", "excitation", "noise", "method", "executor"):
        for name in conf.groups()[group]:
            lines = help.of_verb("sweep", [f"{group}={name}"]).splitlines()
            assert max(map(len, lines)) <= width, (group, name)
