"""forces and predicted motion of a run -> figure."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np


def draw(u: np.ndarray, y: np.ndarray | None, rig: Any, path: Path) -> None:
    """Write the preview's figure: forces u (N, nu), predicted outputs y (N, ny) or None, with the rig's limits."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    t = np.arange(len(u)) / rig.rate_hz
    panels = [("force", u, rig.input_channels, rig.force_limit)]
    if y is not None:
        panels.append(("predicted output", y, rig.output_channels, rig.position_limit))
    figure, axes = plt.subplots(len(panels), 1, sharex=True, squeeze=False, figsize=(9, 2.8 * len(panels)))
    for axis, (name, values, channels, limit) in zip(axes[:, 0], panels):
        for i, channel in enumerate(channels):
            axis.plot(t, values[:, i], lw=0.8, label=f"{i + 1}")
            axis.set_ylabel(f"{name} ({channel.unit})")
        if limit < 5 * np.abs(values).max():
            axis.axhline(limit, color="0.4", ls="--", lw=0.8)
            axis.axhline(-limit, color="0.4", ls="--", lw=0.8)
        axis.legend(loc="upper right", ncols=4, fontsize="small")
    axes[-1, 0].set_xlabel("t (s)")
    figure.savefig(path, dpi=120, bbox_inches="tight")
    plt.close(figure)
