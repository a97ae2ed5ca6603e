"""A record's hold, period and units <-> plain values, checked."""

# protobuf, mcap and pyarrow say no types.
# pyright: reportUnknownVariableType=false

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from sysid_bench.nouns import HOLDS, Record
from sysid_bench.records.columns import Place


def properties_of(record: Record) -> dict[str, Any]:
    """What a file must say beside the samples."""
    return {"hold": record.hold, "period": record.period, "units": dict(record.units)}


def properties_from(stored: Mapping[str, Any], place: Place) -> dict[str, Any]:
    """Keywords of Record from what a file says. Raises InputError on values that cannot be."""
    hold, period, units = stored.get("hold"), stored.get("period"), stored.get("units") or {}
    if hold is not None and hold not in HOLDS:
        raise place.refuse(f"its hold must be one of {', '.join(HOLDS)}; got {hold!r:.60}.")
    if period is not None and not (isinstance(period, int) and period > 0):
        raise place.refuse(f"its period must be a positive number of samples; got {period!r:.60}.")
    if not isinstance(units, dict):
        raise place.refuse(f"its units must be a mapping; got {units!r:.60}.")
    origin = stored.get("origin") or {}
    if not isinstance(origin, dict):
        raise place.refuse(f"its origin must be a mapping; got {origin!r:.60}.")
    return {"hold": hold, "period": period, "units": units, "origin": origin}
