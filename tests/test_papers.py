"""Claims, misprints and the page: verdicts follow the tables, nothing is invented."""

from collections import Counter
from pathlib import Path

import numpy as np
import pytest

from sysid_bench import conf, plan, studies
from sysid_bench.__main__ import main
from sysid_bench.build import build
from sysid_bench.nouns import InputError, Sampling
from sysid_bench.papers import (
    bruschetta_2011,
    bruschetta_2011_theory,
    kapucu_baysec_1997,
    misprints,
    possible,
)
from sysid_bench.papers.claims import CONFIRMED, PARTLY, REFUTED, number, percent, word
from sysid_bench.papers.evidence import PAPERS as STUDIES
from sysid_bench.papers.evidence import Table, Tables, command
from sysid_bench.papers.page import PAPERS, fall
from sysid_bench.papers.page import studies as judged_studies
from sysid_bench.views.papers_page import write_papers_page

ROOT = Path(__file__).resolve().parents[1]
CLAIMS = [claim for claims, _ in PAPERS.values() for claim in claims]
MISPRINTS = [m for _, wrong in PAPERS.values() for m in wrong]
EXPERIMENTS = [f"{paper}/{study}" for paper, names in STUDIES.items() for study in names]


def tables(**named):
    """Tables made from columns: {study: {column: values}}; `repetition` is added."""
    found = {}
    for study, columns in named.items():
        rows = len(next(iter(columns.values())))
        columns = {"repetition": np.arange(rows)} | columns
        found[study] = Table(study, {k.replace("__", "."): np.array(v) for k, v in columns.items()})
    return Tables(Path("nowhere"), found)


# the words ---------------------------------------------------------------------------------------------------


def test_words():
    assert [word(True), word(False, True), word(False)] == [CONFIRMED, PARTLY, REFUTED]


@pytest.mark.parametrize(
    ("x", "text"), [(0.0123, "0.012"), (137.2, "137"), (2e-13, "2e-13"), (0.0, "0"), (1.5e9, "1.5e+09")]
)
def test_numbers(x, text):
    assert number(x) == text


def test_percent_of_a_failing_method_is_a_word():
    assert percent(float("inf")) == "no estimate" and percent(0.0123) == "1.2 %"


# misprints ---------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("misprint", [m for m in MISPRINTS if m.numbers], ids=lambda m: m.where)
def test_the_correction_is_right_and_the_print_is_wrong(misprint):
    printed, meant, exact = misprint.numbers()
    scale = max(abs(exact), abs(printed))
    assert abs(meant - exact) < 0.01 * scale
    assert abs(printed - exact) > 0.2 * scale


def test_misprints_that_only_words_can_show_say_so():
    assert all(m.quantity == "" for m in MISPRINTS if m.numbers is None)
    assert len({m.where for m in MISPRINTS}) == len(MISPRINTS) >= 20


def test_the_start_of_the_pem_with_its_step_size_is_right_to_a_tenth_of_a_percent_at_small_h():
    printed, meant, exact = misprints.start_of_pem(0.005)
    assert meant == pytest.approx(exact, rel=1e-4) and printed / exact > 50


# claims on tables of our own making: a verdict must follow the numbers ----------------------------------------


def energy_table(swing):
    rules = ["midpoint", "verlet", "zoh", "explicit_euler"]
    return tables(
        energy={
            "analysis__rule": rules * 2, "sampling__h_s": [0.05] * 4 + [0.5] * 4, "swing": [swing, 0.01, 1e-13, 1e9] * 2,
            "balance": [1e-15, 0.01, 0.01, 1.0] * 2, "drift": [0.0, 0.0, 0.0, 1e9] * 2,
        }
    )  # fmt: skip


def test_energy_verdict_follows_the_table():
    judge = bruschetta_2011_theory.midpoint_conserves
    assert judge(energy_table(1e-12)).word == CONFIRMED
    assert judge(energy_table(1e-3)).word == REFUTED


