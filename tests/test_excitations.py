"""Every excitation: levels, periods, spectra, and that the plant's response to it is exact between samples."""

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

from sysid_bench.excitations.chirp import Chirp
from sysid_bench.excitations.cubic_noise import CubicNoise
from sysid_bench.excitations.multisine import Multisine
from sysid_bench.excitations.prbs import PRBS
from sysid_bench.excitations.sines import Sines
from sysid_bench.excitations.steps import Steps
from sysid_bench.excitations.white_noise import WhiteNoise
from sysid_bench.mechanics.bandlimited import evaluate, input_lines
from sysid_bench.mechanics.signals import crest_factor
from sysid_bench.nouns import InputError


def rng(seed=0):
    return np.random.default_rng(seed)


def lines_in(u, P):
    """Bins of one period that carry anything."""
    size = np.abs(np.fft.rfft(u[:P]))
    return set(np.flatnonzero(size > 1e-9 * size.max()))


def test_maximum_length_sequence_has_its_period_and_its_autocorrelation():
    signal = PRBS(register_bits=6, clock_samples=3, amplitude_N=2.0).signal(600, 0.1, 2, rng())
    assert signal.period == 63 * 3 and set(np.unique(signal.u)) == {-2.0, 2.0} and signal.hold == "zoh"
    assert np.array_equal(signal.u[:189], signal.u[189:378])
    ticks = signal.u[:189:3, 0] / 2
    for shift in (1, 7, 40):
        assert np.isclose(ticks @ np.roll(ticks, shift), -1)
    assert abs(ticks.sum()) == 1
    other = signal.u[:189:3, 1] / 2
    assert np.array_equal(np.roll(other, 31), ticks)


def test_the_register_grows_with_the_record():
    signal = PRBS().signal(1000, 0.1, 1, rng())
    assert signal.period is None  # 1023 ticks
    assert PRBS(register_bits=4).signal(1000, 0.1, 1, rng()).period == 15


def test_random_binary_is_white_and_clocked():
    u = PRBS("random", clock_s=0.4, amplitude_N=0.5).signal(8000, 0.1, 2, rng()).u
    assert set(np.unique(u)) == {-0.5, 0.5}
    assert np.all(np.diff(u.reshape(2000, 4, 2), axis=1) == 0)
    assert abs(np.corrcoef(u[::4].T)[0, 1]) < 0.08 and abs(np.mean(u)) < 0.02


def test_white_noise_has_its_rms_per_input():
    u = WhiteNoise([1.0, 3.0]).signal(20000, 0.1, 2, rng()).u
    assert np.allclose(u.std(axis=0), [1, 3], rtol=0.03)


def test_cubic_noise_is_the_spline_through_its_knots_and_its_samples():
    signal = CubicNoise(1.0, 2.0).signal(401, 0.05, 2, rng())
    t = 0.05 * np.arange(401)
    assert signal.hold == "cubic"
    dense = np.linspace(0, 20, 3001)
    through_knots, through_samples = CubicSpline(t[::20], signal.u[::20]), CubicSpline(t, signal.u)
    assert np.allclose(through_knots(dense), through_samples(dense), atol=1e-12)
    assert np.isclose(CubicNoise(0.1, 2.0).signal(20000, 0.1, 1, rng()).u.std(), 2, rtol=0.03)


@pytest.mark.parametrize("h", [0.3, 2.0, 0.07])
def test_cubic_noise_refuses_samples_that_miss_the_knots(h):
    with pytest.raises(InputError, match=r"sampling\.h_s must divide excitation\.knot_spacing_s"):
        CubicNoise(1.0).signal(100, h, 1, rng())


@pytest.mark.parametrize("grid", ["full", "odd", "odd_random"])
def test_multisine_drives_the_lines_it_says(grid):
    signal = Multisine(grid, periods=3, f_min_hz=0.1, f_max_hz=1.0, rms_N=2.0).signal(1200, 0.1, 2, rng())
    P, lines = signal.period, lines_in(signal.u[:, 0], signal.period)
    assert P == 400 and np.allclose(signal.u[:800], signal.u[400:1200])
    assert np.allclose(signal.u[:P].std(axis=0), 2.0) and lines == lines_in(signal.u[:, 1], P)
    band = set(range(4, 41))
    if grid == "full":
        assert lines == band
    else:
        odd = {k for k in band if k % 2}
        assert lines == odd if grid == "odd" else lines < odd and len(lines) == len(odd) - len(odd) // 4


