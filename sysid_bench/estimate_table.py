"""Estimate -> the tables that a person reads on a terminal."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from rich.console import Console
from rich.table import Table

from sysid_bench.files.estimate import MATRIX_NAMES, Z95
from sysid_bench.mechanics.second_order import frequencies_and_damping, sort_poles
from sysid_bench.mechanics.uncertainty import ModalUncertainty, uncertainty_of
from sysid_bench.nouns import Array, Estimate

LARGEST_GRID = 4
_WORDS = {"M": "mass", "D": "damping", "K": "stiffness"}


def show(estimate: Estimate, console: Console | None = None) -> None:
    """Print M, D, K with 95 % intervals, then the modes; what is not there is left out."""
    console = console or Console(highlight=False)
    if not console.is_terminal:
        console.width = max(console.width, 120)
    for table in tables(estimate):
        console.print(table)


def tables(estimate: Estimate) -> Iterator[Table]:
    for name in MATRIX_NAMES:
        value, std = getattr(estimate, name), estimate.std(name)
        if value is not None:
            grid = len(value) <= LARGEST_GRID
            yield _grid(name, value, std) if grid else _list(name, value, std)
    if estimate.poles is not None and len(estimate.poles):
        yield _modes(np.asarray(estimate.poles), uncertainty_of(estimate))


def _title(name: str, std: Array | None) -> str:
    return f"{name} ({_WORDS[name]}, SI){', 95 % intervals' if std is not None else ', no intervals'}"


def _grid(name: str, value: Array, std: Array | None) -> Table:
    """A matrix as a matrix: value ± half-width."""
    title = _title(name, std)
    table = Table(title=title, title_justify="left", show_header=False, min_width=len(title))
    for i, row in enumerate(value):
        table.add_row(*[_interval(x, None if std is None else std[i, j]) for j, x in enumerate(row)])
    return table


def _list(name: str, value: Array, std: Array | None) -> Table:
    """The diagonal and the entries that are told from zero; the rest is counted."""
    table = Table(title=_title(name, std), title_justify="left")
    table.add_column("entry")
    table.add_column("value ± half-width" if std is not None else "value")
    hidden = 0
    for i, j in zip(*np.triu_indices(len(value)), strict=True):
        if i != j and std is not None and abs(value[i, j]) <= Z95 * std[i, j]:
            hidden += 1
        else:
            table.add_row(f"[{i}][{j}]", _interval(value[i, j], None if std is None else std[i, j]))
    if hidden:
        table.caption = f"{hidden} more off the diagonal, not told from zero"
    return table


def _interval(value: float, std: float | None) -> str:
    """`4.003 ± 0.021`, with the digits that the interval justifies."""
    if std is None or not np.isfinite(std):
        return f"{value:.5g}"
    if std == 0:
        return f"{value:.5g} (fixed)"
    half = Z95 * std
    digits = max(0, 1 - int(np.floor(np.log10(half))))
    if digits > 6 or abs(value) >= 1e6:
        return f"{value:.6g} ± {half:.2g}"
    return f"{value:.{digits}f} ± {half:.{digits}f}"


def _modes(poles: np.ndarray, known: ModalUncertainty | None) -> Table:
    """One line per mode: pairs of complex poles once, real poles each; 95 % intervals where known."""
    half = sort_poles(poles)
    half = half[half.imag >= 0]
    omega, zeta = frequencies_and_damping(poles)
    spread = [np.full(len(half), np.inf)] * 2 if known is None else [known.omega_n_std, known.zeta_std]
    table = Table(title=f"modes{'' if known is None else ', 95 % intervals'}", title_justify="left")
    for heading in ("omega_n rad/s", "f Hz", "zeta", "pole rad/s"):
        table.add_column(heading, justify="right")
    for pole, w, z, of_w, of_z in zip(half, omega, zeta, *spread, strict=True):
        shown = f"{pole.real:.4g} ± {pole.imag:.4g}i" if pole.imag > 0 else f"{pole.real:.4g}"
        table.add_row(_interval(w, of_w), f"{w / (2 * np.pi):.5g}", _interval(z, of_z), shown)
    return table