def sweep_table(new, exact, old=0.1):
    """fig5_2_5 in small: one sampling time, 20 runs; `new` one ratio to the bound per run."""
    methods = [bruschetta_2011.OLD, bruschetta_2011.NEW, bruschetta_2011_theory.EXACT_START]
    errors = np.concatenate([np.full(20, old), 0.01 * np.asarray(new), np.full(20, 0.01 * exact)])
    columns = {
        "method": np.repeat(methods, 20),
        "sampling__h_s": np.full(60, 0.02),
        "repetition": np.tile(np.arange(20), 3),
    }
    columns |= {f"{X}_error": errors for X in "MDKA"} | {f"{X}_over_bound": errors / 0.01 for X in "MDK"}
    return tables(fig5_2_5=columns)["fig5_2_5"]


def test_failures_count_runs_led_astray_and_runs_without_estimate():
    ratios = np.ones(20)
    assert bruschetta_2011.failures(sweep_table(ratios, 1.0), 0.02) == 0
    ratios[:3], ratios[3:5] = 100.0, np.nan
    assert bruschetta_2011.failures(sweep_table(ratios, 1.0), 0.02) == 0.25
    assert bruschetta_2011.failures(sweep_table(np.full(20, 8.0), 4.0), 0.02) == 0, (
        "the exact start is as bad"
    )


def test_window_wants_no_failures_and_a_clear_gain():
    assert bruschetta_2011.window(sweep_table(np.ones(20), 1.0)) == [0.02]
    assert bruschetta_2011.window(sweep_table(np.ones(20), 1.0, old=0.012)) == []
    assert bruschetta_2011.window(sweep_table([1.0] * 18 + [100.0] * 2, 1.0)) == []


def test_medians_count_missing_estimates_as_infinitely_wrong():
    table = tables(fig2_5={"x": [1.0, 2.0, np.nan, np.nan, np.nan]})["fig2_5"]
    assert table.median("x") == np.inf


@pytest.mark.parametrize(("ratio", "expected"), [(1.0, CONFIRMED), (1.4, REFUTED), (np.nan, REFUTED)])
def test_the_bound_is_missed_by_a_large_error_and_by_a_missing_one(ratio, expected):
    columns = {"method": ["spline_ml"] * 4, "sampling__h_s": [0.1] * 4, "status": ["ok"] * 4}
    columns |= {f"{X}_over_bound": [1.0, 1.0, 1.0, 1.0] for X in "MK"} | {"D_over_bound": [ratio] * 4}
    assert possible.on_the_bound(tables(fig5_2_5=columns, fig5_6_9=columns)).word == expected


def coefficient_table(a1):
    T = [1.0, 2.0, 2.6, 3.6]
    columns = {"plant": ["one_dof"] * 4, "sampling__h_s": T}
    columns |= {name: [0.3, 0.3, 0.3, a1] for name in ("a1", "a2", "b2")} | {"b1": [1.0] * 4}
    columns |= {f"{name}_theory": [0.3] * 4 for name in ("a1", "a2", "b2")} | {"b1_theory": [1.0] * 4}
    return tables(fig2_5=columns)


def test_the_fall_is_read_from_the_table():
    assert kapucu_baysec_1997.sharp_fall(coefficient_table(-0.1)).word == CONFIRMED
    assert kapucu_baysec_1997.sharp_fall(coefficient_table(0.3)).word == REFUTED


# what needs no table -----------------------------------------------------------------------------------------


@pytest.mark.parametrize("claim", [c for c in CLAIMS if not c.studies], ids=lambda c: c.where)
def test_exact_claims(claim):
    verdict = claim.judge(Tables(Path("nowhere")))
    misprinted = (kapucu_baysec_1997.formulas_are_exact, bruschetta_2011.smaller_h_better_start)
    expected = PARTLY if claim.judge in misprinted else CONFIRMED
    assert verdict.word == expected and verdict.runs == 0


def test_the_fall_is_explained_with_its_numbers():
    text = fall()
    assert "p = 0.16303353" in text and "computed: -0.16303353" in text
    p = np.exp(-kapucu_baysec_1997.FALL_T / 2)
    e = np.linspace(-1, 1, 200_001)
    energy = 1 + (p + e) ** 2 + (p * e) ** 2  # of (1 + p z^-1)(1 + e z^-1)
    assert e[np.argmin(energy)] == pytest.approx(-p / (1 + p**2), abs=1e-5)


