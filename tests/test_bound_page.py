"""The page on the bound says S, failures, shares near the bound, one line per point of a study."""

from __future__ import annotations

import json

from sysid_bench.table import write_table
from sysid_bench.views.bound_page import bound_page, main


def study(folder, name: str, rows: list[dict], **config) -> None:
    (folder / name).mkdir(parents=True)
    manifest = {"study": name, "question": "How near?", "config": config}
    (folder / name / "manifest.json").write_text(json.dumps(manifest))
    write_table(rows, folder / name / "table.parquet")


def row(ratio: float, snr: float, status: str = "ok", **more) -> dict:
    ratios = {f"{X}_over_bound": ratio for X in "MDK"}
    return {
        "plant": "eight_dof",
        "analysis.snr_db": snr,
        "status": status,
        "worst_over_bound": ratio,
        **ratios,
        **more,
    }


def test_a_line_per_point_with_S_failures_and_the_share_near_the_bound(tmp_path) -> None:
    more = {
        "truth_ahead": 0.0,
        **{f"{X}_over_bound_from_truth": 1.0 for X in "MDK"},
        "worst_over_bound_from_truth": 1.0,
    }
    rows = [
        row(3.0, 0.0, **more),
        row(1.0, 0.0, **more),
        row(float("nan"), 0.0, "diverged"),
        row(1.0, -10.0, **more),
    ]
    study(tmp_path, "at_the_bound/low_snr", rows, axes={"analysis.snr_db": [0.0, -10.0]})
    page = bound_page(tmp_path)
    assert "| condition | runs | failed | S of M / D / K | near |" in page
    assert "| snr_db 0 | 3 | 1 | 2.24 / 2.24 / 2.24 | 33 % | 1.00 / 1.00 / 1.00 | 67 % | 67 % |" in page
    assert "| snr_db -10 | 1 | 0 |" in page and "experiment=at_the_bound/low_snr" in page


def test_methods_show_their_errors_and_absent_ones_that_they_do_not_apply(tmp_path) -> None:
    ok = row(2.0, 15.0, method="a", fit_s=0.02, pole_error=0.001, **{f"{X}_error": 0.01 for X in "MDK"})
    absent = row(
        float("nan"), 15.0, "not_applicable", method="b", fit_s=float("nan"), pole_error=float("nan")
    )
    study(tmp_path, "peers/peers", [ok, ok | {"fit_s": 0.5}, absent], axes={"method": ["a", "b"]})
    page = bound_page(tmp_path)
    assert "| median error of the poles, % | ms, fastest run |" in page
    assert "| a | 2 | 0 | 2.00 / 2.00 / 2.00 | 1 / 1 / 1 | 0.1 | 20 | 0 % |" in page
    assert "| b | 1 | 1 (does not apply) |" in page


def test_orders_show_how_often_they_are_right(tmp_path) -> None:
    rows = [{"plant": p, "status": "ok", "right": float(x)} for p, x in (("one", 1), ("one", 0), ("two", 1))]
    study(tmp_path, "at_the_bound/order_selection", rows, cases=[{"plant": "one"}, {"plant": "two"}])
    assert "| one | 2 | 0 | 50 % |" in bound_page(tmp_path)


def test_a_study_of_one_point_has_one_line(tmp_path) -> None:
    study(tmp_path, "at_the_bound/low_snr", [row(1.0, 0.0), row(2.0, 0.0)])
    assert "| 2 | 0 | 1.58 / 1.58 / 1.58 | 50 % |" in bound_page(tmp_path)


def test_no_study_is_one_message(tmp_path, capsys) -> None:
    assert main([str(tmp_path), str(tmp_path / "page.md")]) == 2
    assert "make bound" in capsys.readouterr().err
