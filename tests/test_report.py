"""report.html says what the table holds, alone in one file."""

import re
from dataclasses import replace

import numpy as np
import pytest
from make_study import coefficient_study, sweep_study

from sysid_bench.views.figures import write_figures
from sysid_bench.views.index import write_index_page
from sysid_bench.views.report import write_report
from sysid_bench.views.study import read_study, where
from sysid_bench.views.summary import failures, measured_columns, summarise


@pytest.fixture(scope="module")
def study(tmp_path_factory):
    return read_study(sweep_study(tmp_path_factory.mktemp("results") / "synthetic"))


@pytest.fixture(scope="module")
def page(study):
    return write_report(study, write_figures(study)).read_text()


def test_the_page_needs_no_other_file_and_no_host(page):
    addresses = re.findall(r'(?:src|href)="([^"]*)"', page) + re.findall(r"url\(([^)]*)\)", page)
    assert addresses and all(a.startswith("data:image/svg+xml;base64,") for a in addresses)
    assert "<script" not in page


def test_the_page_holds_question_command_config_and_origin(page):
    for words in (
        "Which method reaches",
        "sysid-bench sweep experiment=synthetic",
        "repetitions: 12",
        "origin",
        "cpu",
    ):
        assert words.lower() in page.lower()


def test_a_summary_row_is_the_median_and_the_rms_ratio(study):
    group = next(g for g in summarise(study) if g.values == ("variational_pem", 0.01))
    rows = where(study.columns, {"method": "variational_pem", "sampling.h_s": 0.01})
    ok = rows & (study.columns["status"] == "ok")
    error, bound = study.columns["M_error"][ok], study.columns["M_bound"][ok]
    assert group.runs == rows.sum() and group.failures == rows.sum() - ok.sum() > 0
    assert group.numbers[0].median == np.median(error)
    assert group.numbers[0].over_bound == pytest.approx(np.sqrt(np.mean((error / bound) ** 2)))


def test_failures_are_counted_by_reason_with_an_example(study, page):
    found = failures(study)
    assert found[0][:3] == ("variational_pem", "diverged", "no decrease of the output error in 40 iterations")
    assert sum(f[3] for f in found) == np.count_nonzero(study.columns["status"] != "ok")
    assert re.fullmatch(r"method=variational_pem sampling.h_s=0.0\d+ repetition=\d+", found[0][5])
    assert found[0][5] in page


def test_reasons_that_differ_in_numbers_alone_are_counted_together(study):
    reasons = np.array(
        [f"no minimum after {40 + i} iterations (decrement {i}e-3)" for i in range(study.rows)], object
    )
    found = failures(replace(study, columns={**study.columns, "reason": reasons}))
    assert len(found) == 2 and sum(f[3] for f in found) == np.count_nonzero(study.columns["status"] != "ok")
    assert found[0][2] in reasons


def test_words_from_a_table_cannot_become_markup(tmp_path):
    folder = sweep_study(tmp_path / "s", repetitions=2)
    (folder / "manifest.json").write_text(
        (folder / "manifest.json").read_text().replace("Which", "<script>x</script>")
    )
    assert "<script>" not in write_report(read_study(folder), []).read_text()


def test_coefficients_are_summarised_where_there_are_no_errors(tmp_path):
    study = read_study(coefficient_study(tmp_path / "coefficients"))
    assert measured_columns(study) == ["a1", "a2", "b1", "b2"]


def test_the_index_links_every_study(study):
    coefficient_study(study.folder.parent / "folder" / "coefficients")
    page = write_index_page(study.folder.parent).read_text()
    assert 'href="synthetic/report.html"' in page and 'href="folder/coefficients/report.html"' in page


def test_a_knob_that_only_some_methods_have_splits_no_group(study, tmp_path):
    blocks = np.where(study.columns["method"] == "n4sid_d2c", 0.0, np.nan)
    config = {**study.config, "axes": {**study.config["axes"], "method.blocks": [0, 8]}}
    manifest = {**study.manifest, "config": config}
    other = replace(study, manifest=manifest, columns={**study.columns, "method.blocks": blocks})
    groups = summarise(other)
    assert len(groups) == 27 and all(g.runs == 12 for g in groups)
    assert {g.values for g in groups if g.values[1] == 0.01} == {
        ("n4sid_d2c", 0.01, 0.0), ("variational_pem", 0.01, None), ("structured_ml", 0.01, None),
    }  # fmt: skip
    page = write_report(replace(other, folder=tmp_path), []).read_text()
    assert ">nan<" not in page and "method.blocks=nan" not in page


def test_the_head_counts_what_is_in_the_table_and_no_ratio_stands_without_a_bound(study, tmp_path):
    bare = {c: v for c, v in study.columns.items() if not c.endswith("_bound") and c != "method"}
    fewer = {c: v[study.columns["repetition"] < 5] for c, v in bare.items()}
    page = write_report(replace(study, folder=tmp_path, columns=fewer), []).read_text()
    assert "<b>5</b><span>repetitions per cell</span>" in page and "methods</span>" not in page
    assert "\u00d7" not in page
