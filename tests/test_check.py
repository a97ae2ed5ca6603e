"""The check as a user meets it: three tiers on a small study of one's own, its reference, diffs and commands."""

import csv
import re
from collections.abc import Callable
from pathlib import Path

import pytest

from sysid_bench.__main__ import main

STUDY = """# @package _global_
# A study of one's own.
defaults: [{override /plant: one_dof}, {override /excitation: cubic_noise}, {override /noise: white}]
study: {name: own, question: "Does the check work?", kind: identify, repetitions: 12, seed: 1}
sampling: {h_s: 0.25, N: 300}
excitation: {knot_spacing_s: 1.0}
axes: {method: [mdk_srivc, spline_ml], noise.snr_db: [20, 40]}
claims:
  - {says: they are equivalent, kind: ratio, methods: [spline_ml, mdk_srivc], limits: [0.2, 5], where: {noise.snr_db: 20}}
  - {says: neither fails, kind: failures, methods: [spline_ml], limits: [0, 0.5]}
"""
Check = Callable[..., tuple[int, str]]


@pytest.fixture(scope="module")
def own(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("own")
    (folder / "experiments").mkdir()
    (folder / "experiments" / "own.yaml").write_text(STUDY)
    return folder


@pytest.fixture
def check(own: Path, capsys: pytest.CaptureFixture[str]) -> Check:
    def run(*words: str) -> tuple[int, str]:
        fixed = [f"plugins={own}", "experiment=own", f"reference={own / 'reference'}", "executor=serial"]
        code = main(["check", *fixed, *words])
        said = capsys.readouterr()
        return code, said.out + said.err

    return run


def reference(own: Path, change: Callable[[dict[str, str]], None], name: str = "own.csv") -> None:
    """Change some rows of the reference, as if the methods had been otherwise when it was made."""
    path = own / "reference" / name
    with path.open() as file:
        rows = list(csv.DictReader(file))
    for row in rows:
        change(row)
    with path.open("w") as file:
        writer = csv.DictWriter(file, list(rows[0]))
        writer.writeheader()
        writer.writerows(rows)


def scaled(method: str, factor: float) -> Callable[[dict[str, str]], None]:
    def change(row: dict[str, str]) -> None:
        if row["method"] == method:
            row["K_error"] = str(float(row["K_error"]) * factor)

    return change


def test_paired_is_green_red_for_a_shift_and_shows_a_better_table_as_a_diff(own: Path, check: Check) -> None:
    code, said = check("tier=paired", "accept=true")
    assert code == 0 and "own.paired.csv: 48 cells are the reference now" in said
    assert (own / "reference" / "own.paired.medians.csv").read_text().count("\n") == 5
    assert check("tier=paired")[0] == 0
    reference(own, scaled("spline_ml", 0.9), "own.paired.csv")
    code, said = check("tier=paired")
    assert code == 1 and len(re.findall(r"^worse: K_error reference -> x 1\.111 ", said, re.M)) == 2, said
    assert "method=mdk_srivc" not in said
    assert (
        "sysid-bench sweep experiment=own 'only=plant=one_dof method=spline_ml noise.snr_db=20' plugins="
        in said
    )
    reference(own, scaled("spline_ml", 2.0), "own.paired.csv")
    code, said = check("tier=paired", "only=method=spline_ml")
    assert code == 0 and "2 better than the reference" in said and "tier=paired accept=true" in said
    code, said = check("tier=paired", "accept=true")
    assert code == 0 and "better: K_error" in said and "own.paired.medians.csv: as it was" in said


def test_exact_names_the_cell_and_its_command(own: Path, check: Check) -> None:
    assert check("accept=true")[0] == 0
    reference(own, scaled("mdk_srivc", 1 / 1.001))
    code, said = check()
    assert code == 1 and said.count("worse: K_error") == 24
    assert "'only=plant=one_dof method=mdk_srivc noise.snr_db=20 repetition=0'" in said
    code, said = check("accept=true")
    assert code == 0 and "+one_dof,mdk_srivc," in said and "-one_dof,mdk_srivc," in said


def test_fresh_judges_claims_on_seeds_that_it_names(own: Path, check: Check) -> None:
    code, said = check("tier=fresh", "accept=true", "seed=5")
    assert code == 0 and "holds: they are equivalent: " in said and "tier=fresh experiment=own seed=5" in said
    code, again = check("tier=fresh", "seed=5")
    assert code == 0 and re.findall("holds: .*", again) == re.findall("holds: .*", said)
    study = own / "experiments" / "own.yaml"
    study.write_text(STUDY.replace("[0.2, 5]", "[0, 0.9]"))
    code, said = check("tier=fresh")
    study.write_text(STUDY)
    assert code == 1 and "worse: ratio holds -> does not hold: they are equivalent" in said
    seeds = set(re.findall(r"seed=(\d+)", check("tier=fresh")[1] + said))
    assert len(seeds) == 2, "new seeds each time"


@pytest.mark.parametrize(
    ("words", "wanted"),
    [
        (["tier=loose"], "exact, paired, fresh"),
        (["accept=true", "only=method=spline_ml"], "leave only= out"),
        (["reference=nowhere"], "no reference table"),
        (["only=method"], "KEY=VALUE"),
    ],
)
def test_a_wrong_call_is_one_message(check: Check, words: list[str], wanted: str) -> None:
    code, said = check(*words)
    assert code == 2 and wanted in said
