"""what the workflow found: verdict, better model, proofs on the test records, and what they say of each other."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sysid_bench.gap.candidates import Screen
from sysid_bench.gap.check_data import DataCheck
from sysid_bench.gap.decide import Verdict
from sysid_bench.gap.force import OnForce
from sysid_bench.gap.problem import Problem
from sysid_bench.gap.prove import Proof
from sysid_bench.gap.story import Story
from sysid_bench.mechanics.effect import Effect
from sysid_bench.nouns import Array, Model

GREW = 1.01  # times the gap of the model as given, from which the better one's is said to have grown
OTHERWISE = 3.0  # times what the training records promise, from which the test records are said to differ


@dataclass(frozen=True, eq=False)
class Answer:
    """All that the workflow found. better: the model to go on with; added: its new effects, data faults included; noise (ny,):
    variance on each test record."""

    verdict: Verdict
    problem: Problem
    check: DataCheck
    story: Story
    better: Model
    added: tuple[Effect, ...]
    nominal_rho: float
    before: list[Proof]
    after: list[Proof]
    noise: list[Array]
    last_screen: Screen | None = None
    floor_found: str = "from the highest frequencies"
    judged: dict[str, list[OnForce]] | None = (
        None  # of a free mass: given, refitted, better on the test records
    )

    @property
    def force_gaps(self) -> dict[str, float] | None:
        """Mean gap on the force over the test records of the given, the refitted, the better model; and the noise floor."""
        if self.judged is None:
            return None
        return {**{name: self._mean_gap([], name) for name in self.judged}, "floor": self.floor}

    @property
    def gap_before(self) -> float:
        """Held-out error of the model as given: of its free run, or of the force where that is judged."""
        return self._mean_gap(self.before, "given")

    @property
    def gap_after(self) -> float:
        """The same of the better model."""
        return self._mean_gap(self.after, "better")

    @property
    def reason(self) -> str:
        """The verdict's reason; where the test records, which chose nothing, do not bear it out, that too."""
        word, before, after = self.verdict.word, self.gap_before, self.gap_after
        promised = max(1.0, self.nominal_rho) ** 0.5 * self.floor
        if word in ("effect", "parameters") and after > GREW * before:
            told = f"the gap grew from {100 * before:.3g} % to {100 * after:.3g} %: the better model is not proven"
        elif word == "none" and not self.judged and before > OTHERWISE * promised:
            told = (
                f"the gap is {100 * before:.3g} % where noise makes {100 * self.floor:.3g} %: something is in them that "
                "the training records lack (another machine, unit, channel or range)"
            )
        else:
            return self.verdict.reason
        return f"{self.verdict.reason}; but on the test records, which chose nothing, {told}"

    def _mean_gap(self, proofs: list[Proof], which: str) -> float:
        found = [p.gap for p in (self.judged[which] if self.judged else proofs)]
        return float(np.sqrt(np.mean(np.square(found))))

    @property
    def floor(self) -> float:
        """The noise floor on the test records, in the unit of the gap."""
        if self.judged:
            return float(np.mean([j.floor for j in self.judged["better"]]))
        shares = [
            np.mean(variance / np.maximum(np.mean(p.trace.y[p.trace.good] ** 2, axis=0), 1e-300))
            for variance, p in zip(self.noise, self.after)
        ]
        return float(np.sqrt(np.mean(shares)))
