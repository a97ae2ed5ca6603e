"""`figures:` of a study's yaml -> Figure and Panel specs, checked; standard figures where it names none."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from typing import Any

import numpy as np

from sysid_bench.nouns import InputError
from sysid_bench.views.study import Study

MATRICES = ("M", "K", "D", "A")


@dataclass(frozen=True)
class Panel:
    """One pair of axes. y, bound and theory name columns of the table (one, or a list of equal length).

    where   rows of this panel: {column: value or list of values}
    y_log   overrides the figure's; y_limits [low, high]
    vlines, hlines   marks: lists of {x | y: number, label: text}
    """

    y: tuple[str, ...]
    label: str = ""
    title: str = ""
    bound: tuple[str, ...] = ()
    theory: tuple[str, ...] = ()
    where: Mapping[str, Any] = field(default_factory=dict)
    y_log: bool | None = None
    y_limits: tuple[float, float] | None = None
    vlines: tuple[Mapping[str, Any], ...] = ()
    hlines: tuple[Mapping[str, Any], ...] = ()


@dataclass(frozen=True)
class Figure:
    """One figure: panels of medians over runs against one column, a curve per value of `series`.

    names  {series value or column: words for the legend}
    """

    name: str
    x: str
    panels: tuple[Panel, ...]
    title: str = ""
    x_label: str = ""
    x_log: bool = False
    y_log: bool = False
    series: str | None = None
    where: Mapping[str, Any] = field(default_factory=dict)
    vlines: tuple[Mapping[str, Any], ...] = ()
    names: Mapping[str, str] = field(default_factory=dict)
    columns: int | None = None
    caption: str = ""


def read_figure(node: Mapping[str, Any]) -> Figure:
    """Check one entry of `figures:`. Raises InputError on an unknown or missing key."""
    known = _known(Figure, node, f"figure {node.get('name', '?')}")
    for key in ("name", "x", "panels"):
        if not known.get(key):
            raise InputError(f"figure {node.get('name', '?')} needs the key {key!r}.")
    panels = tuple(_panel(p, str(node["name"])) for p in known["panels"])
    return Figure(**{**known, "panels": panels, "vlines": tuple(known.get("vlines") or ())})


def _panel(node: Mapping[str, Any], figure: str) -> Panel:
    known = _known(Panel, node, f"a panel of figure {figure}")
    if not known.get("y"):
        raise InputError(f"a panel of figure {figure} needs the key 'y': a column of the table.")
    for key in ("y", "bound", "theory"):
        value = known.get(key) or ()
        known[key] = (value,) if isinstance(value, str) else tuple(value)
    for key in ("bound", "theory"):
        if known[key] and len(known[key]) not in (1, len(known["y"])):
            raise InputError(
                f"figure {figure}: {key} must name one column, or one for each of {', '.join(known['y'])}."
            )
    for key in ("vlines", "hlines"):
        known[key] = tuple(known.get(key) or ())
    return Panel(**known)


def _known(kind: type, node: Mapping[str, Any], what: str) -> dict[str, Any]:
    names = [f.name for f in fields(kind)]
    unknown = [key for key in node if key not in names]
    if unknown:
        raise InputError(f"{what} has the unknown key {unknown[0]!r}; known: {', '.join(names)}.")
    return dict(node)


def study_figures(study: Study) -> list[Figure]:
    """The figures that the study's yaml asks for, else the standard ones; without those of left_out."""
    asked = [read_figure(node) for node in study.config.get("figures") or []]
    return [spec for spec in asked or standard_figures(study) if not _absent(study, spec)]


def left_out(study: Study) -> list[str]:
    """Why figures cannot be drawn: columns that the table lacks (misspelt, or no run returned them)."""
    specs = [read_figure(node) for node in study.config.get("figures") or []]
    absent = [(spec.name, _absent(study, spec)) for spec in specs]
    return [
        f"figure {name}: the table has no column {', '.join(columns)}." for name, columns in absent if columns
    ]


def _absent(study: Study, spec: Figure) -> list[str]:
    wanted = [spec.x, *([spec.series] if spec.series else []), *spec.where]
    wanted += [c for p in spec.panels for c in (*p.y, *p.bound, *p.theory, *p.where)]
    return [column for column in dict.fromkeys(wanted) if column not in study.columns]


def standard_figures(study: Study) -> list[Figure]:
    """Errors of M, K, D, A against the first numeric axis (else against the plants), one curve per method."""
    panels = tuple(
        Panel((f"{X}_error",), f"relative error of {X}", bound=_there(study, f"{X}_bound"))
        for X in MATRICES
        if f"{X}_error" in study.columns and np.isfinite(study.columns[f"{X}_error"]).any()
    )
    x = _first_axis(study)
    if not panels or x is None:
        return []
    series = "method" if "method" in study.columns and x != "method" else None
    numeric = study.columns[x].dtype.kind in "fiu"
    log = numeric and min(study.order(x)) > 0 and max(study.order(x)) / min(study.order(x)) > 10
    return [
        Figure(f"error_{x}".replace(".", "_"), x, panels, title=f"{study.name}: relative errors", x_label=axis_label(x),
               x_log=log, y_log=True, series=series)
    ]  # fmt: skip


def _there(study: Study, name: str) -> tuple[str, ...]:
    return (name,) if name in study.columns and np.isfinite(study.columns[name]).any() else ()


def _first_axis(study: Study) -> str | None:
    numeric = [a for a in study.axes if study.columns[a].dtype.kind in "fiu" and len(study.order(a)) > 1]
    words = [a for a in ("plant", "method") if a in study.columns]
    return next(iter([*numeric, *words]), None)


def axis_label(column: str) -> str:
    """Words and unit for an axis column: sampling.h_s -> sampling time h (s)."""
    known = {"sampling.h_s": "sampling time $h$ (s)", "sampling.N": "samples $N$", "noise.snr_db": "SNR (dB)"}
    units = {"_s": " (s)", "_db": " (dB)", "_hz": " (Hz)", "_N": " (N)", "_m": " (m)"}
    tail = next((unit for end, unit in units.items() if column.endswith(end)), "")
    return known.get(column, column.removesuffix(next((e for e in units if column.endswith(e)), "")) + tail)
