"""Every noise: its variance, its spectrum, its rounding, and how noises add up."""

import numpy as np
import pytest

from sysid_bench.noises.coloured import Coloured
from sysid_bench.noises.none import NoNoise
from sysid_bench.noises.quantisation import Quantisation
from sysid_bench.noises.sum import Sum
from sysid_bench.noises.white import White
from sysid_bench.nouns import InputError

N = 40000
Y = np.sin(0.1 * np.arange(N))[:, None] * np.array([1.0, 5.0])


def added(noise, seed=0, y=Y):
    measured, variance = noise.apply(y, 0.1, np.random.default_rng(seed))
    return measured - y, variance


@pytest.mark.parametrize("snr_db", [15.0, [10.0, 30.0]])
@pytest.mark.parametrize("kind", [White, Coloured])
def test_noise_has_its_ratio_per_channel(kind, snr_db):
    e, variance = added(kind(snr_db))
    assert np.allclose(10 * np.log10(Y.var(axis=0) / variance), snr_db)
    assert np.allclose(e.var(axis=0), variance, rtol=0.1)
    assert abs(np.corrcoef(e.T)[0, 1]) < 0.1


def test_white_noise_is_white_and_ar_noise_is_not():
    def correlation(e):
        return np.corrcoef(e[1:, 0], e[:-1, 0])[0, 1]

    assert abs(correlation(added(White())[0])) < 0.02
    assert np.isclose(correlation(added(Coloured(ar=[-0.9]))[0]), 0.9, atol=0.02)
    assert np.isclose(correlation(added(Coloured(corner_hz=1.0))[0]), np.exp(-2 * np.pi * 0.1), atol=0.02)


@pytest.mark.parametrize(
    "noise", [Coloured(ar=[-0.99]), Coloured(order=2, corner_hz=0.2), Coloured(order=2, zeta=2.0)]
)
def test_coloured_noise_is_stationary_from_the_start(noise):
    starts = np.array([added(noise, seed, Y[:50])[0][0] for seed in range(600)])
    _, variance = added(noise, 0, Y[:50])
    assert np.allclose(starts.var(axis=0), variance, rtol=0.25)


def test_second_order_noise_has_its_resonance():
    e, _ = added(Coloured(order=2, corner_hz=1.0, zeta=0.05))
    power = np.abs(np.fft.rfft(e[:, 0])) ** 2
    peak = np.fft.rfftfreq(N, 0.1)[np.argmax(np.convolve(power, np.ones(50), "same"))]
    assert np.isclose(peak, 1.0, rtol=0.05)


def test_quantisation_is_that_of_a_converter():
    e, variance = added(Quantisation(12, range=10.0))
    lsb = 20 / 4096
    assert np.abs(e).max() <= lsb / 2 + 1e-12 and np.allclose(variance, lsb**2 / 12, rtol=0.05)
    measured = Quantisation(8, range=2.0).apply(Y, 0.1, np.random.default_rng(0))[0]
    assert np.allclose(measured / (4 / 256), np.rint(measured / (4 / 256)))
    assert measured[:, 1].max() == 2 - 4 / 256 and measured[:, 1].min() == -2
    own = added(Quantisation(12))[1]
    assert np.isclose(own[1] / own[0], 25, rtol=0.2)


def test_no_noise_is_none():
    e, variance = added(NoNoise())
    assert np.all(e == 0) and np.all(variance == 0)


def test_noises_add_up_and_the_converter_comes_last():
    e, variance = added(Sum([White(15.0), Coloured(15.0)]))
    assert np.allclose(variance, 2 * Y.var(axis=0) / 10**1.5) and np.allclose(
        e.var(axis=0), variance, rtol=0.1
    )
    measured, total = Sum([White(30.0), Quantisation(10, range=8.0)]).apply(Y, 0.1, np.random.default_rng(1))
    lsb = 16 / 1024
    assert np.allclose(measured / lsb, np.rint(measured / lsb))
    assert np.allclose(total, Y.var(axis=0) / 1e3 + lsb**2 / 12, rtol=0.05)


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: White([1.0, 2.0, 3.0]), "each of the 2 outputs"),
        (lambda: White(np.nan), "finite"),
        (lambda: Coloured(ar=[-1.1]), "not stable"),
        (lambda: Quantisation(range=-1.0), "range"),
    ],
)
def test_wrong_settings_are_refused(make, words):
    with pytest.raises(InputError, match=words):
        make().apply(Y[:100], 0.1, np.random.default_rng(0))


def test_settings_that_are_wrong_by_themselves():
    with pytest.raises(InputError, match="order"):
        Coloured(order=3)
    with pytest.raises(InputError, match="bits"):
        Quantisation(0)
    with pytest.raises(InputError, match="constant"):
        White().apply(np.ones((10, 1)), 0.1, np.random.default_rng(0))
