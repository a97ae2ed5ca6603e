"""a list of runs -> one record each, in a row."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from sysid_bench.nouns import InputError

KNOBS = ("name", "excitation", "amplitude", "seconds", "periods", "repetitions", "seed")


@dataclass(frozen=True)
class Campaign:
    """runs: each {name, excitation: {option: NAME, KNOB: value}, amplitude, seconds, periods, repetitions, seed};
    what a run does not say is as in the measure config. pause_s: rest between runs, for the plant to calm down.

    Raises InputError for an unknown key, a missing or repeated name.
    """

    runs: Sequence[Mapping[str, Any]]
    pause_s: float = 0.0

    def __post_init__(self) -> None:
        names = []
        for i, run in enumerate(self.runs):
            unknown = sorted(set(run) - set(KNOBS))
            if unknown or "name" not in run:
                problem = f"does not know {', '.join(unknown)}" if unknown else "needs a name"
                raise InputError(f"campaign: run {i + 1} {problem}; it takes {', '.join(KNOBS)}.")
            names.append(str(run["name"]))
        if not names or len(set(names)) < len(names):
            raise InputError("campaign: at least one run is wanted, each with a name of its own.")
