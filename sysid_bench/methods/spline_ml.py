"""record(s), structure -> M, D, K at the Cramer-Rao bound: in-band maximum likelihood with the right hold.

Minimises the output (simulation) error in the frequency domain, over the band that carries the response, with
an exact propagation of the input between samples, a free initial state, noise variances re-estimated, and
a linear least-squares start. Uses nothing but the record and the structure of the model.

Source: our own; the likelihood is that of Pintelon and Schoukens, System Identification, 2012, chapter 9.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from sysid_bench.mechanics.estimation import Fit, Problem, fit_hold, fit_problem, problem_of
from sysid_bench.mechanics.fit_report import estimate_of
from sysid_bench.nouns import HOLDS, Estimate, InputError, Model, Record

UNDECIDED = 3.0  # log-likelihood: below this another hold explains the record about as well


@dataclass(frozen=True)
class SplineML:
    """In-band maximum likelihood. fit takes a Record or a sequence of Records of one plant.

    hold      record (the model's, else the record's, else auto) | auto (by likelihood) | zoh | foh | cubic | bandlimited
    noise     diagonal (a variance per sensor) | full (a covariance) | coloured (a spectrum per sensor)
    definite  keep M and K positive definite and D positive semidefinite
    damping   free | proportional (D = alpha M + beta K, both estimated)
    nominal   start at the model's values where the record alone gives no start

    Flagged samples count as missing, times with holes are put on their grid; other uneven times are resampled.
    Raises NotApplicable where there is no start, Diverged where the search does not end in a maximum.
    """

    hold: str = "record"
    noise: str = "diagonal"
    definite: bool = False
    damping: str = "free"
    nominal: bool = False

    def __post_init__(self) -> None:
        if self.hold not in ("record", "auto", *HOLDS):
            raise InputError(f"hold must be record, auto or one of {', '.join(HOLDS)}; got {self.hold!r}.")
        if self.noise not in ("diagonal", "full", "coloured"):
            raise InputError(f"noise must be diagonal, full or coloured; got {self.noise!r}.")
        if self.damping not in ("free", "proportional"):
            raise InputError(f"damping must be free or proportional; got {self.damping!r}.")
        if self.definite and self.damping == "proportional":
            raise InputError("definite and damping=proportional do not go together: choose one.")

    def fit(self, record: Record | Sequence[Record], model: Model) -> Estimate:
        records = [record] if isinstance(record, Record) else list(record)
        with np.errstate(all="ignore"):
            settings = self.noise, self.definite, self.nominal, self.damping == "proportional"
            problem = problem_of(records, model, *settings)
            wanted = self._hold(records[0], model)
            if wanted != "auto":
                return estimate_of(fit_problem(problem, wanted), {"hold": wanted})
            return _likeliest(problem, records[0].period is not None)

    def _hold(self, record: Record, model: Model) -> str:
        return self.hold if self.hold != "record" else model.hold or record.hold or "auto"


def _likeliest(problem: Problem, periodic: bool) -> Estimate:
    """The fit of the hold with the highest likelihood, and by how much it won."""
    first = fit_problem(problem, "cubic")
    fits: dict[str, Fit] = {"cubic": first}
    for hold in ("zoh", "foh", *(["bandlimited"] if periodic else [])):
        fits[hold] = fit_hold(problem, hold, first)
    best, second = sorted(fits, key=lambda name: fits[name].cost)[:2]
    margin = fits[second].cost - fits[best].cost
    said = {"hold": best, "hold_runner_up": second, "hold_margin": margin}
    if margin < UNDECIDED:
        said["hold_warning"] = (
            f"hold not decidable: {second} is only {margin:.1f} of log-likelihood behind {best}"
        )
    return estimate_of(fits[best], said)
