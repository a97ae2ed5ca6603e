"""answer of the gap workflow -> the figures of its page, as SVG text."""

from __future__ import annotations

import base64
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from sysid_bench.gap.answer import Answer
from sysid_bench.gap.inverse import ENDS
from sysid_bench.nouns import Array
from sysid_bench.views.gap_clouds import Figure, clouds, inner
from sysid_bench.views.gap_words import budget, held_out, unit_of
from sysid_bench.views.svg import Axes, bars

IN_SIGHT, CHANNELS, PARTS = 500, 3, 100


def images(answer: Answer, values: Mapping[str, Any]) -> list[Mapping[str, str]]:
    """Error budget, held-out error, then the force (where it is judged) or the motion, then the unexplained force."""
    steps = "What is left over the noise floor (rms), step by step, on the training records."
    if not answer.judged:
        steps += " The line at the top counts energy, its square."
    error = "Error of the force" if answer.judged else "Free-run error"
    proof = f"{error} on the test records, which chose nothing, in per cent of the measured rms."
    shown = [
        (bars(budget(values), "x floor"), "error budget", steps),
        (bars(held_out(values), "%"), "held-out error", proof),
        *(_forces(answer) if answer.judged else _motions(answer)),
        *_residuals(answer),
        *clouds(answer),
    ]
    return [
        {"data": f"data:image/svg+xml;base64,{base64.b64encode(svg.encode()).decode()}", "width": "760",
         "alt": alt, "caption": caption}
        for svg, alt, caption in shown
    ]  # fmt: skip


def _motions(answer: Answer) -> list[Figure]:
    channels = range(min(answer.after[0].trace.y.shape[1], CHANNELS))
    caption = "on the first test record, where the given model is worst."
    return [(_output(answer, c), f"output {c + 1}", f"Output {c + 1} {caption}") for c in channels]


def _residuals(answer: Answer) -> list[Figure]:
    what = "Force that is left" if answer.judged else "Residual"
    here = f"{what} on the first test record"
    return [
        (_spectrum(answer), "residual spectrum", f"{here}, all channels, by frequency."),
        (_over_time(answer), "residual over time", f"{here}, rms of all channels in a hundred parts, over the noise floor."),
    ]  # fmt: skip


def leftover(answer: Answer) -> list[tuple[Array, Array]]:
    """t (N,), residual (N, channels) over the noise floor on the first test record, of the given and the better model.

    Where the force is judged: the force that is left, without the ends of the record.
    """
    if answer.judged is None:
        proofs = (answer.before[0], answer.after[0])
        return [
            (p.trace.t, p.trace.filled(p.trace.y - p.predicted) / np.sqrt(answer.noise[0])) for p in proofs
        ]
    found, weight = [], answer.problem.traces[0].weight[0]
    for one in (answer.judged["given"][0], answer.judged["better"][0]):
        inside = slice(int(1.5 * ENDS * len(one.t)) + 1, -int(1.5 * ENDS * len(one.t)) - 1)
        found.append((one.t[inside], ((one.given - one.needed) * weight)[inside]))
    return found


def power_by_frequency(answer: Answer, t: Array, r: Array) -> tuple[Array, Array]:
    """Hz (F,), mean power of the channels (F,) of a residual over its floor, up to twice the band."""
    power = np.mean(np.abs(np.fft.rfft(r, axis=0)) ** 2, axis=1) / len(r)
    f = np.fft.rfftfreq(len(r), float(t[1] - t[0]))
    kept = f < answer.problem.traces[0].omega[-1] / np.pi
    return f[kept], power[kept]


def _over_time(answer: Answer) -> str:
    shown = []
    for t, r in leftover(answer):
        parts = min(PARTS, len(r))  # a motion under much noise is judged at few times
        rms = [np.sqrt(np.mean(part**2)) for part in np.array_split(r, parts)]
        shown.append((np.linspace(t[0], t[-1], parts), np.log10(np.maximum(rms, 1e-3))))
    return _over_floor(shown, "t (s)", "rms over floor")


def _spectrum(answer: Answer) -> str:
    shown = []
    for t, r in leftover(answer):
        f, power = power_by_frequency(answer, t, r)
        fold = max(1, len(f) // 200)
        f, power = (x[: len(x) // fold * fold].reshape(-1, fold).mean(axis=1) for x in (f, power))
        shown.append((f, np.log10(power + 1e-300)))
    return _over_floor(shown, "frequency (Hz)", "power over floor")


def _over_floor(shown: Sequence[tuple[Array, Array]], along: str, label: str) -> str:
    """Logarithms over the floor, of the given and the better model."""
    first, last = (float(f(np.concatenate([x for x, _ in shown]))) for f in (np.min, np.max))
    top = max(float(y.max()) for _, y in shown)
    axes = Axes((first, last), (-0.7, max(top, 0.0) + 0.5), along, label, log=True)
    for (x, y), colour in zip(shown, (1, 0)):
        axes.line(x, y, colour)
    axes.line(np.array([first, last]), np.zeros(2), 7, 1.0)
    axes.legend([("given model", 1), ("better model", 0), ("noise floor", 7)])
    return axes.text()


def _worst(error: Array) -> slice:
    """The stretch of IN_SIGHT samples where the error has most energy."""
    if len(error) <= IN_SIGHT:
        return slice(0, len(error))
    first = int(np.argmax(np.convolve(error**2, np.ones(IN_SIGHT), "valid")))
    return slice(first, first + IN_SIGHT)


def _draw(axes: Axes, t: Array, lines: Sequence[Array], names: Sequence[str]) -> None:
    """The given model dashed, the better one, and what was measured thin on top."""
    for values, colour, width in zip(lines, (1, 0, 7), (1.4, 1.6, 0.8)):
        axes.line(t, values, colour, width)
    axes.legend(list(zip(names, (1, 0, 7))))


def _output(answer: Answer, c: int) -> str:
    before, after = answer.before[0], answer.after[0]
    y = after.trace.y[:, c]
    part = _worst(np.nan_to_num(y - before.predicted[:, c]))
    t = after.trace.t[part]
    low, high = float(np.nanmin(y[part])), float(np.nanmax(y[part]))
    room = (low - 0.3 * (high - low), high + 0.4 * (high - low))
    axes = Axes((float(t[0]), float(t[-1])), room, "t (s)", f"y{c + 1} ({unit_of(answer, c)})")
    lines = [before.predicted[part, c], after.predicted[part, c], y[part]]
    _draw(axes, t, lines, ("given model", "better model", "measured"))
    return axes.text()


def _forces(answer: Answer) -> list[Figure]:
    """Given and needed force on the first test record, where the refitted linear model is worst."""
    if answer.judged is None:
        return []
    refitted, better = answer.judged["refitted"][0], answer.judged["better"][0]
    return [_force(refitted, better, i) for i in range(min(better.given.shape[1], CHANNELS))]


def _force(refitted: Any, better: Any, i: int) -> Figure:
    part = _worst((refitted.given - refitted.needed)[:, i])
    lines = [refitted.needed[part, i], better.needed[part, i], better.given[part, i]]
    low, high = inner(*lines)
    t = better.t[part]
    axes = Axes((float(t[0]), float(t[-1])), (1.3 * low, high), "t (s)", "force (N)")
    _draw(axes, t, lines, ("needed, linear", "needed, better model", "given"))
    caption = (
        f"Force at DOF {i} on the first test record, in the band: what was given and what the motion needs."
    )
    return axes.text(), f"force {i + 1}", caption
