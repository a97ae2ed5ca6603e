"""An estimate, and the promise of a method: fit(record, model) -> Estimate."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Literal, Protocol

import numpy as np
from numpy.typing import NDArray

from sysid_bench.nouns.model import Model
from sysid_bench.nouns.record import Record
from sysid_bench.nouns.words import Array, Diverged, Status


@dataclass(frozen=True, eq=False)
class Estimate:
    """What a method returns. Fields that a method cannot give are None.

    M, D, K      (n, n) symmetric, SI
    covariance   (ntheta, ntheta) of theta = (vech M, vech D, vech K), vech = upper triangle by rows
                 (mechanics.second_order.pack); zero rows for entries that were not free
    poles        (2n,) continuous-time poles, rad/s, complex
    state_space  (A, B, C, D, h): the discrete (h > 0) or continuous (h = 0) model a black-box method found
    coefficients {"a": (ny..) , "b": ...} of a difference equation, for arx: {"a1": .., "b0": ..} floats
    status, reason, seconds (of fit, filled in by run), diagnostics (flat: name -> number or word)
    """

    M: Array | None = None
    D: Array | None = None
    K: Array | None = None
    covariance: Array | None = None
    poles: NDArray[np.complex128] | None = None
    state_space: tuple[Array, Array, Array, Array, float] | None = None
    coefficients: Mapping[str, float] = field(default_factory=dict[str, float])
    status: Status = "ok"
    reason: str = ""
    seconds: float | None = None
    diagnostics: Mapping[str, Any] = field(default_factory=dict[str, Any])

    @property
    def matrices(self) -> tuple[Array, Array, Array]:
        """M, D, K (n, n). Raises Diverged for an estimate that has none."""
        if self.M is None or self.D is None or self.K is None:
            raise Diverged(f"this estimate has no M, D, K: {self.reason or self.status}.")
        return self.M, self.D, self.K

    def std(self, name: Literal["M", "D", "K"]) -> Array | None:
        """(n, n) standard errors of one matrix, None without a covariance."""
        if self.covariance is None or self.M is None:
            return None
        n = len(self.M)
        q = n * (n + 1) // 2
        start = "MDK".index(name) * q
        S = np.zeros((n, n))
        rows, cols = np.triu_indices(n)
        S[rows, cols] = np.sqrt(np.maximum(np.diag(self.covariance)[start : start + q], 0.0))
        return np.triu(S) + np.triu(S, 1).T


class Method(Protocol):
    """fit(record, model) -> Estimate: pure; the object holds settings only.

    `nominal`: True where the method wants to start at the model's values (in a sweep: the truth, and the
    row says so). A method says NotApplicable or Diverged by raising it.
    """

    nominal: bool

    def fit(self, record: Record, model: Model) -> Estimate: ...
