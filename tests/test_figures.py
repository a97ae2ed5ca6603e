"""A study's table becomes figures that show what is in it."""

import json
from dataclasses import replace

import numpy as np
import pytest
from make_study import coefficient_study, sweep_study

from sysid_bench.doors.sweep import check_figures
from sysid_bench.nouns import InputError
from sysid_bench.views.figures import draw, runs_line, write_figures
from sysid_bench.views.spec import left_out, read_figure, standard_figures, study_figures
from sysid_bench.views.strip import failure_share
from sysid_bench.views.study import curve, read_study, where
from sysid_bench.views.style import COLOURS, MARKERS, look, publication, wrapped


@pytest.fixture(scope="module")
def study(tmp_path_factory):
    return read_study(sweep_study(tmp_path_factory.mktemp("sweep") / "synthetic"))


def test_a_curve_is_the_median_of_the_runs_with_an_estimate(study):
    rows = where(study.columns, {"method": "variational_pem"})
    data = curve(study.columns, "sampling.h_s", "M_error", rows)
    here = rows & (study.columns["sampling.h_s"] == 0.005) & (study.columns["status"] == "ok")
    assert data.x[0] == 0.005 and data.runs[0] == 12
    assert data.missing[0] == 12 - here.sum() > 0
    assert data.median[0] == np.median(study.columns["M_error"][here])
    assert np.all(data.low <= data.median) and np.all(data.median <= data.high)


def test_an_x_where_every_run_failed_has_no_median():
    columns = {"x": np.ones(3), "y": np.full(3, np.nan), "status": np.array(["diverged"] * 3, dtype=object)}
    data = curve(columns, "x", "y", np.ones(3, bool))
    assert np.isnan(data.median[0]) and data.missing[0] == 3


def test_runs_where_a_method_does_not_apply_are_no_failures():
    columns = {"x": np.ones(4), "status": np.array(["ok", "ok", "timeout", "not_applicable"], dtype=object)}
    study = type("S", (), {"columns": columns})
    assert failure_share(study, "x", np.ones(4, bool))[1][0] == pytest.approx(1 / 3)


def test_figures_are_written_alike_twice(study):
    first = {p: p.read_bytes() for p in write_figures(study)}
    assert [p.name for p in first] == ["errors.png", "errors.svg"]
    assert {p: p.read_bytes() for p in write_figures(study)} == first


def test_drawn_lines_hold_the_medians_and_the_bound(study):
    with publication() as plt:
        figure = draw(plt, study, study_figures(study)[0])
        lines = [np.asarray(line.get_ydata(), float) for line in figure.axes[0].lines]
        words = [text.get_text() for text in figure.legends[0].get_texts()]
    rows = where(study.columns, {"method": "n4sid_d2c"})
    median = curve(study.columns, "sampling.h_s", "M_error", rows).median
    assert any(len(y) == len(median) and np.array_equal(y, median) for y in lines)
    assert words == ["n4sid + d2c", "variational PEM", "structured ml", "Cramér-Rao bound (rms)"]


def test_each_figure_says_how_many_runs_it_shows(study):
    spec = study_figures(study)[0]
    line = runs_line(study, spec, np.ones(study.rows, bool))
    assert line == "median and 10-90 % range of 12 runs per point; open mark: some runs gave no estimate"


def test_coefficients_lie_beside_theory_and_the_marks(tmp_path):
    study = read_study(coefficient_study(tmp_path / "coefficients"))
    with publication() as plt:
        figure = draw(plt, study, study_figures(study)[0])
        texts = [text.get_text().strip() for text in figure.axes[0].texts]
        words = [text.get_text() for text in figure.legends[0].get_texts()]
        limits = figure.axes[0].get_ylim()
    assert texts == ["Shannon", "π/ω_d"] and words[-1] == "theory" and limits == (-2.2, 1.6)


def test_a_study_without_figures_gets_the_errors_against_its_axis(study, tmp_path):
    manifest = {**study.manifest, "config": {**study.config, "figures": []}}
    (tmp_path / "manifest.json").write_text(json.dumps(manifest))
    (tmp_path / "table.parquet").write_bytes((study.folder / "table.parquet").read_bytes())
    (spec,) = standard_figures(read_study(tmp_path))
    assert spec.x == "sampling.h_s" and spec.x_log and [p.y[0][0] for p in spec.panels] == list("MKDA")


@pytest.mark.parametrize(
    ("node", "word"),
    [
        ({"name": "a", "x": "h", "panels": [{"y": "e"}], "lines": 1}, "unknown key 'lines'"),
        ({"name": "a", "panels": [{"y": "e"}]}, "needs the key 'x'"),
        ({"name": "a", "x": "h", "panels": [{"label": "e"}]}, "needs the key 'y'"),
        (
            {"name": "a", "x": "h", "panels": [{"y": ["a", "b", "c"], "theory": ["d", "e"]}]},
            "one for each of a, b, c",
        ),
    ],
)
def test_a_wrong_spec_is_refused_with_the_way_out(node, word):
    with pytest.raises(InputError, match=word):
        read_figure(node)


def test_a_missing_column_is_named(study):
    spec = read_figure({"name": "a", "x": "sampling.h_s", "panels": [{"y": "Z_error"}]})
    with publication() as plt, pytest.raises(InputError, match="no column 'Z_error'"):
        draw(plt, study, spec)


def test_a_figure_whose_column_no_run_returned_is_left_out_with_the_reason(study):
    figures = [*study.config["figures"], {"name": "b", "x": "sampling.h_s", "panels": [{"y": "Z_error"}]}]
    other = replace(study, manifest={**study.manifest, "config": {**study.config, "figures": figures}})
    assert [spec.name for spec in study_figures(other)] == ["errors"]
    assert left_out(other) == ["figure b: the table has no column Z_error."]


def test_a_folder_that_is_no_study_is_refused(tmp_path):
    with pytest.raises(InputError, match=r"manifest\.json is missing"):
        read_study(tmp_path)


def test_no_two_series_share_a_colour_or_a_mark():
    assert len(set(COLOURS)) == len(COLOURS) and len(set(MARKERS)) == len(MARKERS)
    assert len({(look(i)["color"], look(i)["marker"]) for i in range(88)}) == 88


def test_a_wrong_figure_is_refused_before_the_work():
    with pytest.raises(InputError, match="unknown key 'lines'"):
        check_figures(
            {"views": True, "figures": [{"name": "a", "x": "h", "panels": [{"y": "e"}], "lines": 1}]}
        )


def test_long_labels_break_into_like_lines_but_not_inside_mathematics():
    assert wrapped("relative error of M") == "relative error of M"
    assert wrapped("relative error of c (absolute for c = 0)") == "relative error of c\n(absolute for c = 0)"
    assert "$G + G^H$" in wrapped("smallest eigenvalue of the Hermitian part $G + G^H$, relative")


def test_rows_without_the_knob_on_the_x_axis_are_not_drawn():
    columns = {
        "x": np.array([1.0, np.nan, 1.0]),
        "y": np.array([1.0, 7.0, 3.0]),
        "status": np.array(["ok"] * 3, object),
    }
    data = curve(columns, "x", "y", np.ones(3, bool))
    assert list(data.x) == [1.0] and list(data.median) == [2.0]
