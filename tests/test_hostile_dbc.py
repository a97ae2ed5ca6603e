"""Damaged DBC files: a rig, or one message; never a traceback. The count of files tried is printed."""

from __future__ import annotations

import dataclasses
import random
import re
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

import pytest
from rig_bench import rig_named, small_plan

from sysid_bench.__main__ import main
from sysid_bench.frames.frame import Frame
from sysid_bench.nouns import InputError

RIG = rig_named("second_order")
DBC = RIG.dbc_path.read_bytes()
NUMBERS = [m.span() for m in re.finditer(rb"\d+", DBC)]
ODD = (b"0", b"1", b"7", b"64", b"255", b"4294967295", b"99999999999", b"1e400", b"-1", b"0.5", b"")
tried: Counter[str] = Counter()


@pytest.fixture(scope="module", autouse=True)
def count_printed(pytestconfig):
    yield
    with pytestconfig.pluginmanager.getplugin("capturemanager").global_and_fixture_disabled():
        print(f"\ndamaged DBC files tried: {dict(sorted(tried.items()))}, {sum(tried.values())} in all")


def cut(chance: random.Random) -> Iterator[bytes]:
    yield from (DBC[:length] for length in range(0, len(DBC), 23))


def flipped(chance: random.Random) -> Iterator[bytes]:
    for i in range(0, len(DBC), 11):
        damaged = bytearray(DBC)
        damaged[i] ^= 1 << chance.randrange(8)
        yield bytes(damaged)


def edited(chance: random.Random) -> Iterator[bytes]:
    for _ in range(200):
        damaged = bytearray(DBC)
        for _ in range(chance.randrange(1, 8)):
            at, length = chance.randrange(len(damaged)), chance.randrange(5)
            damaged[at : at + length] = chance.randbytes(chance.randrange(5))
        yield bytes(damaged)


def other_numbers(chance: random.Random) -> Iterator[bytes]:
    """A sound file but for one number: lengths, places, factors, identifiers."""
    for start, end in chance.sample(NUMBERS, 150):
        yield DBC[:start] + chance.choice(ODD) + DBC[end:]


@pytest.mark.parametrize("kind", [cut, flipped, edited, other_numbers])
def test_a_damaged_dbc_is_a_rig_or_one_message(tmp_path: Path, kind) -> None:
    chance, path = random.Random(kind.__name__), tmp_path / "rig.dbc"
    for text in kind(chance):
        path.write_bytes(text)
        tried[kind.__name__] += 1
        try:
            rig = dataclasses.replace(RIG, dbc=str(path))
            codec = rig.codec()
            rig.emergency_stop_frame(codec)
            for message in rig.database.messages:
                codec.decode(Frame(message.frame_id, chance.randbytes(64)))
            small_plan(rig, 3)
        except InputError as problem:
            assert "\n" not in str(problem) and len(str(problem)) < 900, problem


def test_the_door_says_it_in_one_line(tmp_path: Path, capsys) -> None:
    chance, path = random.Random(5), tmp_path / "rig.dbc"
    for text in chance.sample([*edited(chance), *other_numbers(chance)], 25):
        path.write_bytes(text)
        tried["through measure dry_run=true"] += 1
        code = main(
            ["measure", "dry_run=true", "seconds=0.1", f"rig.dbc={path}", f"out={tmp_path / 'a.mcap'}"]
        )
        said = capsys.readouterr()
        assert code in (0, 2) and "Traceback" not in said.err
        assert code == 0 or (said.err.startswith("sysid-bench: ") and said.err.count("\n") == 1), said.err
