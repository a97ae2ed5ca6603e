"""record -> black-box model by sippy_unipi (PyPI), M, D, K by the direct projection."""

from __future__ import annotations

import contextlib
import io
from dataclasses import dataclass

import numpy as np

from sysid_bench.mechanics.black_box import estimate_of_black_box, peer_module
from sysid_bench.mechanics.suitability import require_plain
from sysid_bench.nouns import Diverged, Estimate, InputError, Model, Record

ALGORITHMS = ("N4SID", "MOESP", "CVA", "PARSIM-P", "PARSIM-S", "PARSIM-K")


@dataclass(frozen=True)
class PeerSippy:
    """algorithm: N4SID | MOESP | CVA | PARSIM-P | PARSIM-S | PARSIM-K (PARSIM-S serves it best on smooth inputs);
    horizon: of past and future, samples."""

    algorithm: str = "PARSIM-S"
    horizon: int = 20

    nominal = False

    def __post_init__(self) -> None:
        if self.algorithm not in ALGORITHMS:
            raise InputError(
                f"algorithm of sippy must be one of {', '.join(ALGORITHMS)}; got {self.algorithm!r}."
            )

    def fit(self, record: Record, model: Model) -> Estimate:
        """Raises NotApplicable where the package is missing, Diverged where it fails."""
        require_plain(record, model, "sippy")
        peer = peer_module("sippy_unipi", "sippy_unipi")
        su, sy = record.u.std(axis=0), record.y.std(axis=0)
        try:
            with contextlib.redirect_stdout(io.StringIO()):
                found = peer.system_identification(
                    (record.y / sy).T, (record.u / su).T, self.algorithm, tsample=record.h,
                    SS_fixed_order=2 * model.n, SS_f=self.horizon, SS_p=self.horizon, SS_D_required=True,
                )  # fmt: skip
        except (ValueError, IndexError, np.linalg.LinAlgError) as problem:
            raise Diverged(f"sippy {self.algorithm} failed: {problem}") from problem
        scaled = (found.A, found.B / su, found.C * sy[:, None], found.D * sy[:, None] / su)
        return estimate_of_black_box(*scaled, record.h, model, {"horizon": self.horizon})
