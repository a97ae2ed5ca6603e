"""measure: preview, confirm, drive, log, judge; one record file per run."""

from __future__ import annotations

import json
import sys
import time
from collections.abc import Iterator
from contextlib import closing
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from sysid_bench import conf
from sysid_bench.build import build
from sysid_bench.effects import own_effects
from sysid_bench.files import read_model
from sysid_bench.files.provenance import config_of, provenance
from sysid_bench.files.yaml_text import yaml_text
from sysid_bench.frames.link import opened
from sysid_bench.frames.priority import before_others
from sysid_bench.measure.commands import Commands, commands
from sysid_bench.measure.drive import drive
from sysid_bench.measure.finish import rewrite
from sysid_bench.measure.judge import Rules, Verdict
from sysid_bench.measure.limits import Watch, check_forces, check_motion
from sysid_bench.measure.log import RunLog
from sysid_bench.measure.preview import predicted, preview
from sysid_bench.measure.session import Session
from sysid_bench.nouns import Array, InputError
from sysid_bench.records import read_record

MOST_RUNS = 1000


@dataclass(frozen=True)
class Run:
    """One run to be: its knobs, its config for the origin, its file, its forces, its predicted motion."""

    cfg: dict[str, Any]
    out: Path
    plan: Commands
    motion: Array | None


def main(cfg: dict[str, Any]) -> int:
    """0: every run went to its end and its record is valid; 1: one was stopped or is invalid, with the reason."""
    packages = cfg["plugins"].packages
    rig, bus = build(cfg["rig"], packages), build(cfg["bus"], packages)
    load = rig.check_load()
    runs = [planned(run, rig, out) for run, out in expanded(cfg)]
    for run in runs:
        check_forces(run.plan, rig)
        if run.motion is not None:
            check_motion(run.motion, rig)
        print(f"{run.out}\n{preview(run.plan, rig, load, run.motion)}", flush=True)
    if cfg["dry_run"]:
        _draw(runs, rig)
        return 0
    with closing(opened(bus, rig, cfg["pace"])) as link:
        if bus.moves_hardware:  # drawn once the bus is there: a wrong interface is told at once
            _draw(runs, rig)
        _confirm(rig, bus, cfg["yes"])
        for number, run in enumerate(runs):
            time.sleep((cfg.get("campaign") or {}).get("pause_s", 0.0) if number else 0.0)
            link.drain()
            if not measured(run, rig, link):
                return 1
    return 0


def expanded(cfg: dict[str, Any]) -> Iterator[tuple[dict[str, Any], Path]]:
    """(config, file) of each run of a campaign and each repetition; repetitions have seeds of their own."""
    out = Path(cfg["out"])
    if out.suffix != ".mcap":
        raise InputError(f"out={out}: a run is logged as MCAP; give a name that ends in .mcap.")
    campaign = build(cfg["campaign"], cfg["plugins"].packages) if cfg.get("campaign") else None
    for entry in campaign.runs if campaign else [{}]:
        run = {**cfg, **{k: v for k, v in entry.items() if k not in ("name", "excitation")}}
        if "excitation" in entry:
            run["excitation"] = _excitation(entry["excitation"], cfg["plugins"])
        stem = f"{out.stem}_{entry['name']}" if campaign else out.stem
        if not 1 <= run["repetitions"] <= MOST_RUNS:
            raise InputError(f"repetitions must be 1 to {MOST_RUNS}; got {run['repetitions']}.")
        for repetition in range(run["repetitions"]):
            suffix = f"_{repetition + 1}" if run["repetitions"] > 1 else ""
            yield {**run, "seed": run["seed"] + repetition}, out.with_name(f"{stem}{suffix}.mcap")


def _excitation(node: dict[str, Any], plugins: Any) -> dict[str, Any]:
    if "option" not in node:
        raise InputError(f"campaign: excitation {node!r:.100} needs option: NAME.")
    known = conf.option("excitation", node["option"], plugins)
    return known | {knob: value for knob, value in node.items() if knob != "option"}


def planned(cfg: dict[str, Any], rig: Any, out: Path) -> Run:
    """The forces of a run and, with a model, its motion. Raises InputError."""
    if cfg["seed"] < 0:
        raise InputError(f"seed must be a whole number 0..; got {cfg['seed']}.")
    excitation = build(cfg["excitation"], cfg["plugins"].packages)
    rng = np.random.default_rng(cfg["seed"])
    plan = commands(
        excitation, rig, cfg["seconds"], cfg["periods"], cfg["amplitude"], cfg["soft_start_s"], rng
    )  # fmt: skip
    motion = None
    if cfg["model"]:
        motion = predicted(plan, rig, read_model(cfg["model"], own_effects(cfg["effects_path"])))
    return Run(cfg, out, plan, motion)


