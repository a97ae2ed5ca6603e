"""docs/your_method.md and docs/ci_of_your_method.md, done to the letter in a repository of the user's own."""

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest
import yaml

REPOSITORY = Path(__file__).parents[1]
BLOCK = re.compile(r"^`([^`\s]+)`[^\n]*:\n\n```\w*\n(.*?)^```", re.MULTILINE | re.DOTALL)


@pytest.fixture(scope="module")
def own(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with every file that the two pages show."""
    folder = tmp_path_factory.mktemp("my-method")
    for page in ("your_method.md", "ci_of_your_method.md"):
        for name, text in BLOCK.findall((REPOSITORY / "docs" / page).read_text()):
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            (folder / name).write_text(text)
    (folder / "own_methods" / "__init__.py").touch()
    return folder


def run(own: Path, line: str) -> subprocess.CompletedProcess[str]:
    """One command line of the pages; `sysid-bench` and `python` are this environment's."""
    python = f"{sys.executable} -m sysid_bench"
    line = re.sub(r"^sysid-bench", python, re.sub(r"^python ", f"{sys.executable} ", line))
    env = {**os.environ, "PYTHONPATH": str(REPOSITORY), "PYTHONDONTWRITEBYTECODE": "1"}
    return subprocess.run(
        line, shell=True, cwd=own, env=env, capture_output=True, text=True, timeout=600
    )  # fmt: skip


def steps(own: Path) -> list[str]:
    """The commands of the page's workflow after the installation."""
    jobs = yaml.safe_load((own / ".github/workflows/method.yml").read_text())["jobs"]
    return [step["run"] for step in jobs["method"]["steps"] if "run" in step][1:]


def test_the_documented_workflow_is_green_and_turns_red_for_a_worse_method(own: Path) -> None:
    accept = run(own, "sysid-bench check plugins=. experiment=mine reference=reference accept=true")
    assert accept.returncode == 0, accept.stdout + accept.stderr
    for line in steps(own):
        done = run(own, line)
        assert done.returncode == 0, line + done.stdout + done.stderr
    assert (own / "results" / "mine" / "report.html").is_file()
    method = own / "own_methods" / "guess.py"
    method.write_text(method.read_text().replace("np.hstack([acc", "np.hstack([1.02 * acc"))
    worse = run(own, steps(own)[1])
    assert worse.returncode == 1 and "worse: M_error" in worse.stdout and "method=guess" in worse.stdout
    assert "method=n4sid_d2c" not in worse.stdout
