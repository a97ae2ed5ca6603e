"""a run as planned -> what it will do, in words and numbers, before anything moves."""

from __future__ import annotations

from typing import Any

import numpy as np

from sysid_bench.frames.load import Load
from sysid_bench.measure.commands import Commands
from sysid_bench.nouns import Array, InputError, Model


def predicted(plan: Commands, rig: Any, model: Model) -> Array:
    """y (Ntotal, ny) of the nominal model from rest. Raises InputError where it cannot say or does not fit the rig."""
    if not model.has_values:
        raise InputError(
            "model: a prediction needs values of mass, damping and stiffness; this file has none."
        )
    nu, ny = plan.u.shape[1], len(rig.output_channels)
    if (model.nu, model.ny) != (nu, ny):
        raise InputError(
            f"model has {model.nu} inputs and {model.ny} outputs; rig {rig.name} has {nu} and {ny}."
        )
    if model.effects:
        from sysid_bench.mechanics.nonlinear import simulate

        return simulate(model, plan.u, 1 / rig.rate_hz, "zoh").y
    from sysid_bench.mechanics.simulate import simulate as simulate_linear

    return simulate_linear(model, plan.u, 1 / rig.rate_hz, "zoh")


NEXT_LINE = "\n" + 12 * " "


def preview(plan: Commands, rig: Any, load: Load, y: Array | None) -> str:
    """The text of a preview."""
    h = 1 / rig.rate_hz
    rate = np.diff(plan.u, axis=0, prepend=0 * plan.u[:1]) * rig.rate_hz
    units = [c.unit for c in rig.input_channels]
    lines = [
        f"rig         {rig.name}: {len(units)} inputs, {len(rig.output_channels)} outputs, {rig.rate_hz:g} Hz, {rig.dbc}",
        f"run         {plan.total * h:.4g} s: {plan.first * h:.3g} s run-in, record of {plan.N} samples, run-out",
        "force       " + _peaks(plan.u, units) + f"; limit {rig.force_limit:g}",
        f"force rate  {np.abs(rate).max():.4g} per s; limit {rig.force_rate_limit:g}",
        f"bus load    {load.arithmetic(NEXT_LINE)}; budget {100 * rig.load_budget:.0f} %",
        f"watchdog    the device zeroes its force {rig.watchdog_s:g} s after the host falls silent",
    ]
    if y is None:
        lines.append("motion      not predicted (give model=FILE); watched against the limits during the run")
    else:
        speed = np.abs(np.diff(y, axis=0)).max() * rig.rate_hz
        peaks = _peaks(y, [c.unit for c in rig.output_channels])
        lines.append(f"motion      {peaks} predicted; limit {rig.position_limit:g}")
        lines.append(f"velocity    {speed:.4g} predicted; limit {rig.velocity_limit:g}")
    return "\n".join(lines)


def _peaks(values: Array, units: list[str]) -> str:
    return (
        ", ".join(f"{peak:.4g} {unit}" for peak, unit in zip(np.abs(values).max(axis=0), units)) + " at most"
    )
