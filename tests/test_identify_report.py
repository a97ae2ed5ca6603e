"""The report of one identification: the free run is exact for the truth, and the page says what was found."""

import re
from dataclasses import replace

import numpy as np
import pytest

from sysid_bench.doors import view
from sysid_bench.mechanics.holds import propagate
from sysid_bench.mechanics.second_order import ntheta, pack, poles, state_space
from sysid_bench.nouns import LOST, Estimate, Model, Record
from sysid_bench.views.identify_figures import envelope, worst_stretch
from sysid_bench.views.identify_report import write_identify_report
from sysid_bench.views.simulated import fit_numbers, responses, simulate

M, D, K = np.diag([1.0, 2.0]), np.array([[0.4, -0.1], [-0.1, 0.3]]), np.array([[30.0, -10.0], [-10.0, 50.0]])
TRUTH = Estimate(M, D, K, poles=poles(M, D, K), seconds=0.1)


def recorded(
    hold: str = "foh", N: int = 2000, h: float = 0.02, noise: float = 0.0, x0=(0.3, -0.2, 0.0, 1.0)
) -> Record:
    rng = np.random.default_rng(8)
    u = np.cumsum(rng.standard_normal((N, 2)), axis=0) * 0.1
    A, B, C, Dd = state_space(M, D, K)
    y = propagate(A, B, u, h, hold, x0=np.array(x0)) @ C.T + u @ Dd.T + noise * rng.standard_normal((N, 2))
    return Record(np.arange(N) * h, u, y, hold=hold, units={"u": ["N", "N"], "y": ["m", "m"]})


@pytest.mark.parametrize("hold", ["zoh", "foh", "cubic", "bandlimited"])
def test_the_truth_meets_the_record_from_any_initial_state(hold):
    record = recorded(hold)
    found = simulate(record, Model(n=2), TRUTH)
    assert np.abs(found - record.y).max() < 1e-8 * np.abs(record.y).max()


def test_flagged_samples_do_not_disturb_the_initial_state():
    record = recorded()
    y, quality = record.y.copy(), np.zeros(record.N, np.uint8)
    y[5:9], quality[5:9] = np.nan, LOST
    found = simulate(replace(record, y=y, quality=quality), Model(n=2), TRUTH)
    assert np.abs(found - record.y).max() < 1e-8


def test_a_black_box_model_is_run_as_it_is():
    A, B, C, _ = state_space(M, D, K)
    from scipy.linalg import expm

    record = recorded("zoh")
    block = expm(np.block([[A, B], [np.zeros((2, 6))]]) * record.h)
    estimate = Estimate(state_space=(block[:4, :4], block[:4, 4:], C, np.zeros((2, 2)), record.h))
    assert np.abs(simulate(record, Model(n=2), estimate) - record.y).max() < 1e-9


@pytest.mark.parametrize("estimate", [Estimate(status="diverged"), replace(TRUTH, D=-50 * D)])
def test_what_cannot_be_run_is_not_drawn(estimate, tmp_path):
    assert simulate(recorded(), Model(n=2), estimate) is None
    assert write_identify_report(tmp_path, recorded(), Model(n=2), estimate)[0].is_file()


def test_uneven_times_give_a_report_without_a_simulation(tmp_path):
    record = recorded()
    uneven = replace(record, t=record.t + 0.004 * np.sin(np.arange(record.N)))
    assert simulate(uneven, Model(n=2), TRUTH) is None
    page = write_identify_report(tmp_path, uneven, Model(n=2), TRUTH)[0].read_text()
    assert "<h2>Fit</h2>" not in page and "stiffness" in page


def test_fit_is_100_for_the_truth_and_0_for_the_mean():
    y = recorded().y
    assert fit_numbers(y, y)[0][0] == 100
    assert fit_numbers(y, np.broadcast_to(y.mean(0), y.shape))[1][0] == pytest.approx(0, abs=1e-9)


def test_cross_spectra_find_the_static_gain():
    rng = np.random.default_rng(2)
    u, G = rng.standard_normal((4000, 2)), np.array([[1.0, 2.0], [0.0, -3.0], [0.5, 0.5]])
    _, found, seen = responses(u, u @ G.T, 0.1, 200)
    assert seen.all() and np.allclose(found, G, atol=1e-9)


def test_the_worst_stretch_and_the_envelope_hold_the_outlier():
    x = np.zeros((10000, 1))
    x[7123] = 5.0
    stretch = worst_stretch(x)
    assert stretch.start <= 7123 < stretch.stop
    _, low, high = envelope(np.arange(10000.0), x[:, 0])
    assert len(high) == 800 and high.max() == 5.0 and low.min() == 0.0


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    out = tmp_path_factory.mktemp("identified")
    covariance = np.diag((0.01 * np.abs(pack(M, D, K)) + 1e-4) ** 2)
    assert len(covariance) == ntheta(2)
    estimate = replace(
        TRUTH, covariance=covariance, diagnostics={"remarks": ["the record is short"], "iterations": 4}
    )
    (out / "estimate.json").write_text('{"method": "structured_ml", "origin": {"seed": 8}}')
    paths = write_identify_report(out, recorded(noise=0.01), Model(M, D, K), estimate)
    assert all(p.is_file() for p in paths)
    return out


def test_the_page_says_what_was_found(folder):
    page = (folder / "report.html").read_text()
    for words in (
        "Identification by structured_ml",
        "30 <small>± 0.59</small>",
        "the record is short",
        "seed",
    ):
        assert words in page
    assert {p.stem for p in (folder / "figures").glob("*.svg")} == {
        "fit",
        "spectra",
        "responses",
        "parameters",
    }
    assert all(a.startswith("data:") for a in re.findall(r'(?:src|href)="([^"]*)"', page))


def test_view_finds_the_recording_of_an_identification(folder, tmp_path):
    assert view.recording_of(folder, tmp_path) == folder / "identify.rrd"
