"""answer of the gap workflow -> report.html: one page that a person reads before believing a name."""

from __future__ import annotations

import base64
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from sysid_bench.gap.motion import force_along, smoothed
from sysid_bench.gap.workflow import Answer
from sysid_bench.mechanics.effect import as_effects, direction
from sysid_bench.nouns import Array
from sysid_bench.views.html import flat, render, write_page
from sysid_bench.views.svg import Axes, bars, field

IN_SIGHT, CLOUD = 500, 1500
WORDS = {
    "effect": "An effect is missing",
    "parameters": "Only parameters are wrong",
    "none": "Nothing is missing that these records can show",
    "unknown": "Something is missing, and it has no name here",
}


def write_gap_report(out: Path, answer: Answer, values: Mapping[str, Any]) -> Path:
    """Write report.html into `out`."""
    page = render(
        "gap.html", title=WORDS[values["verdict"]], values=values, images=images(answer, values),
        equations=equations(answer), moved=values["parameters_moved"], number=lambda x: "" if x is None else f"{x:.4g}",
        place=place_words, suspects=suspects(values), power=sorted(values["power"].items()), origin=flat(values["origin"]),
    )  # fmt: skip
    return write_page(out / "report.html", page)


def place_words(dof: Any) -> str:
    return (
        "everywhere"
        if dof is None
        else (f"DOFs {dof[0]} and {dof[1]}" if isinstance(dof, (list, tuple)) else f"DOF {dof}")
    )


def equations(answer: Answer) -> list[tuple[str, str]]:
    """(which, equation) of the model as given and of the better one."""
    given = [
        e for e in as_effects(answer.problem.model.effects) if e.name != "constant_force" or e.value("force")
    ]
    return [("as given", equation(given)), ("better", equation(answer.better.effects))]


PATHS = {"actuator": "the drive gives", "sensor": "the sensor shows", "structure": "the structure has"}


def equation(effects: Sequence[Any]) -> str:
    """The equation of motion, a line for each effect: forces on the left, what is no force below."""
    forces = [e for e in effects if e.path == "force"]
    lines = ["M q'' + D q' + K q", *(f"  + [{e.equation}] at {place_words(e.dof)}" for e in forces)]
    lines[-1] += " = L u"
    others = [e for e in effects if e.path != "force"]
    lines += [f"{PATHS.get(e.path, e.path)} {e.equation} at {place_words(e.dof)}" for e in others]
    return "\n".join(lines)


def suspects(values: Mapping[str, Any]) -> list[tuple[str, str, str, str]]:
    """Rows of the ranking: round, name and place, share explained in the screen, left after the fit."""
    rows = []
    for k, r in enumerate(values["rounds"], start=1):
        fitted = {(c["name"], str(c["dof"])): c["residual_over_floor"] for c in r["fitted"]}
        seen = set()
        for c in r["screen"]:
            key = (c["name"], str(c["dof"]))
            if key in seen:
                continue
            seen.add(key)
            left = f"{fitted[key]:.3g}" if key in fitted else ""
            rows.append(
                (f"{k}", f"{c['name']} at {place_words(c['dof'])}", f"{100 * c['explains']:.1f} %", left)
            )
    return rows


def _image(svg: str, alt: str, caption: str) -> Mapping[str, str]:
    data = base64.b64encode(svg.encode()).decode()
    return {"data": f"data:image/svg+xml;base64,{data}", "width": "760", "alt": alt, "caption": caption}


def images(answer: Answer, values: Mapping[str, Any]) -> list[Mapping[str, str]]:
    """Figures: error budget, held-out output, residual spectrum, the effect on the residual cloud, residual over (x, v)."""
    found = [
        _image(
            bars(budget(values), "x floor"),
            "error budget",
            "What is left over the noise floor (rms), step by step, on the training records.",
        ),
        _image(
            bars(held_out(values), "%"),
            "held-out error",
            f"{'Error of the force' if answer.judged else 'Free-run error'} on the test records, which chose nothing, "
            "in per cent of the measured rms.",
        ),
    ]
    if answer.judged:
        return found + _on_force(answer) + _clouds(answer)
    y = answer.after[0].trace.y
    for c in range(min(y.shape[1], 3)):
        found.append(
            _image(
                _output(answer, c),
                f"output {c + 1}",
                f"Output {c + 1} on the first test record, where the given model is worst.",
            )
        )
    found.append(
        _image(
            _spectrum(answer),
            "residual spectrum",
            "Residual on the first test record, all channels, by frequency.",
        )
    )
    found.append(
        _image(
            _over_time(answer),
            "residual over time",
            "Residual on the first test record, rms of all channels in a hundred parts, over the noise floor.",
        )
    )
    return found + _clouds(answer)


