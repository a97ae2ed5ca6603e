"""Small faults planted in a copy of the suite: the check is red for each, and names the method that has it."""

import os
import re
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

REPOSITORY = Path(__file__).parents[1]
BIASED = "__import__('dataclasses').replace({0}, {1}=1.02 * {0}.{1})"

SIGN = {
    "the residual's sign": (
        "variational_pem", "methods/variational_pem.py",
        "residual = self.record.y - found.y", "residual = found.y - self.record.y"),
    "a sign in the normal equations": (
        "mdk_srivc", "mechanics/refined_iv.py", "g = -ne.gradient(", "g = ne.gradient("),
    "a conjugate forgotten in the gradient": (
        "n4sid_d2c", "mechanics/subspace.py", "[g.real, -g.imag]", "[g.real, g.imag]"),
}  # fmt: skip
OFF_BY_ONE = {
    "the output map one sample late": (
        "n4sid_d2c", "mechanics/subspace.py", "Gamma[:ny]\n", "Gamma[ny : 2 * ny]\n"),
    "one iteration only": (
        "mdk_srivc", "mechanics/refined_iv.py", "if change < tolerance:", "if change < tolerance or step > 1:"),
    "an input term too late": ("arx_least_squares", "methods/arx.py", "self.nb, self.nk)\n", "self.nb, self.nk + 1)\n"),
}  # fmt: skip
BIAS = {
    f"2 % of {letter}": ("spline_ml", "methods/spline_ml.py",
        "return estimate_of(fit_problem(problem, wanted), {\"hold\": wanted})",
        "found = estimate_of(fit_problem(problem, wanted), {\"hold\": wanted}); return " + BIASED.format("found", letter))
    for letter in "MDK"
}  # fmt: skip
FALLBACK = {
    "the start where the search found nothing": (
        "variational_pem", "methods/variational_pem.py",
        "        found = minimise(search.on(p), p[search.live], self.max_iterations, self.tolerance)\n",
        "        try:\n            found = minimise(search.on(p), p[search.live], self.max_iterations, self.tolerance)\n"
        "        except Diverged:\n            return Estimate(*unpack(theta, model.n))\n"),
    "the identity instead of a refusal": (
        "n4sid_d2c", "methods/n4sid.py",
        "        poles, space = found.continuous_form()[0], found.state_space()\n",
        "        try:\n            poles, space = found.continuous_form()[0], found.state_space()\n"
        "        except Diverged:\n            return Estimate(*[np.eye(model.n)] * 3)\n"),
    "the start instead of the answer": (
        "mdk_srivc", "methods/mdk_srivc.py", "M, D, K = unpack(theta, model.n)", "M, D, K = unpack(start, model.n)"),
}  # fmt: skip
FAULTS = SIGN | OFF_BY_ONE | BIAS | FALLBACK


@pytest.fixture(scope="module")
def copy(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The suite, its configs, studies and reference, to be spoilt."""
    folder = tmp_path_factory.mktemp("copy")
    for name in ("sysid_bench", "conf", "experiments", "results/reference"):
        shutil.copytree(REPOSITORY / name, folder / name, ignore=shutil.ignore_patterns("__pycache__"))
    return folder


@pytest.fixture
def planted(copy: Path, request: pytest.FixtureRequest) -> Iterator[str]:
    """A copy with one fault; yields the method that has it."""
    method, file, right, wrong = FAULTS[request.param]
    path = copy / "sysid_bench" / file
    text = path.read_text()
    assert text.count(right) == 1, f"{file} no longer has exactly one {right!r}: choose another place"
    path.write_text(text.replace(right, wrong))
    yield method
    path.write_text(text)


def check(copy: Path, *words: str) -> subprocess.CompletedProcess[str]:
    env = {**os.environ, "PYTHONPATH": str(copy), "PYTHONDONTWRITEBYTECODE": "1"}
    command = [sys.executable, "-m", "sysid_bench", "check", *words]
    return subprocess.run(command, cwd=copy, env=env, capture_output=True, text=True, timeout=3000)


@pytest.mark.slow
@pytest.mark.parametrize("planted", FAULTS, indirect=True)
def test_a_small_fault_turns_the_check_red(copy: Path, planted: str) -> None:
    done = check(copy, f"only=plant=three_dof method={planted}")
    assert done.returncode == 1, done.stdout + done.stderr
    worse = [line for line in done.stdout.splitlines() if line.startswith("worse: ")]
    assert worse and all(f"method={planted} " in line for line in worse)
    assert (
        f"sysid-bench sweep experiment=reference/exact 'only=plant=three_dof method={planted} " in done.stdout
    )


@pytest.mark.slow
@pytest.mark.parametrize("planted", ["2 % of D", "the start instead of the answer"], indirect=True)
def test_the_paired_tier_sees_it_too(copy: Path, planted: str) -> None:
    done = check(copy, "tier=paired", f"only=plant=one_dof method={planted}")
    factors = re.findall(r"^worse: D_error reference -> x (\S+) ", done.stdout, re.M)
    assert done.returncode == 1 and len(factors) == 1 and float(factors[0]) > 1.05, done.stdout + done.stderr


@pytest.mark.slow
def test_without_a_fault_it_is_green(copy: Path) -> None:
    done = check(copy, "only=plant=three_dof")
    assert done.returncode == 0 and " 0 numbers worse, 0 better" in done.stdout, done.stdout + done.stderr
