"""results of one measured machine -> docs/figures/measured_<name>.png: what each effect took, and where one sees it."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from convert import MACHINES, Machine, data_root, records

from sysid_bench.files import read_model
from sysid_bench.gap.check_data import check_data
from sysid_bench.gap.force import OnForce, cropped, force_banded, judge_on_force, with_offset
from sysid_bench.gap.inverse import ForceProblem, measured_motion
from sysid_bench.gap.prepare import prepared
from sysid_bench.gap.traces import trace_of
from sysid_bench.nouns import Array, Model, Record
from sysid_bench.views.style import COLOURS, publication

GREY = "#9a9a9a"


def draw(name: str, results: Path, out: Path) -> None:
    """Two panels: the error budget, and the view in which this machine shows its effect. Says so where data are absent."""
    machine, root = MACHINES[name], data_root()
    if root is None or not (results / "gap.json").is_file() or name not in PANELS:
        print(f"{name}: no figure (no data, no results, or none is drawn)")
        return
    values, found = json.loads((results / "gap.json").read_text()), records(machine, root)
    given = with_offset(read_model(results / "data" / "model.yaml"))
    train = [found[n] for n in machine.train]
    problem, _, _ = prepared(train, given, check_data(train))
    with publication() as plt:
        figure, (left, right) = plt.subplots(1, 2, figsize=(8.6, 3.3), layout="constrained")
        _budget(left, values)
        PANELS[name](right, machine, found[machine.test[0]], problem, read_model(results / "model.yaml"))
        figure.suptitle(machine.title, fontsize=10)
        out.mkdir(parents=True, exist_ok=True)
        figure.savefig(out / f"measured_{name}.png")
    print(out / f"measured_{name}.png")


def _budget(axes: Any, values: dict[str, Any]) -> None:
    over, share = values["residual_over_floor"], values["force_share"]
    unit, gaps = 100 * share["refit"] / over["refit"] ** 0.5, values["force_gap"]
    rows = [("M, D refitted", over["refit"])]
    for r in values["rounds"]:
        if r["chosen"]:
            name = r["chosen"]["name"]
            rho = next(c["residual_over_floor"] for c in r["fitted"] if c["name"] == name)
            rows.append((f"+ {name.replace('_', ' ')}", rho))
    sizes = [unit * rho**0.5 for _, rho in rows] + [100 * gaps["refitted"], 100 * gaps["better"]]
    names = [name for name, _ in rows] + ["held out, refitted", "held out, better"]
    colours = [COLOURS[0]] * len(rows) + [COLOURS[1]] * 2
    place = np.arange(len(sizes))[::-1]
    axes.barh(place, sizes, color=colours, height=0.65)
    axes.set_yticks(place, names)
    for y, size in zip(place, sizes):
        axes.annotate(f"{size:.3g}", (size, y), (3, 0), textcoords="offset points", va="center", fontsize=7.5)
    axes.axvline(unit, color="black", linewidth=1, linestyle="--")
    axes.annotate("noise floor", (unit, len(sizes) - 0.45), (3, 0), textcoords="offset points", fontsize=7.5)
    axes.set_xlabel("force error |F − F̂| / |F| (%)")
    axes.margins(x=0.12)
    axes.grid(axis="y", visible=False)


def _judged(record: Record, problem: ForceProblem, model: Model, without: tuple[str, ...] = ()) -> OnForce:
    kept = tuple(e for e in model.effects if e.name not in without)
    return judge_on_force({"one": replace(model, effects=kept)}, record, problem)["one"]


def _motion_at(record: Record, problem: ForceProblem, judged: OnForce) -> tuple[Array, Array]:
    """x, v of the first DOF at the times of a judged force."""
    trace = force_banded(cropped(trace_of(record, problem.model)), float(problem.traces[0].omega[-1]))
    motion = measured_motion(trace)
    return (np.interp(judged.t, trace.t, z[:, 0]) for z in (motion.q, motion.v))


def over_position(axes: Any, machine: Machine, record: Record, problem: ForceProblem, model: Model) -> None:
    """Spectrum of the residual force over position: a screw shows its pitch at any speed."""
    pitch = next(e.pitch for e in model.effects if e.name == "position_ripple")
    periods = np.linspace(1.5e-3, 5e-3, 700)
    for without, label, colour in (
        (("position_ripple",), "without the ripple", GREY),
        ((), "with it", COLOURS[1]),
    ):
        judged = _judged(record, problem, model, without)
        x, _ = _motion_at(record, problem, judged)
        inner = slice(len(x) // 10, -len(x) // 10)
        r = (judged.given - judged.needed)[inner, 0]
        waves = np.exp(2j * np.pi * x[inner] / periods[:, None])
        axes.plot(1e3 * periods, 2 * np.abs(waves @ r) / len(r), color=colour, label=label)
    axes.axvline(1e3 * pitch, color="black", linewidth=0.8, linestyle="--")
    axes.annotate(
        f"{1e3 * pitch:.4g} mm", (1e3 * pitch, axes.get_ylim()[1]), (4, -8), textcoords="offset points"
    )
    axes.set(xlabel="period over position (mm)", ylabel="amplitude of the residual force (N)")
    axes.set_title("held-out record")
    axes.legend()


def loop(axes: Any, machine: Machine, record: Record, problem: ForceProblem, model: Model) -> None:
    """Force over displacement: measured, and what the model needs."""
    judged = _judged(record, problem, model)
    x, _ = _motion_at(record, problem, judged)
    inner = slice(len(x) // 16, -len(x) // 16)
    axes.plot(1e3 * x[inner], judged.given[inner, 0] / 1e3, color=GREY, linewidth=0.9, label="measured")
    axes.plot(
        1e3 * x[inner],
        judged.needed[inner, 0] / 1e3,
        color=COLOURS[1],
        linewidth=1.1,
        label="friction behind play",
    )
    axes.set(xlabel="displacement (mm)", ylabel="force (kN)")
    axes.set_title("held-out record, half the amplitude")
    _legend_above(axes)


def in_frequency(axes: Any, machine: Machine, record: Record, problem: ForceProblem, model: Model) -> None:
    """Amplitude of the residual force over frequency, without and with the hidden mode."""
    for without, label, colour in ((("extra_mode",), "without the mode", GREY), ((), "with it", COLOURS[1])):
        judged = _judged(record, problem, model, without)
        r = (judged.given - judged.needed)[:, 0]
        f = np.fft.rfftfreq(len(r), judged.t[1] - judged.t[0])
        size = np.abs(np.fft.rfft(r)) * 2 / len(r)
        axes.plot(f[1:-1], size[1:-1], color=colour, label=label)
    given = np.abs(np.fft.rfft(judged.given[:, 0])) * 2 / len(r)
    axes.plot(f[1:-1], given[1:-1], color="black", linewidth=0.8, linestyle=":", label="drive")
    axes.set(xlabel="frequency (Hz)", ylabel="amplitude (counts of the drive)", yscale="log")
    axes.set_title("held-out repeat")
    axes.legend()


def over_speed(axes: Any, machine: Machine, record: Record, problem: ForceProblem, model: Model) -> None:
    """Torque that inertia and viscous friction leave, over speed, and the friction as fitted."""
    judged = _judged(record, problem, model)
    plain = _judged(record, problem, model, ("coulomb_friction",))
    _, v = _motion_at(record, problem, judged)
    order = np.argsort(v)
    axes.plot(
        v,
        (plain.given - plain.needed)[:, 0],
        ".",
        color=GREY,
        markersize=2.5,
        label="torque left without friction",
    )
    fitted = (judged.needed - plain.needed)[:, 0]
    axes.plot(
        v[order], fitted[order], ".", color=COLOURS[1], markersize=2, label="Coulomb friction as fitted"
    )
    axes.set(xlabel="speed (rad/s)", ylabel="torque (N m)")
    axes.set_title("held-out trajectory")
    _legend_above(axes)


def _legend_above(axes: Any) -> None:
    low, high = axes.get_ylim()
    axes.set_ylim(low, high + 0.3 * (high - low))
    axes.legend(loc="upper left")


PANELS = {
    "positioning_system": over_position,
    "friction_damper": loop,
    "flexible_link": in_frequency,
    "robot_axis": over_speed,
}
