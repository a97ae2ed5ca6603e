"""Shell completion: what Tab may answer, and a Tab pressed in a real bash. The help texts that say the same."""

import os
import pty
import select
import shutil
import subprocess
import sys
import time
from pathlib import Path

import pytest

from sysid_bench.__main__ import main
from sysid_bench.completion import candidates

REPOSITORY = Path(__file__).parents[1]


@pytest.mark.parametrize(
    ("line", "wanted"),
    [
        ("sysid-bench sim", ["simulate"]),
        ("sysid-bench simulate plant=one_dof_u", ["plant=one_dof_undamped"]),
        ("sysid-bench simulate noise.s", ["noise.snr_db="]),
        ("sysid-bench simulate excitation=prbs excitation.amp", ["excitation.amplitude_N="]),
        ("sysid-bench sweep experiment=smo", ["experiment=smoke"]),
        ("sysid-bench sweep study.re", ["study.repetitions="]),
        ("sysid-bench check ti", ["tier="]),
        ("sysid-bench identify record=ru", []),
        ("sysid-bench nonsense ", ["--cfg", "--help", "plugins="]),
    ],
)
def test_candidates(line: str, wanted: list[str]) -> None:
    assert candidates(line) == wanted


def test_a_fresh_word_offers_every_key_of_the_verb() -> None:
    found = candidates("sysid-bench identify ")
    assert {"record=", "model=", "out=", "method=", "method.start=", "--help"} <= set(found)


class Bash:
    """An interactive bash behind a terminal, with the completion loaded."""

    def __init__(self, folder: Path) -> None:
        command = folder / "sysid-bench"
        command.write_text(f'#!/bin/sh\nPYTHONPATH={REPOSITORY} exec {sys.executable} -m sysid_bench "$@"\n')
        command.chmod(0o755)
        env = {**os.environ, "PATH": f"{folder}:{os.environ['PATH']}", "PS1": "$ ", "TERM": "dumb"}
        self.pid, self.terminal = pty.fork()
        if self.pid == 0:
            os.chdir(folder)
            os.execvpe("bash", ["bash", "--norc", "--noprofile", "-i"], env)
        self.type("source <(sysid-bench --completion); echo loaded\n", until="loaded\r\n")

    def type(self, text: str, until: str) -> str:
        """What the terminal shows after `text`, up to `until`."""
        os.write(self.terminal, text.encode())
        shown, deadline = "", time.monotonic() + 60
        while until not in shown and time.monotonic() < deadline:
            if select.select([self.terminal], [], [], 0.2)[0]:
                shown += os.read(self.terminal, 4096).decode()
        assert until in shown, shown
        return shown

    def close(self) -> None:
        os.close(self.terminal)
        os.waitpid(self.pid, 0)


@pytest.mark.skipif(not shutil.which("bash"), reason="no bash here")
def test_tab_in_a_real_bash(tmp_path: Path) -> None:
    (tmp_path / "run of today.csv").touch()
    bash = Bash(tmp_path)
    assert "simulate " in bash.type("sysid-bench sim\t", until="simulate ")
    assert "plant=one_dof_undamped " in bash.type("plant=one_dof_u\t", until="plant=one_dof_undamped ")
    assert "noise.snr_db=" in bash.type("noise.sn\t", until="noise.snr_db=")
    record = "of\\ today.csv"
    assert record in bash.type("15 \x15sysid-bench identify record=run\t", until=record)
    bash.close()


@pytest.mark.skipif(not shutil.which("zsh"), reason="no zsh here")
def test_zsh_takes_the_script() -> None:
    code = f"autoload -U bashcompinit compinit && compinit -u && bashcompinit && source <({sys.executable} -m sysid_bench --completion)"
    done = subprocess.run(["zsh", "-c", code], cwd=REPOSITORY, capture_output=True, text=True)
    assert done.returncode == 0 and not done.stderr


def said(capsys: pytest.CaptureFixture[str], *words: str) -> str:
    main(words)
    found = capsys.readouterr()
    return found.out + found.err


def test_help_shows_the_knobs_of_options(capsys) -> None:
    plain = said(capsys, "simulate", "--help")
    assert "three_dof has plant.mass, plant.damping" in plain and "noise.snr_db" in plain
    chosen = said(capsys, "simulate", "noise=coloured", "--help")
    assert chosen.startswith("noise=coloured, its knobs as noise.KNOB=VALUE:") and "snr_db: 15.0" in chosen
    assert "_target_" not in chosen and "no such option" in said(capsys, "simulate", "noise=pink", "--help")
    assert max(map(len, plain.splitlines())) <= 150