def budget(values: Mapping[str, Any]) -> list[tuple[str, float]]:
    """(step, rms over the floor) from the model as given down to the end."""
    over = values["residual_over_floor"]
    rows = [("model as given", over["nominal"]), ("M, D, K refitted", over["refit"])]
    for r in values["rounds"]:
        if r["chosen"]:
            after = next(
                c["residual_over_floor"]
                for c in r["fitted"]
                if c["name"] == r["chosen"]["name"] and c["dof"] == r["chosen"]["dof"]
            )
            rows.append((f"+ {r['chosen']['name']}", after))
    return [
        (name, float(np.sqrt(max(v, 1e-6)))) for name, v in [*rows, ("noise floor", 1.0)] if np.isfinite(v)
    ]


def held_out(values: Mapping[str, Any]) -> list[tuple[str, float]]:
    """(which, per cent) of the given and the better model and the floor."""
    rows = (("model as given", "gap_before"), ("better model", "gap_after"), ("noise floor", "noise_floor"))
    return [(name, 100 * max(float(values[key]), 1e-9)) for name, key in rows if np.isfinite(values[key])]


def _over_time(answer: Answer) -> str:
    lines, parts = [], 100
    for proof in (answer.before[0], answer.after[0]):
        r = proof.trace.filled(proof.trace.y - proof.predicted) / np.sqrt(answer.noise)
        lines.append([np.sqrt(np.mean(part**2)) for part in np.array_split(r, parts)])
    first, last = answer.after[0].trace.t[[0, -1]]
    t = np.linspace(first, last, parts)
    shown = [np.log10(np.maximum(line, 1e-3)) for line in lines]
    top = max(float(line.max()) for line in shown)
    axes = Axes((float(t[0]), float(t[-1])), (-0.5, top + 0.3), "t (s)", "rms over floor", log=True)
    for line, colour in zip(shown, (1, 0)):
        axes.line(t, line, colour)
    axes.line(t[[0, -1]], np.zeros(2), 7, 1.0)
    axes.legend([("given model", 1), ("better model", 0), ("noise floor", 7)])
    return axes.text()


def _output(answer: Answer, c: int) -> str:
    before, after = answer.before[0], answer.after[0]
    t, y = after.trace.t, after.trace.y[:, c]
    error = np.convolve((y - before.predicted[:, c]) ** 2, np.ones(IN_SIGHT), "valid")
    first = int(np.argmax(error)) if len(y) > IN_SIGHT else 0
    part = slice(first, first + IN_SIGHT)
    shown = [before.predicted[part, c], after.predicted[part, c], y[part]]
    low, high = float(np.min(y[part])), float(np.max(y[part]))
    axes = Axes(
        (float(t[part][0]), float(t[part][-1])),
        (low - 0.3 * (high - low), high + 0.4 * (high - low)),
        "t (s)",
        f"y{c + 1}",
    )
    for values, colour, width in zip(shown, (1, 0, 7), (1.4, 1.6, 0.8)):
        axes.line(t[part], values, colour, width)
    axes.legend([("given model", 1), ("better model", 0), ("measured", 7)])
    return axes.text()


def _on_force(answer: Answer) -> list[Mapping[str, str]]:
    """Given and needed force on the first test record, where the refitted linear model is worst."""
    if answer.judged is None:
        return []
    refitted, better = answer.judged["refitted"][0], answer.judged["better"][0]
    found = []
    for i in range(min(better.given.shape[1], 3)):
        error = np.convolve((refitted.given - refitted.needed)[:, i] ** 2, np.ones(IN_SIGHT), "valid")
        first = int(np.argmax(error))
        part = slice(first, first + IN_SIGHT)
        lines = [refitted.needed[part, i], better.needed[part, i], better.given[part, i]]
        low, high = _inner(*lines)
        axes = Axes(
            (float(better.t[part][0]), float(better.t[part][-1])), (1.3 * low, high), "t (s)", "force (N)"
        )
        for values, colour, width in zip(lines, (1, 0, 7), (1.4, 1.6, 0.8)):
            axes.line(better.t[part], values, colour, width)
        axes.legend([("needed, linear", 1), ("needed, better model", 0), ("given", 7)])
        caption = f"Force at DOF {i} on the first test record, in the band: what was given and what the motion needs."
        found.append(_image(axes.text(), f"force {i + 1}", caption))
    return found


