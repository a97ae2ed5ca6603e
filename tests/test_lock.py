"""The locked environment is that of pyproject.toml: pinned, hashed, and without the address of any registry."""

import re
import tomllib
from pathlib import Path

import pytest
from packaging.requirements import Requirement

ROOT = Path(__file__).parents[1]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
EXTRAS = PROJECT["optional-dependencies"]
LOCKS = {"requirements.lock": ["dev", "dask"], "requirements-docs.lock": ["docs"]}


def pinned(lock: str) -> dict[str, set[str]]:
    """Name -> versions: one, or one for each range of Pythons."""
    found: dict[str, set[str]] = {}
    for name, version in re.findall(r"^([\w.-]+)(?:\[.*\])?==(\S+)", (ROOT / lock).read_text(), re.M):
        found.setdefault(name, set()).add(version)
    return found


def wanted(extras: list[str]) -> list[Requirement]:
    words = [*PROJECT["dependencies"], *(word for extra in extras for word in EXTRAS[extra])]
    return [need for need in map(Requirement, words) if need.name != PROJECT["name"]]


@pytest.mark.parametrize("lock", LOCKS)
def test_the_lock_holds_what_the_project_asks_for(lock: str) -> None:
    """`make lock` writes it anew."""
    pins = pinned(lock)
    needs = wanted(LOCKS[lock])
    stale = [str(need) for need in needs if not pins.get(need.name) or not all(map(need.specifier.contains, pins[need.name]))]  # fmt: skip
    assert needs and not stale


@pytest.mark.parametrize("lock", LOCKS)
def test_the_lock_is_hashed_and_names_no_registry(lock: str) -> None:
    text = (ROOT / lock).read_text()
    assert "://" not in text and "--index" not in text
    assert len(re.findall(r"^\S+==", text, re.M)) == len(
        re.findall(r"^\S+==.*\\\n    --hash=sha256:", text, re.M)
    )
