"""The public rooms say what they do: one sentence, the shape of every array returned, the refusals, the source."""

import ast
import re
from pathlib import Path

import pytest

PACKAGE = Path(__file__).parents[1] / "sysid_bench"
ROOMS = ("mechanics", "methods", "files", "records")
FILES = sorted(p for room in ROOMS for p in (PACKAGE / room).glob("*.py") if p.stat().st_size)
METHODS = sorted(p for p in (PACKAGE / "methods").glob("*.py") if p.name[0] != "_")
REFUSALS = {"InputError", "NotApplicable", "Diverged"}
# A source is a year or a numbered equation, or the package that a peer comes from.
SOURCE = re.compile(r"\b(19|20)\d\d\b|\(\d+(\.\d+)?\)|PyPI|package")
# A field whose name ends so has this unit, and the docstring of its class says it.
SUFFIXES = {"_s": "s", "_hz": "Hz", "_db": "dB"}


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


def refusals(node: ast.FunctionDef) -> set[str]:
    """Names of the suite's exceptions that a function raises itself."""
    raised = (n.exc for n in ast.walk(node) if isinstance(n, ast.Raise) and isinstance(n.exc, ast.Call))
    return {call.func.id for call in raised if isinstance(call.func, ast.Name)} & REFUSALS


@pytest.mark.parametrize("path", FILES, ids=lambda p: f"{p.parent.name}/{p.name}")
def test_public_functions_name_what_they_raise(path: Path) -> None:
    for node in public(path):
        if isinstance(node, ast.FunctionDef):
            words = ast.get_docstring(node) or ""
            unsaid = {name for name in refusals(node) if name not in words}
            assert not unsaid, f"{node.name} raises {unsaid}; its docstring does not say so"


@pytest.mark.parametrize("path", METHODS, ids=lambda p: p.name)
def test_a_method_names_its_source(path: Path) -> None:
    tree = ast.parse(path.read_text())
    words = [ast.get_docstring(tree) or "", *(ast.get_docstring(node) or "" for node in public(path))]
    assert SOURCE.search(" ".join(words)), f"{path.name}: no paper, equation or package is named"


@pytest.mark.parametrize("path", FILES, ids=lambda p: f"{p.parent.name}/{p.name}")
def test_the_units_of_knobs_are_said(path: Path) -> None:
    for node in public(path):
        for field in (
            n for n in node.body if isinstance(n, ast.AnnAssign) and isinstance(n.target, ast.Name)
        ):
            unit = next((u for end, u in SUFFIXES.items() if field.target.id.endswith(end)), None)
            words = ast.get_docstring(node) or ""
            assert unit is None or re.search(rf"\b{unit}\b", words), f"{node.name}.{field.target.id}: no unit"
