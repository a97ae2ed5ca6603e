"""a positioning system in closed loop, simulated -> is what it lacks named right from its force?

    python experiments/measured_machines/closed_loop.py 100 40     # first seed, trials

An engine of its own: leapfrog, friction as a steep slope, a delay line. Encoder noise, effects and their sizes are drawn; the nominal mass is up to 20 %
off, the damping up to 30 %.
"""

from __future__ import annotations

import sys
from collections import Counter
from typing import Any

import numpy as np

from sysid_bench.gap.answer import Answer
from sysid_bench.gap.workflow import find_gap
from sysid_bench.nouns import Model, Record

H, FINE = 1e-3, 10  # sampling time in s, small steps per sample
MASS, DAMPING, PITCH = 95.0, 200.0, 2.5e-3


def moves(N):
    """(N,) m: there and back at two speeds, with pauses."""
    corners = [(0.0, 0.0), (0.5, 0.0), (1.7, 0.12), (2.2, 0.12), (3.4, 0.0), (3.9, 0.0), (6.3, 0.12), (6.8, 0.12), (9.2, 0.0), (10, 0.0)]  # fmt: skip
    path = np.interp(H * np.arange(N), *np.array(corners).T)
    smooth = np.hanning(201)
    return np.convolve(np.pad(path, 100, "edge"), smooth / smooth.sum(), "valid")


def closed_loop(
    rng,
    coulomb=0.0,
    asymmetry=0.0,
    ripple=0.0,
    phase=0.0,
    delay=0,
    pulses=0.0,
    stretch=1.0,
    other=None,
    N=10_000,
):
    """Record of a positioning system under two nested proportional controllers; delay in samples; other: force of x, v.

    Leapfrog at a tenth of the sampling time; friction as a steep slope, not the catalogue's law.
    """
    reference, u, y = stretch * moves(N), np.zeros(N), np.zeros(N)
    x, v, before, line = 0.0, 0.0, 0.0, np.zeros(delay + 1)

    def acceleration(x, v, force):
        friction = coulomb * min(max(v / 2e-4, -1), 1) + asymmetry * abs(v) + (other(x, v) if other else 0.0)
        return (force - DAMPING * v - friction + ripple * np.sin(2 * np.pi * x / PITCH + phase)) / MASS

    kicks = pulses * ((np.arange(N) // 700) % 3 == 1)
    for k in range(N):
        y[k] = x + 1e-7 * rng.standard_normal()
        speed = (y[k] - before) / H if k else 0.0
        before = y[k]
        u[k] = 6000 * (60 * (reference[k] - y[k]) - speed) + kicks[k]
        line = np.append(line[1:], u[k])
        for _ in range(FINE):
            v += H / FINE / 2 * acceleration(x, v, line[0])
            x += H / FINE * v
            v += H / FINE / 2 * acceleration(x, v, line[0])
    return Record(H * np.arange(N), u[:, None], y[:, None], hold="zoh")


NAMES = {
    "coulomb": "coulomb_friction",
    "asymmetry": "asymmetric_friction",
    "delay": "input_delay",
    "ripple": "position_ripple",
}
KINDS = (
    (), ("coulomb",), ("delay",), ("ripple",), ("asymmetry",), ("coulomb", "delay"), ("coulomb", "ripple"),
    ("coulomb", "asymmetry"), ("coulomb", "asymmetry", "delay", "ripple"), ("other",),
)  # fmt: skip


def shape(x: float, v: float) -> float:
    """A force that no catalogue names."""
    return 6e5 * x * x * v


def drawn(rng: np.random.Generator, kind: tuple[str, ...]) -> dict[str, Any]:
    """Sizes of what is missing: N, N s/m, samples, N."""
    sizes = {
        "coulomb": float(rng.uniform(5, 40)),
        "asymmetry": float(rng.choice([-1, 1]) * rng.uniform(30, 90)),
        "delay": int(rng.integers(1, 4)),
        "ripple": float(rng.uniform(2, 6)),
        "other": shape,
    }
    return {key: sizes[key] for key in kind}


def noisy(record: Record, sigma: float, rng: np.random.Generator) -> Record:
    return Record(record.t, record.u, record.y + sigma * rng.standard_normal(record.y.shape), hold="zoh")


def trial(seed: int) -> tuple[tuple[str, ...], Answer]:
    """What was missing, and the answer."""
    rng = np.random.default_rng(seed)
    kind = KINDS[seed % len(KINDS)]
    lacking, sigma = drawn(rng, kind), 10 ** rng.uniform(-7.3, -6.0)
    runs = [
        closed_loop(rng, phase=rng.uniform(0, 6), pulses=pulses, stretch=stretch, **lacking)
        for pulses, stretch in ((0.0, 1.0), (40.0, 0.9))
    ]
    train, test = (noisy(run, sigma, rng) for run in runs)
    mass, damping = MASS * rng.uniform(0.8, 1.2), DAMPING * rng.uniform(0.7, 1.3)
    return kind, find_gap([train], [test], Model([[mass]], [[damping]], [[0.0]], hold="zoh"), power=False)


def right(kind: tuple[str, ...], answer: Answer) -> bool:
    """The verdict and the names, no more and no less."""
    if kind == ("other",):
        return answer.verdict.word == "unknown"
    named = {e.name for e in answer.added}
    return named == {NAMES[key] for key in kind} and (answer.verdict.word == "effect") == bool(kind)


def main() -> int:
    first, count = (int(x) for x in (sys.argv[1:] or ["100", "40"]))
    hits: Counter = Counter()
    for seed in range(first, first + count):
        kind, answer = trial(seed)
        good = right(kind, answer)
        hits[kind, good] += 1
        names = ", ".join(e.name for e in answer.added) or "-"
        gaps = answer.force_gaps
        print(
            f"{seed} {'+'.join(kind) or 'nothing'}: {answer.verdict.word} {names}; held-out force error "
            f"{100 * gaps['refitted']:.3g} % -> {100 * gaps['better']:.3g} % (floor {100 * gaps['floor']:.2g} %)"
            f"{'' if good else '   WRONG'}",
            flush=True,
        )
    total = sum(n for (_, good), n in hits.items() if good)
    print(f"right: {total} of {count}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