def test_multisine_says_what_it_is_between_samples():
    signal = Multisine(periods=2, f_max_hz=1.5).signal(250, 0.1, 2, rng())
    omega, amplitude = signal.series
    t = 0.1 * np.arange(250)
    direct = (np.exp(1j * np.outer(t, omega)) @ amplitude).real
    assert np.allclose(signal.u, direct, atol=1e-11)
    again = input_lines(signal.u, 0.1, signal.period)
    fine = [
        evaluate(lines._replace(period=None), lines.amplitude, 999, 0.0123)
        for lines in (again, input_lines(None, 0.1, 125, signal.series))
    ]
    assert np.allclose(*fine, atol=1e-11)


def test_multisine_lines_of_its_own_per_input():
    u = Multisine(own_lines=True).signal(300, 0.1, 3, rng()).u
    lines = [lines_in(channel, 300) for channel in u.T]
    assert not lines[0] & lines[1] and not lines[1] & lines[2] and len(set.union(*lines)) == 149


def test_crest_factor_comes_down_and_the_amplitudes_stay():
    plain = Multisine(f_max_hz=1.0).signal(1000, 0.1, 1, rng()).u[:, 0]
    low = Multisine(f_max_hz=1.0, crest_iterations=100).signal(1000, 0.1, 1, rng()).u[:, 0]
    assert crest_factor(low) < 2.0 < 2.5 < crest_factor(plain)
    assert np.allclose(np.abs(np.fft.rfft(low)), np.abs(np.fft.rfft(plain)), atol=1e-8)


def test_chirp_sweeps_through_its_band_input_by_input():
    u = Chirp(0.5, 2.0, taper=0.1).signal(4000, 0.02, 2, rng()).u
    assert np.all(u[:2000, 1] == 0) and np.all(u[2000:, 0] == 0) and np.abs(u).max() <= 1
    power = np.abs(np.fft.rfft(u[:2000, 0])) ** 2
    f = np.fft.rfftfreq(2000, 0.02)
    assert power[(f > 0.4) & (f < 2.2)].sum() > 0.98 * power.sum()
    early, late = (np.sum(np.diff(np.sign(part)) != 0) for part in (u[:600, 0], u[1400:2000, 0]))
    assert late > 2 * early


def test_steps_walk_their_staircase():
    signal = Steps([1.0, -0.5], dwell_s=0.3, amplitude_N=[2.0, 4.0]).signal(30, 0.1, 2, rng())
    assert signal.u[:, 0].tolist()[:12] == [2, 2, 2, -1, -1, -1, 0, 0, 0, 0, 0, 0]
    assert signal.u[:, 1].tolist()[:12] == [0, 0, 0, 0, 0, 0, 4, 4, 4, -2, -2, -2]
    assert signal.period == 12 and signal.hold == "zoh"


def test_sines_fit_the_record_or_run_as_given():
    fitted = Sines([0.11, 0.5], [1.0, 2.0], phases_rad=[0.0, 1.0]).signal(100, 0.1, 1, rng())
    assert lines_in(fitted.u[:, 0], 100) == {1, 5} and fitted.period == 100
    t = 0.1 * np.arange(100)
    given = Sines([0.11], whole_periods=False, phases_rad=[0.0]).signal(100, 0.1, 2, rng())
    assert given.hold == "cubic" and np.allclose(given.u[:, 1], np.cos(2 * np.pi * 0.11 * t))


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: PRBS("gold"), "maximum_length, random"),
        (lambda: PRBS(register_bits=40), "2 to 20"),
        (lambda: PRBS(clock_s=0.25).signal(10, 0.1, 1, rng()), "clock_s"),
        (lambda: WhiteNoise(clock_samples=0).signal(10, 0.1, 1, rng()), "clock_samples"),
        (lambda: WhiteNoise([1.0, 2.0]).signal(10, 0.1, 3, rng()), "rms_N"),
        (lambda: Multisine("even"), "full, odd"),
        (lambda: Multisine(periods=0), "periods"),
        (lambda: Multisine(f_min_hz=4.0, f_max_hz=3.0).signal(100, 0.1, 1, rng()), "Widen|widen"),
        (lambda: Multisine(periods=100).signal(100, 0.1, 1, rng()), "widen"),
        (lambda: Chirp(sweep="cubic"), "linear, logarithmic"),
        (lambda: Chirp(taper=2.0), "taper"),
        (lambda: Chirp(f_end_hz=9.0).signal(100, 0.1, 1, rng()), "half the sampling rate"),
        (lambda: Steps(dwell_s=0.01).signal(10, 0.1, 1, rng()), "dwell"),
        (lambda: Sines([7.0]).signal(10, 0.1, 1, rng()), "half the sampling rate"),
    ],
)
def test_what_cannot_be_is_refused(make, words):
    with pytest.raises(InputError, match=words):
        make()
