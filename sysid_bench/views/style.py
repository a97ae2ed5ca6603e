"""Looks of every figure: sizes, a palette that colour-blind eyes and grey print tell apart, tick labels."""

from __future__ import annotations

import re
from contextlib import contextmanager
from typing import Any

# Okabe and Ito's palette without yellow and black (black is the bound); each colour has its own marker and dash, and
# comes back with another marker: 88 series differ.
COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#7A5195", "#666666")
MARKERS = ("o", "s", "^", "D", "v", "P", "X", "*", "<", "h", ">")
DASHES = (
    "-",
    (0, (5, 1.5)),
    (0, (3, 1, 1, 1)),
    (0, (1, 1)),
    (0, (6, 1, 1, 1, 1, 1)),
    (0, (8, 2)),
    (0, (2, 2)),
    "-",
)
BOUND_COLOUR, GUIDE_COLOUR = "#111111", "#777777"

RC: dict[Any, Any] = {
    "figure.dpi": 100, "savefig.dpi": 200, "savefig.facecolor": "white", "svg.hashsalt": "sysid-bench",
    "font.size": 9, "axes.titlesize": 9.5, "axes.labelsize": 9, "legend.fontsize": 8.5, "xtick.labelsize": 8,
    "ytick.labelsize": 8, "font.family": "DejaVu Sans", "axes.spines.top": False, "axes.spines.right": False,
    "axes.grid": True, "grid.color": "#e3e3e3", "grid.linewidth": 0.6, "axes.axisbelow": True,
    "lines.linewidth": 1.4, "lines.markersize": 4.5, "legend.frameon": False, "axes.linewidth": 0.7,
    "axes.unicode_minus": True, "path.simplify": True, "axes.formatter.use_mathtext": True,
}  # fmt: skip


@contextmanager
def publication() -> Any:
    """matplotlib.pyplot without a display and with the style of the suite; closes what it opened."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    with plt.rc_context(RC):
        try:
            yield plt
        finally:
            plt.close("all")


def look(i: int) -> dict[str, Any]:
    """Colour, marker and dash of the i-th series; later ones are smaller, so that one under another still shows."""
    return {
        "markersize": max(3.4, 5.6 - 0.55 * i),
        "color": COLOURS[i % len(COLOURS)],
        "marker": MARKERS[i % len(MARKERS)],
        "linestyle": DASHES[i % len(DASHES)],
    }


def log_ticks(axis: Any, low: float, high: float) -> None:
    """Log axis with plain numbers: 1, 2, 5 steps over few decades, whole decades over many."""
    from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter, NullLocator

    few = high / low < 300 if low > 0 else False
    axis.set_major_locator(LogLocator(base=10, subs=(1.0, 2.0, 5.0) if few else (1.0,), numticks=12))
    axis.set_major_formatter(FuncFormatter(lambda v, _: _plain(v)))
    many = low > 0 and high / low > 1e4
    axis.set_minor_locator(NullLocator() if many else LogLocator(base=10, subs=range(2, 10), numticks=40))
    axis.set_minor_formatter(NullFormatter())


def _plain(value: float) -> str:
    from math import floor, log10

    if value <= 0 or 1e-3 <= value < 1e4:
        return f"{value:g}"
    exponent = floor(log10(value) + 1e-9)
    mantissa = value / 10**exponent
    return f"$10^{{{exponent}}}$" if abs(mantissa - 1) < 1e-6 else f"${mantissa:g}\\cdot10^{{{exponent}}}$"


def wrapped(text: str, width: int = 34) -> str:
    """A label in lines of like length, at most about `width`; mathematics between $ is not broken."""
    lines, width = [""], len(text) // -(-len(text) // width) + 4
    for word in re.findall(r"(?:\$[^$]*\$|[^\s$])+", text):
        if lines[-1] and len(lines[-1]) + 1 + len(word) > width:
            lines.append("")
        lines[-1] = f"{lines[-1]} {word}".strip()
    return "\n".join(lines)


def save(figure: Any, folder: Any, name: str) -> list[Any]:
    """Write folder/name.png (200 dpi) and folder/name.svg, the same bytes for the same figure."""
    folder.mkdir(parents=True, exist_ok=True)
    figure.draw_without_rendering()
    figure.set_layout_engine("none")  # laid out once, not once per file
    png, svg = folder / f"{name}.png", folder / f"{name}.svg"
    figure.savefig(png, metadata={"Software": None})
    figure.savefig(svg, metadata={"Date": None, "Creator": None})
    return [png, svg]
