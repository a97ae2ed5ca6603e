"""record, model, estimate -> report.html, figures and identify.rrd of one identification."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Literal

import numpy as np

from sysid_bench.mechanics.second_order import frequencies_and_damping
from sysid_bench.mechanics.uncertainty import uncertainty_of
from sysid_bench.nouns import Array, Estimate, Model, Record
from sysid_bench.views.html import flat, image, render, write_page
from sysid_bench.views.identify_figures import MATRICES, Z95, unit, write_figures
from sysid_bench.views.rerun_identify import write_identify_rrd
from sysid_bench.views.simulated import fit_numbers, simulate

TURN = 2 * np.pi


def write_identify_report(
    out: str | Path, record: Record, model: Model, estimate: Estimate, prediction: Array | None = None
) -> list[Path]:
    """Write report.html, figures/ and identify.rrd into the folder `out`; returns the paths.

    prediction (N, ny): what the estimate says the output is; None: its free run on the record's input.
    """
    out = Path(out)
    predicted = simulate(record, model, estimate) if prediction is None else prediction
    figures = write_figures(out, record, model, estimate, predicted)
    told = json.loads((out / "estimate.json").read_text()) if (out / "estimate.json").is_file() else {}
    page = render(
        "identify.html", title=_title(told), record=_in_words(record), estimate=estimate, fit=_fit_rows(record, predicted),
        remarks=list(estimate.diagnostics.get("remarks", [])) or list(told.get("diagnostics", {}).get("remarks", [])),
        matrices=[_matrix(estimate, X) for X in MATRICES if getattr(estimate, X) is not None], modes=_modes(estimate),
        coefficients=[(name, f"{value:.6g}") for name, value in estimate.coefficients.items()],
        images=[image(p, p.stem) for p in figures], diagnostics=_diagnostics(estimate),
        origin=flat(told.get("origin") or {}),
    )  # fmt: skip
    rrd = write_identify_rrd(out / "identify.rrd", record, estimate, predicted, _title(told))
    return [write_page(out / "report.html", page), *figures, rrd]


def _in_words(record: Record) -> str:
    step = f"{record.h:g} s" if record.is_uniform else "uneven steps"
    flagged = 0 if record.quality is None else int(np.count_nonzero(record.quality))
    words = [
        f"{record.N} samples at {step}",
        f"inputs: {record.nu} ({record.hold or 'hold unknown'})",
        f"outputs: {record.ny}",
    ]
    return ", ".join([*words, *([f"{flagged} samples flagged"] if flagged else [])])


def _title(told: Mapping[str, Any]) -> str:
    return f"Identification by {told['method']}" if told.get("method") else "Identification"


def _fit_rows(record: Record, predicted: Array | None) -> list[tuple[str, ...]]:
    if predicted is None:
        return []
    good = np.ones(record.N, bool) if record.quality is None else record.quality == 0
    rows = fit_numbers(record.y[good], predicted[good])
    return [
        (
            f"y{j + 1}{unit(record, 'y', j)}",
            f"{fit:.2f} %",
            f"{rms:.4g}",
            f"{residual:.3g}",
            f"{correlation:.2f}",
        )
        for j, (fit, rms, residual, correlation) in enumerate(rows)
    ]


def _matrix(estimate: Estimate, X: Literal["M", "D", "K"]) -> Mapping[str, Any]:
    value, std = getattr(estimate, X), estimate.std(X)
    half = None if std is None else Z95 * std
    rows = [[_entry(value, half, i, j) for j in range(len(value))] for i in range(len(value))]
    return {"name": X, "word": MATRICES[X], "rows": rows, "intervals": std is not None}


def _entry(value: Array, half: Array | None, i: int, j: int) -> tuple[str, str]:
    return f"{value[i, j]:.5g}", "" if half is None else f"± {half[i, j]:.2g}"


def _modes(estimate: Estimate) -> list[list[tuple[str, str]]]:
    """Rows of (value, ± half width): natural frequency in rad/s and Hz, damping ratio."""
    if estimate.poles is None or not len(estimate.poles):
        return []
    omega, zeta = frequencies_and_damping(np.asarray(estimate.poles))
    known = uncertainty_of(estimate)
    of_omega, of_zeta = ([None] * len(omega),) * 2 if known is None else (known.omega_n_std, known.zeta_std)
    return [
        [_mode_entry(w, of_w), _mode_entry(w / TURN, of_w, TURN), _mode_entry(z, of_z)]
        for w, z, of_w, of_z in zip(omega, zeta, of_omega, of_zeta)
    ]


def _mode_entry(value: float, std: float | None, unit: float = 1.0) -> tuple[str, str]:
    if std is None or not np.isfinite(std):
        return f"{value:.5g}", ""
    return f"{value:.5g}", f"± {Z95 * std / unit:.2g}"


def _diagnostics(estimate: Estimate) -> list[tuple[str, str]]:
    return [(key, value[:300]) for key, value in flat(estimate.diagnostics) if key != "remarks"]
