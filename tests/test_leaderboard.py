"""The leaderboard says S, failures and milliseconds of every method, best first."""

from sysid_bench.views.leaderboard import leaderboard, main


def row(method: str, ratio: float, status: str = "ok", h: float = 0.1) -> dict:
    return {
        "method": method, "plant": "three_dof", "noise.snr_db": 15.0, "sampling.h_s": h, "status": status, "fit_s": 0.02,
        **{f"{x}_over_bound": ratio for x in "MDK"},
    }  # fmt: skip


def test_best_first_failures_counted_root_mean_square() -> None:
    page = leaderboard([row("b", 30.0), row("a", 3.0), row("a", 4.0), row("a", float("nan"), "diverged")])
    assert page.index("| a |") < page.index("| b |")
    assert "3.54 / 3.54 / 3.54, 1 of 3 fail | 20 |" in page and "## three_dof, 15 dB" in page


def test_a_few_wild_runs_do_not_hide_the_median() -> None:
    assert "(median 1.00 / 1.00 / 1.00)" in leaderboard([row("a", 1.0), row("a", 1.0), row("a", 100.0)])


def test_the_time_is_that_of_the_fastest_run_of_a_point() -> None:
    rows = [
        row("a", 1.0) | {"fit_s": s, "sampling.h_s": h}
        for s, h in ((9.0, 0.1), (0.1, 0.1), (0.3, 0.2), (0.2, 0.3))
    ]
    assert "| 200 |" in leaderboard(rows)


def test_a_missing_study_is_named(tmp_path, capsys) -> None:
    assert main([str(tmp_path), str(tmp_path / "page.md")]) == 2
    assert "experiment=at_the_bound/leaderboard" in capsys.readouterr().err
