"""pysindy on a hidden trial: a law that its library holds is found where noise is low; skipped by name where it is absent."""

import sys
from pathlib import Path

import pytest

pytest.importorskip("pysindy", reason="pip install sysid-bench[peers]")
FOLDER = Path(__file__).parents[1] / "experiments" / "hidden_effects"


def test_a_cubic_spring_is_among_what_it_names():
    sys.path.insert(0, str(FOLDER))
    try:
        from draw import Draw
        from pysindy_peer import answer

        trial = Draw(4, kind="single", size="one", name="cubic_stiffness", strength=(0.5, 0.6)).trial()
        found = answer(trial)
    finally:
        sys.path.remove(str(FOLDER))
    assert "cubic_stiffness" in [e["name"] for e in found["said"]]
    assert found["gap_after"] < 0.7 * found["gap_before"]
