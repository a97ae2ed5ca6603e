"""The exact comparison: red for every worsening, however small the error."""

from typing import Any

from sysid_bench.regress import compare_exact, reference_rows, text_of

LABELS = ["method", "repetition"]


def rows(**changes: Any) -> list[dict[str, Any]]:
    row = {
        "method": "arx",
        "repetition": 0,
        "status": "ok",
        "M_error": 3e-9,
        "D_error": 0.5,
        "pole_error": float("nan"),
    }
    return [row | changes, row | {"repetition": 1}]


def reference() -> list[dict[str, str]]:
    return [{k: text_of(v) for k, v in row.items()} for row in reference_rows(rows(), LABELS)]


def verdicts(**changes: Any) -> list[str]:
    return [c.verdict for c in compare_exact(rows(**changes), reference(), LABELS, rtol=1e-6)]


def test_the_same_table_is_the_same() -> None:
    assert verdicts() == []


def test_a_small_error_that_grows_a_little_is_worse() -> None:
    assert verdicts(M_error=3.0001e-9) == ["worse"]


def test_rounding_is_not_a_change() -> None:
    assert verdicts(D_error=0.5 * (1 + 1e-9)) == []


def test_a_smaller_error_is_better() -> None:
    assert verdicts(D_error=0.4) == ["better"]


def test_a_status_that_changes_counts_once() -> None:
    assert verdicts(status="diverged", D_error=None) == ["worse"]


def test_a_number_that_vanishes_is_worse() -> None:
    assert verdicts(D_error=float("nan")) == ["worse"]


def test_a_cell_that_vanishes_or_appears_is_worse() -> None:
    assert [c.verdict for c in compare_exact(rows()[:1], reference(), LABELS, 1e-6)] == ["worse"]
    assert [c.verdict for c in compare_exact(rows(), reference()[:1], LABELS, 1e-6)] == ["worse"]


def test_an_answer_in_place_of_a_refusal_wants_a_look_and_one_in_place_of_an_error_is_better() -> None:
    for before, verdict in (
        ("diverged", "worse"),
        ("not_applicable", "worse"),
        ("error", "better"),
        ("timeout", "better"),
    ):
        failed = [row | {"status": before} for row in reference()[:1]] + reference()[1:]
        assert [c.verdict for c in compare_exact(rows(), failed, LABELS, rtol=1e-6)] == [verdict]
