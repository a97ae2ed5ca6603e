"""The mathematics says what it computes: one sentence, and the shape of every array that it returns."""

import ast
import re
from pathlib import Path

import pytest

PACKAGE = Path(__file__).parents[1] / "sysid_bench"
FILES = sorted(
    p for room in ("mechanics", "methods") for p in (PACKAGE / room).glob("*.py") if p.stat().st_size
)


def public(path: Path) -> list[ast.FunctionDef | ast.ClassDef]:
    body = ast.parse(path.read_text()).body
    return [n for n in body if isinstance(n, (ast.FunctionDef, ast.ClassDef)) and not n.name.startswith("_")]


@pytest.mark.parametrize("path", FILES, ids=lambda p: f"{p.parent.name}/{p.name}")
def test_public_names_say_what_they_are(path: Path) -> None:
    assert ast.get_docstring(ast.parse(path.read_text())), "a file says what -> what"
    for node in public(path):
        words = ast.get_docstring(node)
        assert words, f"{node.name} has no docstring"
        first = words.split("\n\n")[0].strip()
        assert re.search(r"[.:)]$", first), f"{node.name}: its first sentence has no end: {first!r}"
        if isinstance(node, ast.FunctionDef) and node.returns and "Array" in ast.unparse(node.returns):
            assert "(" in words, f"{node.name} returns an array; its docstring says no shape"