def _draw(runs: list[Run], rig: Any) -> None:
    from sysid_bench.views.rig_preview import draw

    for run in runs:
        path = run.out.with_suffix(".preview.png")
        draw(run.plan.u, run.motion, rig, path)
        print(f"figure      {path}")


def _confirm(rig: Any, bus: Any, yes: bool) -> None:
    """Ask before moving a real rig. Raises InputError where the answer is not yes, or nobody is there to give it."""
    if not bus.moves_hardware or yes:
        return
    if not sys.stdin.isatty():
        raise InputError(
            f"this would move rig {rig.name} for real; nobody is here to confirm it. Scripts say yes=true."
        )
    if input(f"This moves rig {rig.name}. Is it clear? Type yes: ").strip().lower() != "yes":
        raise InputError("not confirmed; nothing was moved.")


def measured(run: Run, rig: Any, link: Any) -> bool:
    """Drive and log one run; True where its record is whole and valid. Prints what came of it."""
    cfg = run.cfg
    knobs = ("late_s", "max_lost", "max_drift_ppm", "stuck_s")
    rules = Rules(rig.rate_hz, rig.tick_unit_s, rig.numbered, **{knob: cfg[knob] for knob in knobs})
    origin = {
        "source": "measured", "rig": rig.name, "bus": link.name, "judged_by": asdict(rules),
        **provenance("measure", cfg, [cfg["model"]] if cfg["model"] else []),
    }  # fmt: skip
    properties = {"hold": "zoh", "period": run.plan.period, "units": _units(rig)}
    attachments = {"rig.dbc": rig.dbc_text.encode("latin-1"), "config.yaml": yaml_text(config_of(cfg))}
    viewer = _viewer(rig) if cfg["view"] else None
    start = time.process_time()
    with before_others():
        log = RunLog(run.out, rig, run.plan, properties, origin, attachments, viewer)
        session = Session(rig, run.plan, Watch(rig, cfg["stuck_s"]), cfg["silence_s"], log, link.name)
        try:
            reason = drive(session, link, log)
        except InputError:
            log.close()
            run.out.unlink()
            raise
    return _finished(run, session, log, reason, time.process_time() - start)


def _finished(run: Run, session: Session, log: RunLog, reason: str | None, cpu_s: float) -> bool:
    counts = session.samples.counts
    log.statistics(
        json.dumps(
            {"frames": counts, "error_frames": session.error_frames, "stopped": reason, "host_cpu_s": cpu_s}
        )
    )
    log.close()
    _, verdict = rewrite(
        run.out, run.out, {"frames": counts, "stopped": reason, "host_cpu_s": cpu_s}, log.written
    )
    if reason:
        print(f"sysid-bench measure: stopped: {reason}. Log: {run.out}", file=sys.stderr)
    if verdict is not None:
        print(f"{run.out}: {read_record(run.out)!r}")
        print(told(verdict))
        print(f"host CPU    {1e6 * cpu_s / max(log.samples, 1):.0f} us per sample, log included")
        if not verdict.valid:
            print(f"sysid-bench measure: the record is marked invalid: {verdict.reason}.", file=sys.stderr)
    return reason is None and verdict is not None and verdict.valid


def told(verdict: Verdict) -> str:
    """Counts and clock in two lines."""
    counts = ", ".join(
        f"{n} {name.replace('_', ' ')}" for name, n in verdict.counts.items() if n or name == "lost"
    )
    clock = verdict.clock
    if clock is None:
        return f"frames      {counts}\nclock       too short a record to compare the clocks"
    use = "not told from zero, device time kept"
    if clock.significant:
        use = "applied" if verdict.valid else "not applied"
    return (
        f"frames      {counts}\nclock       drift {clock.drift_ppm:.2f} +- {clock.drift_std_ppm:.2f} ppm ({use}); "
        f"arrivals jitter by {1e3 * clock.jitter_s:.3f} ms rms, 99 % within {1e3 * clock.delay_p99_s:.2f} ms"
    )


def _units(rig: Any) -> dict[str, Any]:
    return {"t": "s", "u": [c.unit for c in rig.input_channels], "y": [c.unit for c in rig.output_channels]}


def _viewer(rig: Any) -> Any:
    from sysid_bench.views.rerun_live import LiveView

    return LiveView(rig)