def _spectrum(answer: Answer) -> str:
    lines, names = [], (("given model", 1), ("better model", 0))
    for proof in (answer.before[0], answer.after[0]):
        r = proof.trace.filled(proof.trace.y - proof.predicted)
        power = np.mean(np.abs(np.fft.rfft(r, axis=0)) ** 2, axis=1) / len(r)
        f = np.fft.rfftfreq(len(r), proof.trace.h)
        fold = max(1, len(f) // 400)
        keep = len(f) // fold * fold
        lines.append(
            (f[:keep].reshape(-1, fold).mean(1), np.log10(power[:keep].reshape(-1, fold).mean(1) + 1e-300))
        )
    top = answer.problem.traces[0].omega[-1] / np.pi
    shown = [(f[f < top], p[f < top]) for f, p in lines]
    floor = float(np.log10(np.mean(answer.noise)))
    axes = Axes(
        (0.0, float(top)),
        (floor - 0.7, max(float(p.max()) for _, p in shown) + 0.6),
        "frequency (Hz)",
        "power",
        log=True,
    )
    for (f, p), (_, colour) in zip(shown, names):
        axes.line(f, p, colour)
    axes.line(np.array([0.0, top]), np.array([floor, floor]), 7, 1.0)
    axes.legend([*names, ("noise floor", 7)])
    return axes.text()


def unexplained(answer: Answer, effect: Any) -> tuple[Array, Array, Array]:
    """x, v, force (N,) at an effect's place on the first training record: what the better model without it leaves."""
    problem, fit = answer.problem, answer.story.fit
    c = direction(effect.dof, problem.model.n)
    trace, run = problem.traces[0], fit.runs[0]
    q, v, a = smoothed(problem, trace, run)
    M, D, K = problem.matrices(fit.point.theta)
    force = trace.u @ problem.model.input_map.T - a @ M.T - v @ D.T - q @ K.T
    for other in fit.point.effects:
        if other.path == "force" and other is not effect:
            o = direction(other.dof, problem.model.n)
            force = force - np.outer(force_along(other, q @ o, v @ o, trace.h, trace.t0), o)
    ends = c != 0
    return q @ c, v @ c, force[:, ends] @ (c[ends] / np.sum(ends))


def found_forces(answer: Answer) -> list[Any]:
    """The forces that were found, without those that the model had."""
    effects = answer.story.fit.point.effects[len(answer.problem.model.effects) :]
    return [e for e in effects if e.path == "force"]


def _clouds(answer: Answer) -> list[Mapping[str, str]]:
    found, fields = [], set()
    for effect in found_forces(answer):
        x, v, force = unexplained(answer, effect)
        where = place_words(effect.dof)
        found.append(
            _image(
                _cloud(answer, effect, x, v, force),
                f"{effect.name} on the residual cloud",
                f"Force at {where} that the rest of the better model leaves, and {effect.name} as fitted.",
            )
        )
        if where in fields:
            continue
        fields.add(where)
        found.append(
            _image(
                field(x, v, force, "displacement (m)", "velocity (m/s)"),
                "force over state",
                f"The same force at {where} over displacement and velocity: orange positive, blue negative.",
            )
        )
    return found


def _cloud(answer: Answer, effect: Any, x: Array, v: Array, force: Array) -> str:
    """An effect over what the rest leaves, against what it follows: displacement or velocity."""
    trace = answer.problem.traces[0]
    fitted = force_along(effect, x, v, trace.h, trace.t0)
    step = max(1, len(x) // CLOUD)
    by_speed = _by_speed(effect, x, v, fitted)
    against, label = (v, "relative velocity (m/s)") if by_speed else (x, "relative displacement (m)")
    order = np.argsort(against[::step])
    axes = Axes((float(against.min()), float(against.max())), _inner(force, fitted), label, "force (N)")
    axes.dots(against[::step], force[::step], 7)
    axes.dots(against[::step][order], fitted[::step][order], 1)
    axes.legend([("left by the rest", 7), (effect.name, 1)])
    return axes.text()


def _by_speed(effect: Any, x: Array, v: Array, f: Array) -> bool:
    """True where the force follows velocity more closely than displacement."""

    def tied(z: Array) -> float:
        order = np.argsort(z)
        return float(np.mean(np.diff(f[order]) ** 2))

    return tied(v) < tied(x)


def _inner(*parts: Array) -> tuple[float, float]:
    both = np.concatenate(parts)
    low, high = np.percentile(both, [0.5, 99.5])
    return float(low), float(high + 0.25 * (high - low))
