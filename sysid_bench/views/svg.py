"""numbers -> small SVG figures as text: fast enough to stand in a command that answers in a second."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape

import numpy as np

from sysid_bench.nouns import Array
from sysid_bench.views.style import COLOURS

WIDTH, HEIGHT, LEFT, BOTTOM, TOP, RIGHT = 640, 230, 66, 38, 12, 12
DASHES = {1: ' stroke-dasharray="6 2.5"'}  # orange and blue are one grey in print


def ticks(low: float, high: float, count: int = 5) -> Array:
    """Round numbers between low and high."""
    span = max(high - low, 1e-300)
    step = 10.0 ** np.floor(np.log10(span / count))
    step *= min((1, 2, 5, 10), key=lambda k: abs(span / (k * step) - count))
    return np.arange(np.ceil(low / step), np.floor(high / step) + 1) * step + 0.0  # no -0


class Axes:
    """One frame: maps data to the page, collects SVG."""

    def __init__(
        self, x: tuple[float, float], y: tuple[float, float], x_label: str, y_label: str, log: bool = False
    ):
        pad = 0.04 * (y[1] - y[0]) or 1.0
        self.x, self.y, self.log = x, (y[0] - pad, y[1] + pad), log
        self.parts: list[str] = []
        self._frame(x_label, y_label)

    def px(self, x) -> Array:
        share = (np.asarray(x, dtype=float) - self.x[0]) / max(self.x[1] - self.x[0], 1e-300)
        return LEFT + share * (WIDTH - LEFT - RIGHT)

    def py(self, y) -> Array:
        share = (np.asarray(y, dtype=float) - self.y[0]) / max(self.y[1] - self.y[0], 1e-300)
        return HEIGHT - BOTTOM - share * (HEIGHT - BOTTOM - TOP)

    def _frame(self, x_label: str, y_label: str) -> None:
        for value in ticks(*self.x):
            at = float(self.px(value))
            self.parts.append(f'<path class="grid" d="M{at:.1f} {TOP}V{HEIGHT - BOTTOM}"/>')
            self.parts.append(
                f'<text x="{at:.1f}" y="{HEIGHT - BOTTOM + 14}" text-anchor="middle">{value:.4g}</text>'
            )
        for value in ticks(*self.y, count=4):
            at = float(self.py(value))
            text = f"{10**value:.3g}" if self.log else f"{value:.3g}"
            self.parts.append(f'<path class="grid" d="M{LEFT} {at:.1f}H{WIDTH - RIGHT}"/>')
            self.parts.append(f'<text x="{LEFT - 6}" y="{at + 4:.1f}" text-anchor="end">{text}</text>')
        middle = (HEIGHT - BOTTOM + TOP) / 2
        self.parts.append(
            f'<text x="{(WIDTH + LEFT) / 2}" y="{HEIGHT - 6}" text-anchor="middle">{escape(x_label)}</text>'
        )
        self.parts.append(
            f'<text transform="translate(13 {middle}) rotate(-90)" text-anchor="middle">{escape(y_label)}</text>'
        )

    def line(self, x: Array, y: Array, colour: int, width: float = 1.4) -> None:
        points = " ".join(
            f"{a:.1f},{b:.1f}" for a, b in zip(self.px(x), np.clip(self.py(y), -50, HEIGHT + 50))
        )
        self.parts.append(
            f'<polyline clip-path="url(#frame)" points="{points}" fill="none" stroke="{COLOURS[colour]}" stroke-width="{width}"{DASHES.get(colour, "")}/>'
        )

    def dots(self, x: Array, y: Array, colour: int, size: float = 1.4) -> None:
        marks = "".join(f"M{a:.1f} {b:.1f}h.01" for a, b in zip(self.px(x), self.py(y)))
        self.parts.append(
            f'<path clip-path="url(#frame)" d="{marks}" stroke="{COLOURS[colour]}" stroke-width="{2 * size}" stroke-linecap="round" opacity=".45"/>'
        )

    def legend(self, names: Sequence[tuple[str, int]]) -> None:
        at, width = LEFT + 8.0, sum(34 + 6.6 * len(name) for name, _ in names)
        self.parts.append(
            f'<rect x="{LEFT + 2}" y="{TOP}" width="{width:.0f}" height="19" fill="#fff" opacity=".85"/>'
        )
        for name, colour in names:
            dash = DASHES.get(colour, "")
            self.parts.append(
                f'<path d="M{at} {TOP + 9}h17" stroke="{COLOURS[colour]}" stroke-width="2.5"{dash}/>'
            )
            self.parts.append(f'<text x="{at + 21}" y="{TOP + 13}">{escape(name)}</text>')
            at += 34 + 6.6 * len(name)

    def text(self) -> str:
        return _svg(self.parts)


def _svg(parts: list[str], height: int = HEIGHT) -> str:
    style = (
        "<style>text{font:11px system-ui,sans-serif;fill:#333}.grid{stroke:#e3e6ea;stroke-width:1}</style>"
    )
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" width="480pt" viewBox="0 0 {WIDTH} {height}">'
        f'<clipPath id="frame"><rect x="{LEFT}" y="{TOP}" width="{WIDTH - LEFT - RIGHT}" '
        f'height="{max(height - BOTTOM - TOP, 1)}"/></clipPath>'
        f'<rect width="{WIDTH}" height="{height}" fill="#fff"/>{style}{"".join(parts)}</svg>'
    )


def bars(rows: Sequence[tuple[str, float]], unit: str) -> str:
    """Horizontal bars on a logarithmic scale, one per (label, positive number)."""
    low = np.log10(min(v for _, v in rows)) - 0.3
    high = np.log10(max(v for _, v in rows)) + 0.05
    parts, left = [], 210
    for k, (label, value) in enumerate(rows):
        y = 14 + 26 * k
        width = (np.log10(value) - low) / max(high - low, 1e-9) * (WIDTH - left - 90)
        parts.append(f'<text x="{left - 8}" y="{y + 13}" text-anchor="end">{escape(label)}</text>')
        parts.append(
            f'<rect x="{left}" y="{y}" width="{width:.1f}" height="18" fill="{COLOURS[0 if k else 7]}"/>'
        )
        parts.append(f'<text x="{left + width + 6:.1f}" y="{y + 13}">{value:.3g} {escape(unit)}</text>')
    return _svg(parts, 26 * len(rows) + 22)


def field(x: Array, y: Array, size: Array, x_label: str, y_label: str, cells: int = 28) -> str:
    """Mean of `size` over cells of the (x, y) plane: orange where positive, blue with a dash where negative, strong where large."""
    axes = Axes((float(x.min()), float(x.max())), (float(y.min()), float(y.max())), x_label, y_label)
    i = np.clip(((x - x.min()) / max(np.ptp(x), 1e-300) * cells).astype(int), 0, cells - 1)
    j = np.clip(((y - y.min()) / max(np.ptp(y), 1e-300) * cells).astype(int), 0, cells - 1)
    total, count = np.zeros((cells, cells)), np.zeros((cells, cells))
    np.add.at(total, (i, j), size)
    np.add.at(count, (i, j), 1)
    mean = total / np.maximum(count, 1)
    scale = max(float(np.percentile(np.abs(mean[count > 0]), 98)), 1e-300)
    wide, tall = (WIDTH - LEFT - RIGHT) / cells, (HEIGHT - TOP - BOTTOM) / cells
    for a, b in zip(*np.nonzero(count)):
        shade = min(0.06 + 0.94 * abs(mean[a, b]) / scale, 1.0)
        axes.parts.append(
            f'<rect x="{LEFT + a * wide:.1f}" y="{HEIGHT - BOTTOM - (b + 1) * tall:.1f}" width="{wide:.2f}" '
            f'height="{tall:.2f}" fill="{COLOURS[int(mean[a, b] > 0)]}" opacity="{shade:.2f}"/>'
        )
        if mean[a, b] < 0:
            x0, y0 = LEFT + (a + 0.3) * wide, HEIGHT - BOTTOM - (b + 0.5) * tall
            axes.parts.append(f'<path d="M{x0:.1f} {y0:.1f}h{0.4 * wide:.1f}" stroke="#fff"/>')
    return axes.text()
