"""The page names every knob of a rig, every fault, every quality bit."""

import dataclasses
from pathlib import Path

from sysid_bench import nouns
from sysid_bench.emulator.faults import DEVICE_KINDS, FRAME_KINDS
from sysid_bench.rigs.rig import Rig

PAGE = (Path(__file__).parents[1] / "docs" / "your_rig.md").read_text()


def test_every_knob_is_there() -> None:
    missing = [f.name for f in dataclasses.fields(Rig) if f"`{f.name}`" not in PAGE and f.name != "name"]
    assert not missing


def test_every_fault_and_flag_is_there() -> None:
    assert all(kind in PAGE for kind in FRAME_KINDS + DEVICE_KINDS)
    bits = ("LOST", "DUPLICATED", "REORDERED", "CORRUPTED", "LATE", "CLIPPED", "STUCK")
    assert all(f"| {getattr(nouns, bit)} | {bit.lower()} |" in PAGE for bit in bits)
