"""rows without an estimate -> the strip under a figure: failed runs in percent, per series, against x."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from sysid_bench.views.panel import positions
from sysid_bench.views.spec import Figure
from sysid_bench.views.study import Study, failed, has_value
from sysid_bench.views.style import look


def draw_failures(axis: Any, study: Study, spec: Figure, mask: np.ndarray, series: Sequence[Any]) -> None:
    """Share of the runs that diverged, timed out or broke, for each series, in percent."""
    words = study.columns[spec.x].dtype.kind not in "fiu"
    for i, value in enumerate(series):
        rows = mask if value is None else mask & (study.columns[spec.series or ""] == value)
        x, share = failure_share(study, spec.x, rows)
        shift = (i - (len(series) - 1) / 2) * 0.7 / len(series) if words else 0.0
        style = look(i) | {"markersize": 3, "linewidth": 1.0} | ({"linestyle": ""} if words else {})
        axis.plot(positions(study, spec, x) + shift, 100 * share, **style, clip_on=False)
    axis.set_ylim(0, 100)
    axis.set_yticks([0, 50, 100])
    axis.set_ylabel("failed\n(%)", fontsize=7.5)


def failure_share(study: Study, x: str, rows: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """x (nx,) and the share (nx,) of the rows there that failed, of those where the method applies."""
    applies = rows & (study.columns["status"] != "not_applicable") & has_value(study.columns, x)
    xs, bad = study.columns[x][applies], failed(study.columns)[applies]
    places = sorted(set(xs))
    return np.array(places), np.array([bad[xs == p].mean() for p in places])
