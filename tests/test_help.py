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
def test_lists_of_options_fit(width: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("COLUMNS", str(width))
    for verb in conf.verbs():
        text = help.of_verb(verb, [])
        listed = text.partition("\noptions:\n")[2].splitlines()
        assert max(map(len, listed), default=0) <= width, verb
