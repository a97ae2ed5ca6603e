"""record file, model file, method -> estimate.json, model_estimate.yaml, report, and a table on the terminal."""

from __future__ import annotations

import sys
import traceback
import warnings
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from sysid_bench.asked import require
from sysid_bench.build import build
from sysid_bench.estimate_table import show
from sysid_bench.files import read_model, results_folder, write_estimate, write_model
from sysid_bench.files.provenance import provenance
from sysid_bench.mechanics.excitation_check import check_excitation
from sysid_bench.mechanics.order_selection import number_of_dofs
from sysid_bench.nouns import Diverged, Estimate, InputError, Method, Model, NotApplicable, Record
from sysid_bench.pairing import pair
from sysid_bench.records import read_record
from sysid_bench.run import identify

SLOW_PERIODS = 5
CLEAR_GAP = 4.0  # of the singular values, for a word on the number of degrees of freedom


def main(cfg: dict[str, Any]) -> int:
    """0 with an estimate; 1 where the method says no (estimate.json says why)."""
    require(cfg, "identify", "record", "model", "method", "out")
    options = {"topic": cfg["topic"]} if cfg["topic"] else {}
    record, model, remarks = pair(read_record(cfg["record"], **options), read_model(cfg["model"]))
    method = build(cfg["method"], cfg["plugins"].packages)
    out = results_folder(cfg["out"])  # only now: a wrong input leaves nothing behind
    print(f"{cfg['record']}: {record!r}")
    remarks += excitation_remarks(record, model)
    estimate, heard = fitted(method, record, model, out)
    remarks += [*heard, *cautions(record, model, estimate)]
    name = cfg["choices"]["method"]
    write_results(out, cfg, name, record, model, estimate, remarks)
    for remark in remarks:
        print(f"note: {remark}", file=sys.stderr)
    show(estimate)
    seconds = "" if estimate.seconds is None else f" in {estimate.seconds:.3g} s"
    reason = f" ({estimate.reason})" if estimate.reason else ""
    print(f"{name}: {estimate.status}{reason}{seconds}. {out / 'estimate.json'}")
    return 0 if estimate.status == "ok" else 1


def excitation_remarks(record: Record, model: Model) -> list[str]:
    """What the record's inputs and outputs will not tell; a refusal of the check is a remark, the method decides."""
    try:
        return [*check_excitation(record, model.hold), *order_remarks(record, model)]
    except NotApplicable as problem:
        return [str(problem)]


def order_remarks(record: Record, model: Model) -> list[str]:
    """Whether the record clearly shows another number of degrees of freedom than the model has."""
    if not (record.is_uniform and record.all_good):
        return []
    try:
        found = number_of_dofs(record, model.n + 2)
    except (NotApplicable, Diverged, np.linalg.LinAlgError):
        return []
    if found.n == model.n or found.gap < CLEAR_GAP:
        return []
    return [
        f"the record shows {found.n} degrees of freedom (singular values fall by {found.gap:.2g} there), the model has "
        f"{model.n}: a mode is missing, or not excited, or not seen"
    ]


def fitted(method: Method, record: Record, model: Model, out: Path) -> tuple[Estimate, list[str]]:
    """(estimate, warnings that the method gave). A method that says no gives an Estimate with the reason.

    A method that breaks gives status error, and its traceback stands in out/traceback.txt.
    """
    (out / "traceback.txt").unlink(missing_ok=True)
    with warnings.catch_warnings(record=True) as caught, np.errstate(all="ignore"):
        warnings.simplefilter("default", UserWarning)
        try:
            estimate = identify(method, record, model)
        except NotApplicable as problem:
            estimate = Estimate(status="not_applicable", reason=str(problem))
        except (Diverged, np.linalg.LinAlgError) as problem:
            estimate = Estimate(status="diverged", reason=str(problem))
        except InputError:
            raise
        except Exception as problem:
            (out / "traceback.txt").write_text(traceback.format_exc())
            reason = f"{type(problem).__name__}: {problem} (see {out / 'traceback.txt'})"
            estimate = Estimate(status="error", reason=reason)
    heard = [str(w.message) for w in caught if issubclass(w.category, UserWarning)]
    return estimate, list(dict.fromkeys(heard))


def cautions(record: Record, model: Model, estimate: Estimate) -> list[str]:
    """What to keep in mind of an estimate from this record."""
    found = []
    if record.origin.get("valid") is False:
        found.append(f"the record is marked invalid: {record.origin.get('invalid_reason')}.")
    if record.origin.get("stopped"):
        found.append(f"the run was stopped: {record.origin['stopped']}.")
    if model.effects:
        names = ", ".join(effect.name for effect in model.effects)
        found.append(
            f"only M, D, K are estimated, not the model's effects ({names}); `sysid-bench gap` weighs those."
        )
    warning = str(estimate.diagnostics.get("warning") or "")
    if warning:
        found.append(f"{warning}.")
    poles = np.array([]) if estimate.poles is None else np.asarray(estimate.poles)
    swinging = np.abs(poles[np.imag(poles) > 0])
    length = record.t[-1] - record.t[0]
    periods = length * swinging.min(initial=np.inf) / (2 * np.pi)
    if periods < SLOW_PERIODS and "periods" not in warning:
        found.append(
            f"the record is {length:.3g} s long, {periods:.2g} periods of the slowest mode; "
            f"below {SLOW_PERIODS} the damping is poorly known."
        )
    if np.max(np.real(poles), initial=-np.inf) > 0:
        found.append(f"the estimate is unstable: a pole has real part {np.max(np.real(poles)):.3g} rad/s.")
    return found


def write_results(
    out: Path,
    cfg: Mapping[str, Any],
    method: str,
    record: Record,
    model: Model,
    estimate: Estimate,
    remarks: list[str],
) -> None:
    """estimate.json always; model_estimate.yaml where there are M, D, K; the report where wanted."""
    origin = provenance("identify", cfg, [cfg["record"], cfg["model"]]) | {"record": dict(record.origin)}
    remarks += _write_model(
        out / "model_estimate.yaml", model, estimate, {"method": method, "inputs": origin["inputs"]}
    )
    noted = replace(estimate, diagnostics={**estimate.diagnostics, "hold": record.hold, "remarks": remarks})
    write_estimate(noted, out / "estimate.json", method=method, model=model, origin=origin)
    if cfg["views"]:
        from sysid_bench.views.identify_report import write_identify_report

        write_identify_report(out, record, model, estimate)


def _write_model(path: Path, model: Model, estimate: Estimate, origin: Mapping[str, Any]) -> list[str]:
    """The model with the estimated values, where there are such; the remark where they are no model."""
    path.unlink(missing_ok=True)  # of an earlier run
    if estimate.M is None or estimate.D is None or estimate.K is None:
        return []
    try:
        better = replace(model, mass=estimate.M, damping=estimate.D, stiffness=estimate.K, free={})
    except InputError as problem:
        return [f"no {path.name}: {problem}"]
    write_model(better, path, origin)
    return []