def test_least_squares_falls_where_predicted():
    """10 mV of white noise, c = 1, T = pi / omega_d, 400 records of 44 samples, by the method of the studies."""
    T, rng = kapucu_baysec_1997.FALL_T, np.random.default_rng(1)
    plant, excitation = (
        build(conf.option("plant", "one_dof")),
        build(conf.option("excitation", "random_binary")),
    )
    noise = build(conf.option("noise", "white") | {"snr_db": 35.2})
    method = build(conf.option("method", "arx_least_squares") | {"blocks": 0})
    source, found = build(conf.option("source", "simulation")), []
    for _ in range(400):
        record = source.acquire(plant, excitation, noise, Sampling(T, 44), rng).record
        found.append(method.fit(record, plant.model().structure_only()).coefficients)
    median = {name: np.median([c[name] for c in found]) for name in ("a1", "a2", "b1", "b2")}
    assert [median[n] for n in ("a1", "a2", "b2")] == pytest.approx([0.004, -0.026, -0.185], abs=0.05)
    assert median["b1"] == pytest.approx(1.163, abs=0.01)


# the studies and the page ------------------------------------------------------------------------------------


@pytest.mark.parametrize("experiment", [*EXPERIMENTS, "smoke"])
def test_studies_expand_and_are_named_as_their_files(experiment):
    cfg = conf.compose("sweep", [f"experiment={experiment}"])
    study = studies.study_of(cfg)
    assert study.name == experiment and study.question.endswith("?")
    cells = Counter(cell.labels["plant"] for task in plan.tasks(study) for cell in task.cells)
    assert cells
    full = studies.study_of(conf.compose("sweep", [f"experiment={experiment}", "scale=full"]))
    assert full.repetitions >= study.repetitions


def test_every_study_in_the_papers_folders_is_judged():
    there = sorted(p.relative_to(ROOT / "experiments").with_suffix("").as_posix() for p in (ROOT / "experiments").glob("*_*/*.yaml")
                   if p.parent.name in STUDIES)  # fmt: skip
    assert there == sorted(EXPERIMENTS)
    assert judged_studies() == sorted(name for names in STUDIES.values() for name in names)


@pytest.mark.parametrize(
    ("experiment", "runs"), [("fig5_2_5", 30), ("fig5_6_9", 20), ("fig5_10_13", 20), ("fig5_14_15", 20)]
)
def test_enough_runs(experiment, runs):
    study = studies.study_of(conf.compose("sweep", [f"experiment=bruschetta_2011/{experiment}"]))
    assert study.repetitions >= runs


def test_missing_tables_are_named_with_the_commands_that_make_them(tmp_path, capsys):
    assert main(["papers", f"results_dir={tmp_path}", f"out={tmp_path / 'papers.md'}"]) == 2
    words = capsys.readouterr().err
    assert all(command(study) in words for study in judged_studies())
    assert not (tmp_path / "papers.md").exists()


def test_a_study_run_in_part_is_refused():
    table = tables(fig2_5={"plant": ["one_dof"], "sampling__h_s": [1.0]})["fig2_5"]
    with pytest.raises(InputError, match=r"no rows with sampling\.h_s=2"):
        table.at(sampling__h_s=2.0)
    with pytest.raises(InputError, match="no column a1"):
        table.median("a1")


def test_a_real_study_is_judged(tmp_path):
    assert (
        main(
            [
                "sweep",
                "experiment=bruschetta_2011/passivity",
                f"results_dir={tmp_path}",
                "views=false",
                "executor=serial",
            ]
        )
        == 0
    )
    results = Tables(tmp_path)
    assert bruschetta_2011_theory.zoh_loses_passivity(results).word == CONFIRMED
    kept = bruschetta_2011_theory.midpoint_keeps_passivity(results)
    assert kept.word == PARTLY and "15 of 15" in kept.numbers


def test_the_committed_page_speaks_of_every_claim_and_misprint():
    text = (ROOT / "docs" / "papers.md").read_text()
    assert all(claim.text in text and f"*({claim.where})*" in text for claim in CLAIMS)
    assert text.count("\n| ") >= len(MISPRINTS)


def test_the_page_beside_the_reports_links_every_claim_to_its_report(tmp_path):
    page = write_papers_page(tmp_path, (ROOT / "docs" / "papers.md").read_text()).read_text()
    assert all(f'/{study}/report.html">' in page for study in judged_studies())
    assert page.count("<li>\n<p><strong>") == len(CLAIMS) and "<table>" in page
