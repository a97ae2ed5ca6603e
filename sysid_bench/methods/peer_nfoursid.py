"""record -> black-box model by nfoursid (PyPI), M, D, K by the direct projection."""

from __future__ import annotations

import contextlib
import io
from dataclasses import dataclass

import numpy as np

from sysid_bench.mechanics.black_box import estimate_of_black_box, peer_module
from sysid_bench.mechanics.suitability import require_plain
from sysid_bench.nouns import Diverged, Estimate, Model, Record


@dataclass(frozen=True)
class PeerNfoursid:
    """N4SID with state regression. horizon: block rows; 20 serve it better than 10."""

    horizon: int = 20

    nominal = False

    def fit(self, record: Record, model: Model) -> Estimate:
        """Raises NotApplicable where the package is missing, Diverged where it fails."""
        require_plain(record, model, "nfoursid")
        pandas = peer_module("pandas", "nfoursid")
        peer = peer_module("nfoursid.nfoursid", "nfoursid")
        su, sy = record.u.std(axis=0), record.y.std(axis=0)
        inputs, outputs = ([f"{x}{k}" for k in range(n)] for x, n in (("u", record.nu), ("y", record.ny)))
        frame = pandas.DataFrame(np.hstack([record.u / su, record.y / sy]), columns=inputs + outputs)
        try:
            with contextlib.redirect_stdout(io.StringIO()):
                search = peer.NFourSID(frame, outputs, input_columns=inputs, num_block_rows=self.horizon)
                search.subspace_identification()
                space, _ = search.system_identification(rank=2 * model.n)
        except (ValueError, np.linalg.LinAlgError) as problem:
            raise Diverged(f"nfoursid failed: {problem}") from problem
        scaled = (space.a, space.b / su, space.c * sy[:, None], space.d * sy[:, None] / su)
        return estimate_of_black_box(*scaled, record.h, model, {"horizon": self.horizon})
