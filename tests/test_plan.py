"""The plan: grid, seeds and keys."""

from typing import Any

import pytest

from sysid_bench.nouns import InputError
from sysid_bench.plan import Option, Study, tasks

NODES: dict[str, dict[str, Any]] = {
    "plant": {
        "_target_": "sysid_bench.nouns.Plant",
        "mass": [[1.0]],
        "damping": [[0.1]],
        "stiffness": [[1.0]],
    },
    "excitation": {"level_N": 1.0},
    "noise": {"snr_db": 15.0},
    "sampling": {"_target_": "sysid_bench.nouns.Sampling", "h_s": 0.1, "N": 100},
    "source": {},
}


def method(name: str, horizon: int = 10) -> Option:
    return Option(name, {"name": name, "horizon": horizon})


def study(**changes: Any) -> Study:
    settings: dict[str, Any] = {
        "name": "s",
        "question": "",
        "kind": "identify",
        "repetitions": 2,
        "seed": 7,
        "base": {g: Option(g, n) for g, n in NODES.items()},
        "options": {("method", name): method(name) for name in ("one", "two")},
        "axes": {"method": ["one", "two"], "sampling.h_s": [0.1, 0.2]},
    }
    return Study(**{**settings, **changes})


def keys(**changes: Any) -> set[str]:
    return {cell.key for task in tasks(study(**changes)) for cell in task.cells}


def test_a_record_is_shared_by_all_methods() -> None:
    found = list(tasks(study()))
    assert len(found) == 4
    assert all(len(task.cells) == 2 for task in found)
    assert len({task.record_key for task in found}) == 4
    assert len(keys()) == 8


def test_seeds_do_not_depend_on_methods_or_their_order() -> None:
    few = study(axes={"sampling.h_s": [0.2], "method": ["two"]})
    assert [t.seed for t in tasks(few)] == [t.seed for t in tasks(study())][2:]
    assert len({t.seed for t in tasks(study())}) == 4


def test_keys_do_not_depend_on_the_order_of_knobs_or_axes() -> None:
    turned = {g: Option(g, dict(reversed(n.items()))) for g, n in NODES.items()}
    assert keys() == keys(base=turned)
    assert keys() == keys(axes={"sampling.h_s": [0.2, 0.1], "method": ["two", "one"]})


def test_a_changed_knob_changes_exactly_its_cells() -> None:
    changed = keys(options={("method", "one"): method("one", 11), ("method", "two"): method("two")})
    assert len(keys() & changed) == 4 and len(keys() - changed) == 4


def test_cases_set_several_keys_at_once() -> None:
    cases = [{"sampling.h_s": 1.0, "noise.snr_db": 8.0}, {"sampling.h_s": 0.5, "noise.snr_db": 20.0}]
    found = list(tasks(study(cases=cases, axes={"method": ["one"]}, repetitions=1)))
    assert [(t.labels["sampling.h_s"], t.labels["noise.snr_db"]) for t in found] == [(1.0, 8.0), (0.5, 20.0)]


def test_cases_that_differ_in_the_method_share_their_records() -> None:
    cases = [{"method": "one"}, {"method": "two", "method.horizon": 20}]
    found = list(tasks(study(cases=cases, axes={"sampling.h_s": [0.1, 0.2]}, repetitions=1)))
    assert [len(task.cells) for task in found] == [2, 2]
    assert len({cell.key for task in found for cell in task.cells}) == 4


def test_only_keeps_the_part_asked_for() -> None:
    only = {"method": "two", "sampling.h_s": "0.1", "repetition": "1"}
    found = [cell for task in tasks(study(only=only)) for cell in task.cells]
    assert [cell.labels["method"] for cell in found] == ["two"]
    assert found[0].key in keys()


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"axes": {"method": ["one"], "noise.snr": [1]}}, "noise=noise has no knob 'snr'; it has snr_db"),
        ({"axes": {"method": ["one"], "nose.snr_db": [1]}}, "no group 'nose'"),
        ({"axes": {"method": []}}, "list of at least one"),
        ({"axes": {"sampling.h_s": [1.0]}}, "needs method="),
        ({"repetitions": 0}, "repetitions"),
        ({"kind": "guess"}, "identify, analysis"),
    ],
)
def test_a_wrong_study_is_refused_in_words(changes: dict[str, Any], words: str) -> None:
    with pytest.raises(InputError, match=words):
        list(tasks(study(**changes)))
