"""Device and host know the bus only, not each other; what they share is the frames."""

from pathlib import Path

import pytest
from test_floors import imports

PACKAGE = Path(__file__).parents[1] / "sysid_bench"


@pytest.mark.parametrize(
    ("room", "forbidden"), [("emulator", "measure"), ("measure", "emulator"), ("frames", "rigs")]
)
def test_rooms_do_not_know_each_other(room: str, forbidden: str) -> None:
    for path in (PACKAGE / room).glob("*.py"):
        assert not {n for n in imports(path) if n.startswith(f"sysid_bench.{forbidden}")}, path


def test_the_measuring_side_never_sees_a_plant() -> None:
    for path in (PACKAGE / "measure").glob("*.py"):
        assert "Plant" not in path.read_text(), path
