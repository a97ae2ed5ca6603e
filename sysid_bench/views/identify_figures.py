"""record, prediction, estimate -> figures of one identification: fit, residual, spectra, responses, M, D, K."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Literal

import numpy as np

from sysid_bench.mechanics.second_order import frequencies_and_damping
from sysid_bench.nouns import Array, Estimate, Model, Record
from sysid_bench.views.figures import head
from sysid_bench.views.simulated import responses, segment_length, spectrum
from sysid_bench.views.style import BOUND_COLOUR, COLOURS, GUIDE_COLOUR, log_ticks, publication, save

MATRICES: dict[Literal["M", "D", "K"], str] = {"M": "mass", "D": "damping", "K": "stiffness"}
ZOOM, BINS, ROWS = 250, 800, 8
Z95 = 1.96
MEASURED, SIMULATED, RESIDUAL = BOUND_COLOUR, COLOURS[1], COLOURS[0]


def write_figures(
    folder: Path, record: Record, model: Model, estimate: Estimate, predicted: Array | None
) -> list[Path]:
    """Write every figure that the estimate and the record allow; returns the SVG paths."""
    drawn: list[tuple[str, Any]] = []
    with publication() as plt:
        if predicted is not None:
            drawn.append(("fit", _fit(plt, record, predicted)))
            drawn.append(("spectra", _spectra(plt, record, estimate, predicted)))
            drawn += [("responses", figure) for figure in _responses(plt, record, estimate, predicted)]
        if estimate.M is not None:
            drawn.append(("parameters", _parameters(plt, model, estimate)))
        return [save(figure, folder / "figures", name)[1] for name, figure in drawn]


def unit(record: Record, group: str, j: int) -> str:
    """` (m)` where the record says so, else nothing."""
    units = list(record.units.get(group) or [])
    return f" ({units[j]})" if j < len(units) and units[j] else ""


def _fit(plt: Any, record: Record, predicted: Array) -> Any:
    """Left: the stretch of the record where the residual is largest; right: the residual of the whole record."""
    residual, ny = record.y - predicted, min(record.ny, ROWS)
    figure, axes = plt.subplots(
        ny, 2, figsize=(9.6, 1.0 + 1.55 * ny), layout="constrained", squeeze=False, sharex="col"
    )
    here = worst_stretch(residual)
    for j in range(ny):
        close, whole = axes[j]
        close.plot(record.t[here], record.y[here, j], color=MEASURED, linewidth=1.0, label="measured")
        close.plot(
            record.t[here], predicted[here, j], color=SIMULATED, linestyle=(0, (4, 1.5)), label="simulated"
        )
        close.set_ylabel(f"y{j + 1}{unit(record, 'y', j)}")
        t, low, high = envelope(record.t, residual[:, j])
        whole.fill_between(t, low, high, color=RESIDUAL, linewidth=0.6)
        whole.set_ylabel(f"residual{unit(record, 'y', j)}")
    axes[0, 0].set_title("where the residual is largest", loc="left")
    axes[0, 1].set_title("residual: measured minus simulated", loc="left")
    for axis in axes[-1]:
        axis.set_xlabel("time (s)")
    figure.legend(*axes[0, 0].get_legend_handles_labels(), loc="outside lower center", ncols=2)
    head(
        figure,
        "Measured and simulated output",
        "free run on the measured input, from the initial state that fits best",
    )
    return figure


def worst_stretch(residual: Array) -> slice:
    """The window of 250 samples with the largest residual energy, each channel weighted alike."""
    finite = np.nan_to_num(residual)
    scale = np.mean(finite**2, axis=0)
    energy = np.convolve(
        np.sum(finite**2 / np.where(scale > 0, scale, 1.0), axis=1),
        np.ones(min(ZOOM, len(residual))),
        "valid",
    )
    start = int(np.argmax(energy))
    return slice(start, start + min(ZOOM, len(residual)))


def envelope(t: Array, x: Array) -> tuple[Array, Array, Array]:
    """t, smallest and largest of x in at most 800 bins: what a line of all samples would cover."""
    if len(t) <= 2 * BINS:
        return t, np.minimum(x, 0), np.maximum(x, 0)
    edges = np.linspace(0, len(t), BINS + 1).astype(int)[:-1]
    return t[edges], np.fmin.reduceat(x, edges), np.fmax.reduceat(x, edges)


def _spectra(plt: Any, record: Record, estimate: Estimate, predicted: Array) -> Any:
    ny, length = min(record.ny, ROWS), segment_length(record.N, 1)
    f, measured = spectrum(np.nan_to_num(record.y), record.h, length)
    _, residual = spectrum(np.nan_to_num(record.y - predicted), record.h, length)
    figure, axes = _grid(plt, ny)
    for j, axis in enumerate(axes):
        axis.loglog(f, measured[:, j], color=MEASURED, linewidth=1.0, label="measured")
        axis.loglog(
            f, residual[:, j], color=RESIDUAL, linewidth=1.0, linestyle=(0, (4, 1.5)), label="residual"
        )
        what = unit(record, "y", j).strip(" ()")
        axis.set_ylabel(f"y{j + 1} ({what or '1'}/√Hz)")
        _frequency_axis(axis, estimate)
    figure.legend(*axes[0].get_legend_handles_labels(), loc="outside lower center", ncols=2)
    head(figure, "Spectra of the output and of the residual", NATURAL)
    return figure


NATURAL = "thin lines: natural frequencies of the estimate"


def _grid(plt: Any, count: int) -> tuple[Any, list[Any]]:
    columns = min(count, 3)
    rows = -(-count // columns)
    size = ({1: 5.4, 2: 7.4}.get(columns, 9.6), 1.3 + 2.0 * rows)
    figure, axes = plt.subplots(rows, columns, figsize=size, layout="constrained", squeeze=False)
    for axis in axes.flat[count:]:
        axis.set_visible(False)
    return figure, list(axes.flat[:count])


def _frequency_axis(axis: Any, estimate: Estimate) -> None:
    axis.set_xlabel("frequency (Hz)")
    log_ticks(axis.xaxis, *axis.get_xlim())
    log_ticks(axis.yaxis, *axis.get_ylim())
    for f in natural_frequencies(estimate):
        axis.axvline(f, color=GUIDE_COLOUR, linewidth=0.6, zorder=0.5)


def natural_frequencies(estimate: Estimate) -> Array:
    """Hz, of the oscillating modes."""
    if estimate.poles is None or not len(estimate.poles):
        return np.zeros(0)
    omega, zeta = frequencies_and_damping(np.asarray(estimate.poles))
    return omega[(np.abs(zeta) < 1) & (omega > 0)] / (2 * np.pi)


def _responses(plt: Any, record: Record, estimate: Estimate, predicted: Array) -> list[Any]:
    """|G| from the measured and from the simulated output by the same cross spectra: window and hold cancel."""
    length = segment_length(record.N, record.nu)
    if record.N < 3 * length or not np.any(record.u):
        return []
    f, measured, _ = responses(record.u, np.nan_to_num(record.y), record.h, length)
    _, simulated, _ = responses(record.u, np.nan_to_num(predicted), record.h, length)
    cells = [(i, j) for i in range(record.ny) for j in range(record.nu)]
    if len(cells) > 9:
        cells = [(i, i) for i in range(min(record.ny, record.nu, 9))]
    figure, axes = _grid(plt, len(cells))
    for axis, (i, j) in zip(axes, cells):
        axis.loglog(f, np.abs(measured[:, i, j]), ".", color=MEASURED, markersize=2.5, label="measured")
        axis.loglog(f, np.abs(simulated[:, i, j]), color=SIMULATED, linewidth=1.2, label="simulated")
        axis.set_ylabel(f"|y{i + 1}/u{j + 1}|{_ratio(record, i, j)}")
        _frequency_axis(axis, estimate)
    figure.legend(*axes[0].get_legend_handles_labels(), loc="outside lower center", ncols=2)
    head(figure, "Frequency response", f"cross spectra of both outputs with the input; {NATURAL}")
    return [figure]


def _ratio(record: Record, i: int, j: int) -> str:
    y, u = (unit(record, group, k).strip(" ()") for group, k in (("y", i), ("u", j)))
    return f" ({y or '1'}/{u or '1'})" if y or u else ""


def _parameters(plt: Any, model: Model, estimate: Estimate) -> Any:
    """Every entry of the upper triangles with its 95 % interval, less the model's value where it has one."""
    n = model.n or 0
    entries = np.triu_indices(n)
    places = np.arange(len(entries[0]))[::-1]
    size = (9.6, 1.5 + max(1.2, 0.17 * len(places)))
    figure, axes = plt.subplots(1, 3, figsize=size, layout="constrained", sharey=True)
    for axis, (X, word) in zip(axes, MATRICES.items()):
        value, given, std = getattr(estimate, X)[entries], getattr(model, word), estimate.std(X)
        value = value if given is None else value - given[entries]
        wide = None if std is None else Z95 * std[entries]
        axis.errorbar(
            value, places, xerr=wide, fmt="o", color=COLOURS[0], elinewidth=1.0, capsize=2, markersize=3.5
        )
        axis.axvline(0, color=GUIDE_COLOUR, linewidth=0.9)
        axis.set_title(f"{X}, {word}", loc="left")
    axes[0].set_yticks(places, [f"{i + 1},{j + 1}" for i, j in zip(*entries)], fontsize=8 if n < 5 else 6)
    axes[0].set_ylim(-0.7, len(places) - 0.3)
    axes[0].set_ylabel("row, column")
    line = (
        "95 % intervals, SI units"
        if estimate.covariance is not None
        else "SI units; this method gives no intervals"
    )
    head(figure, "Estimated matrices" + ("" if model.mass is None else ", less the model's values"), line)
    return figure
